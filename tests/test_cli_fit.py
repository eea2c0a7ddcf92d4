"""The command that fits a cage to a scan."""

import numpy as np
import pytest
from command_line import facts, fail, succeed

import limitsurf as ls
from limitsurf.shell.io import scans

SHEET = ls.Mesh(
    [[x, y, 0.2 * x * x - 0.1 * x * y] for x in range(4) for y in range(4)],
    [[4 * i + j, 4 * i + j + 4, 4 * i + j + 5, 4 * i + j + 1] for i in range(3) for j in range(3)],
)


@pytest.fixture(scope="module")
def scan():
    return ls.sample(ls.LimitSurface(SHEET), 120, rng=1)


@pytest.fixture
def cage(tmp_path):
    path = tmp_path / "cage.obj"
    noise = np.random.default_rng(2).normal(size=SHEET.points.shape)
    ls.write(path, SHEET.with_points(SHEET.points + 0.02 * noise))
    return path


def ply(path, *columns, names):
    rows = np.concatenate(columns, axis=1)
    head = "".join(f"property double {name}\n" for name in names.split())
    text = "\n".join(" ".join(f"{x!r}" for x in row) for row in rows.tolist())
    path.write_text(
        f"ply\nformat ascii 1.0\nelement vertex {len(rows)}\n{head}end_header\n{text}\n"
    )
    return path


def test_scans_of_points_with_and_without_normals(cage, scan, tmp_path):
    bare = ply(tmp_path / "bare.ply", scan.point, names="x y z")
    points, none = scans.read(str(bare))
    assert (points == scan.point).all()
    assert none is None
    full = ply(tmp_path / "full.ply", scan.point, scan.normal, names="x y z nx ny nz")
    points, normals = scans.read(str(full))
    assert (normals == scan.normal).all()
    target = tmp_path / "out.obj"
    found = facts("fit", cage, full, "-o", target)
    assert found["points"] == 120
    assert found["converged"] is True
    assert found["steps"] == len(found["rms"]) - 1
    assert found["max"] < 1e-10
    distance = ls.closest_point(ls.LimitSurface(ls.read(target)), scan.point).distance
    assert distance.max() < 1e-9


def test_options_are_those_of_the_function(cage, scan, tmp_path):
    np.save(tmp_path / "scan.npy", scan.point)
    options = ["--loss", "huber", "--smoothing", 1e-3, "--fairness", "membrane"]
    words = ["fit", cage, tmp_path / "scan.npy", *options, "--max-iterations", 2]
    printed = succeed(*words)
    points = [line.split()[1:] for line in printed.splitlines() if line.startswith("v ")]
    same = ls.fit(
        ls.read(cage), scan.point, loss="huber", smoothing=1e-3, fairness="membrane",
        max_iterations=2,
    )  # fmt: skip
    assert np.abs(np.array(points, dtype=float) - same.mesh.points).max() < 1e-12


def test_what_is_wrong_is_one_line(cage, tmp_path):
    assert "No such file" in fail("fit", cage, tmp_path / "none.ply")
    assert "both be on the standard input" in fail("fit", "-", "-")
    broken = tmp_path / "broken.ply"
    broken.write_text("ply\nformat ascii 1.0\nelement vertex 0\nend_header\n")
    assert "properties x, y, z" in fail("fit", cage, broken)
    assert "one or more" in fail(
        "fit", cage, ply(tmp_path / "a.ply", np.zeros((0, 3)), names="x y z")
    )
    assert "unknown suffix" in fail("fit", cage, broken, "-o", tmp_path / "a.b")
