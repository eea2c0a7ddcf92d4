"""Points of scans from files, with normals where a file has them."""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import NDArray

from limitsurf.shell.files import opened
from limitsurf.shell.io import by_suffix, ply
from limitsurf.shell.io.points import SUFFIXES, batches

Array = NDArray[np.float64]


def read(path: str) -> tuple[Array, Array | None]:
    """Points (n, 3) of a file, and normals (n, 3) if it has any.

    Parameters
    ----------
    path : str
        ``.csv``, ``.npy`` or ``.npz``: rows of numbers, as `batches` reads them; "-" is CSV from
        the standard input. ``.ply``: its vertices, with or without faces. Of any other format that
        has faces the vertices, as `limitsurf.read` has them.

    Raises
    ------
    ValueError
        For an unknown suffix, or a file that is not as described.
    OSError
        For a file that cannot be read.
    """
    suffix = os.path.splitext(path)[1].lower()
    if path == "-" or suffix in SUFFIXES:
        return np.concatenate(list(batches(path))), None
    if suffix == ".ply":
        with opened(path) as file:
            return ply.vertices(path, file.read())
    return np.asarray(by_suffix.read(path).points, dtype=float), None
