"""The table of vertices in the documentation of LimitSurface says what the eigenbases say."""

import re

import numpy as np
import pytest

import limitsurf as ls

MANY = 40  # faces, where the table says infinity


def rows():
    """Kind, number of faces and the other columns of each row of the table."""
    lines = [re.split(r"\s{2,}", line.strip()) for line in ls.LimitSurface.__doc__.splitlines()]
    (head,) = [k for k, line in enumerate(lines) if line[0] == "vertex"]
    kind = ""
    for vertex, *columns in lines[head + 2 :]:
        if vertex.startswith("="):
            return
        if vertex.startswith("..."):
            yield kind, MANY, columns
            continue
        kind = vertex.split()[0].rstrip(",").replace("smooth", "interior")
        yield kind, int(re.findall(r"\d+", vertex)[0]), columns


@pytest.mark.parametrize(
    ("kind", "faces", "columns"), list(rows()), ids=[f"{kind}-{n}" for kind, n, _ in rows()]
)
def test_row(kind, faces, columns):
    *values, first, second, curvature, normal = columns
    basis = ls.eigenbasis("catmull-clark", kind=kind, faces=faces).float64
    moduli = np.abs(basis.eigenvalues[1:4])
    tolerance = 6e-4 if faces < MANY else 1e-2
    assert np.abs(np.array(values, dtype=float)) == pytest.approx(moduli, abs=tolerance)
    assert normal.startswith("yes") == (len(basis.tangent_masks) > 0)
    assert (normal == "yes, 1 / n") == (normal != "none" and moduli[1] == moduli[2])

    def grows(entry, factor):
        if re.fullmatch(r"[\d.]+\^n", entry):
            return float(entry[:-2]) == pytest.approx(factor, abs=10 * tolerance)
        return entry in ("limit", "bounded", "n") and factor == pytest.approx(1)

    linear = moduli[0] == 0.5
    assert grows(first, 2 * moduli[0])
    assert grows(second, 4 * moduli[2] if linear else 4 * moduli[0])
    assert grows(curvature, moduli[2] / moduli[1] ** 2)


def test_the_table_has_all_kinds():
    assert {kind for kind, _, _ in rows()} == {"interior", "crease", "corner", "dart", "cone"}
    assert len(list(rows())) == 23
