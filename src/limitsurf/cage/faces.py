"""The faces of a mesh as one type, whatever their sizes."""

from __future__ import annotations

from collections.abc import Iterator
from operator import index
from typing import Any, SupportsIndex, TypeAlias, overload

import numpy as np
from numpy.typing import NDArray

IntArray: TypeAlias = NDArray[np.int64]


class Faces:
    """The faces of a mesh, a sequence of arrays of vertices; `Mesh` takes it back as it is.

    ``faces[f]`` are the vertices of a face, counter-clockwise; a slice, or an array of numbers of
    faces or of booleans, gives a sequence of some of them. ``faces + n`` are the faces whose
    vertices have numbers larger by n, as in a mesh joined to another. Two are equal if their faces
    are.

    Where all faces have k corners, numpy takes it as an (m, k) array, so that
    ``mesh.points[mesh.faces]`` are their corners. Where they differ, there is no such array, and a
    ValueError says so; `sizes` and `indices` are the general form.

    Parameters
    ----------
    sizes : (m,) int64
        Number of corners of each face.
    indices : (sum(sizes),) int64
        Vertices of all faces in turn.

    Examples
    --------
    >>> import limitsurf as ls
    >>> house = [[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 1.5]]
    >>> mesh = ls.Mesh(house, [[0, 1, 2, 3], [3, 2, 4]])
    >>> mesh.faces
    Faces({3: 1, 4: 1})
    >>> len(mesh.faces), mesh.faces[1].tolist(), (mesh.faces + 5).tolist()
    (2, [3, 2, 4], [[5, 6, 7, 8], [8, 7, 9]])
    >>> [mesh.points[face].mean(axis=0).tolist()[0] for face in mesh.faces]
    [0.5, 0.5]
    >>> mesh.faces[:1].uniform.tolist()
    [[0, 1, 2, 3]]
    """

    sizes: IntArray
    indices: IntArray

    __hash__ = None  # type: ignore[assignment]

    def __init__(self, sizes: IntArray, indices: IntArray) -> None:
        self.sizes, self.indices = sizes, indices
        self._ends = np.cumsum(sizes)

    @property
    def uniform(self) -> IntArray | None:
        """The (m, k) array of faces that have k corners each, or None where they differ."""
        alike = len(self.sizes) > 0 and bool((self.sizes == self.sizes[0]).all())
        return self.indices.reshape(len(self.sizes), -1) if alike else None

    def tolist(self) -> list[list[int]]:
        """The faces as lists of Python's integers."""
        if (uniform := self.uniform) is not None:
            found: list[list[int]] = uniform.tolist()
            return found
        indices, ends = self.indices.tolist(), self._ends.tolist()
        return [indices[start:end] for start, end in zip([0, *ends[:-1]], ends, strict=False)]

    def __len__(self) -> int:
        return len(self.sizes)

    def __iter__(self) -> Iterator[IntArray]:
        if (uniform := self.uniform) is not None:
            return iter(uniform)
        return iter(np.split(self.indices, self._ends[:-1]) if len(self) else [])

    @overload
    def __getitem__(self, key: int | np.integer[Any]) -> IntArray: ...
    @overload
    def __getitem__(self, key: slice | list[int] | NDArray[Any]) -> Faces: ...
    def __getitem__(self, key: Any) -> IntArray | Faces:
        if isinstance(key, (int, np.integer)):
            end = self._ends[key]
            return self.indices[end - self.sizes[key] : end]
        chosen = np.arange(len(self))[key]
        if chosen.ndim != 1:
            raise IndexError(f"faces have one axis: got an index of {chosen.ndim}")
        sizes, ends = self.sizes[chosen], self._ends[chosen]
        place = np.arange(sizes.sum()) + np.repeat(ends - np.cumsum(sizes), sizes)
        return Faces(sizes, self.indices[place])

    def __add__(self, shift: SupportsIndex) -> Faces:
        return Faces(self.sizes, self.indices + index(shift))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Faces):
            return NotImplemented
        pairs = (self.sizes, other.sizes), (self.indices, other.indices)
        return all(np.array_equal(one, two) for one, two in pairs)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        uniform = self.uniform
        if uniform is None:
            raise ValueError(
                f"{self!r}, of different sizes, are no (m, k) array: go through them one by "
                "one, or use sizes and indices, or uniform, which is None here"
            )
        return np.array(uniform, dtype, copy=True) if copy else np.asarray(uniform, dtype)

    def __repr__(self) -> str:
        return f"Faces({histogram(self.sizes)})"


def histogram(values: IntArray) -> str:
    """How often there is which value, such as ``{3: 1, 4: 12}``; of the first eight of many."""
    found, counts = np.unique(values, return_counts=True)
    text = ", ".join(
        f"{k}: {n}" for k, n in zip(found[:8].tolist(), counts[:8].tolist(), strict=True)
    )
    return f"{{{text}{', ...' if len(found) > 8 else ''}}}"


def equal_sizes(count: int, size: int) -> IntArray:
    """The sizes of so many faces of one size, read-only, in no memory of their own."""
    return np.broadcast_to(np.int64(size), count)
