"""Bezier extraction operators as NPZ files; the format is told in the how-to on Bezier patches."""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from limitsurf.query.extraction import BezierExtraction

VERSION = 1
ARRAYS = ("exponents", "n_controls", "face", "origin", "size", "offsets", "controls", "operators")
REST = ("face", "corner", "origin", "size", "lower", "upper")


def content(x: BezierExtraction) -> Iterator[bytes]:
    """The bytes of a file.

    Raises
    ------
    ValueError
        For Fractions, which arrays of NPZ do not hold.
    """
    if x.operators.dtype == object:
        raise ValueError(
            "a file of type .npz holds no Fractions: make the operators of a surface of float64 "
            "points, surface.with_points(surface.points.astype(float))"
        )
    arrays: dict[str, Any] = {name: np.asarray(getattr(x, name)) for name in ARRAYS}
    arrays |= {f"rest_{name}": np.asarray(getattr(x.rest, name)) for name in REST}
    arrays |= {"version": np.array(VERSION), "degree": np.array(x.degree)}
    arrays |= {"tensor": np.array(x.tensor)}
    file = io.BytesIO()
    np.savez(file, **arrays)
    yield file.getvalue()
