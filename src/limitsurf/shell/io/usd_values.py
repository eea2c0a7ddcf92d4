"""Values of USD as arrays, and what USD says as messages."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from limitsurf.cage.checks import MeshError


def one_line(said: Any) -> str:
    """A message, or what USD says, in one line and without what only programmers understand."""
    internal = (
        r":SDF_FORMAT_ARGS:\w+=\w+| matching \w+::.*?(?= at ')| \(instantiating stage [^)]*\)"
    )
    if not isinstance(said, str):
        try:
            said = said.commentary
        except UnicodeDecodeError as error:
            said = error.object.decode(errors="backslashreplace")
    return " ".join(re.sub(internal, "", said).split())


def numbers_of(prim: Any, attribute: str, time: Any, kind: str, shape: tuple[int, ...] = ()) -> Any:
    """The numbers of an attribute, (n, *shape), as int64 ("i") or float64 ("f"); none without it.

    Raises
    ------
    MeshError
        Another type or shape.
    """
    dtype = np.int64 if kind == "i" else np.float64
    value = prim.GetAttribute(attribute).Get(time)
    if value is None:
        return np.zeros((0, *shape), dtype)
    array = np.array(value)
    if array.dtype.kind not in ("iu" if kind == "i" else "iuf") or array.shape[1:] != shape:
        array = np.zeros(())
    if array.ndim == 0:
        what = "integers" if kind == "i" else "numbers"
        each = f" of {shape[0]}" if shape else ""
        got = type(value).__name__
        raise MeshError(f"{attribute}: got {got}, need an array of {what}{each}")
    return array.astype(dtype)
