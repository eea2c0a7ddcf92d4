"""Faces of CAD files as splines with trims, evaluated as limit surfaces are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf import html
from limitsurf.caching import cached_property
from limitsurf.cad.cages import cage_of
from limitsurf.cad.rational import along_curves, jets
from limitsurf.cage.checks import checked_integer
from limitsurf.cage.mesh import Mesh
from limitsurf.engine.orders import checked_orders

Array = NDArray[Any]

_FINE = 24  # pieces that a span of a trim is cut into, to ask what is within
_PAIRS = 1 << 22  # of places and pieces, at once


@dataclass(frozen=True, eq=False)
class Trims:
    """Curves in the planes of (u, v) that bound faces: one row for each use of an edge.

    Attributes
    ----------
    face : (C,) int64
        Rows are ordered by face, then loop, then around it.
    loop : (C,) int64
        0 is the outer loop of a face.
    edge : (C,) int64
        Edges that several faces share have one number.
    forward : (C,) bool
        Whether the loop goes along the curve.
    degree, counts : (C,) int64
    knots, points, weights : (k,), (m, 2), (m,) float64
        Of all curves, one after the other.

    Examples
    --------
    >>> import limitsurf as ls
    >>> ls.read_brep("part.step").trims.edge.max()  # doctest: +SKIP
    399
    """

    face: NDArray[np.int64]
    loop: NDArray[np.int64]
    edge: NDArray[np.int64]
    forward: NDArray[np.bool_]
    degree: NDArray[np.int64]
    counts: NDArray[np.int64]
    knots: NDArray[np.float64]
    points: NDArray[np.float64]
    weights: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.face)

    def evaluate(self, share: ArrayLike) -> NDArray[np.float64]:
        """Places (C, k, 2) on all curves, at shares (k,) of the way along each, in [0, 1]."""
        return along_curves(
            self.degree, self.counts, self.knots, self.points, self.weights,
            np.asarray(share, dtype=float),
        )  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class SplineFaces:
    """Faces of a CAD file or shape as rational splines, made by `read_brep`.

    Attributes
    ----------
    degree, counts : (n, 2) int64
        Degree, and number of control points, along u and along v.
    knots_u, knots_v : (k,) float64
        Face after face; face k has ``counts[k, 0] + degree[k, 0] + 1`` along u.
    points : (m, 3) float64
        Control points, face after face; those along v follow each other.
    weights : (m,) float64
        1 where faces are not rational.
    domain : (n, 2, 2) float64
        Least and largest u, then v, of the part of its surface that a face is.
    untrimmed : (n,) bool
        Whether it is all of that rectangle.
    trims : Trims
        The curves that bound it.
    reversed : (n,) bool
        Whether outside is against d/du x d/dv.
    solid, shell : (n,) int64
        Numbers of the solid and the shell that each face is in, -1 if there is none.
    names : tuple of str
        "" where there is none.
    colors : (n, 3) float64
        Red, green and blue in [0, 1], sRGB; NaN where there are none.
    units : float
        Metres that one unit of the points is.

    Examples
    --------
    >>> import limitsurf as ls, pathlib, tempfile
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> cube = ls.LimitSurface(ls.Mesh(points, quads))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "cube.brep")
    ...     ls.write(path, cube, depth=4)
    ...     faces = ls.read_brep(path)
    >>> faces, faces.names[:2]
    (SplineFaces(6 faces, 6 untrimmed, 1 solid), ('', ''))
    >>> faces.evaluate(0, 0.5, 0.5).shape
    (3,)
    """

    degree: NDArray[np.int64]
    counts: NDArray[np.int64]
    knots_u: NDArray[np.float64]
    knots_v: NDArray[np.float64]
    points: NDArray[np.float64]
    weights: NDArray[np.float64]
    domain: NDArray[np.float64]
    untrimmed: NDArray[np.bool_]
    trims: Trims
    reversed: NDArray[np.bool_]
    solid: NDArray[np.int64]
    shell: NDArray[np.int64]
    names: tuple[str, ...]
    colors: NDArray[np.float64]
    units: float = field(default=1e-3)

    @classmethod
    def of(
        cls, found: dict[str, Any], *, names: Sequence[str], colors: Array, unit: float = 1.0
    ) -> SplineFaces:
        """Of arrays that `foreign.contents` has, in units of so many millimetres."""
        known = {name: value for name, value in found.items() if name != "faces"}
        trims = {name[5:]: known.pop(name) for name in [*known] if name.startswith("trim_")}
        points = known.pop("points") / unit
        rest: dict[str, Any] = {"names": tuple(names), "colors": colors, "units": unit * 1e-3}
        return cls(**known, points=points, trims=Trims(**trims), **rest)

    def __len__(self) -> int:
        return len(self.counts)

    def __repr__(self) -> str:
        n, solids = len(self), int(self.solid.max(initial=-1)) + 1
        text = f"{n} face{'s' * (n != 1)}, {int(self.untrimmed.sum())} untrimmed"
        return f"{type(self).__name__}({text}, {solids} solid{'s' * (solids != 1)})"

    def _repr_html_(self) -> str:
        columns = {name: getattr(self, name) for name in ("degree", "counts", "untrimmed", "solid")}
        return html.table({"face": np.arange(len(self)), **columns}, repr(self))

    @cached_property
    def firsts(self) -> tuple[Array, Array, Array]:
        """Where knots along u, along v, and control points of each face begin."""
        length = self.counts + self.degree + 1
        sizes = self.counts.prod(axis=1)
        before = np.cumsum(length, axis=0) - length
        return before[:, 0], before[:, 1], np.cumsum(sizes) - sizes

    def evaluate(self, face: ArrayLike, u: ArrayLike, v: ArrayLike, *, nu: Any = (0, 0)) -> Any:
        """Points (..., 3) of faces at (u, v), or their derivatives; arguments broadcast.

        Parameters
        ----------
        face : array_like of int
        u, v : array_like
            In the parameters of the file, within the knots of each face; whether a place is within
            the trims, `covers` tells. NaN gives NaN.
        nu : (int, int), or a sequence of these
            How often to differentiate along u and along v.

        Raises
        ------
        IndexError
            A face that does not exist.
        TypeError
            Faces that are not integers.
        ValueError
            Parameters out of range.

        Examples
        --------
        >>> import limitsurf as ls
        >>> faces = ls.read_brep("part.step")  # doctest: +SKIP
        >>> faces.evaluate(0, 0.25, [0.5, 0.75], nu=(1, 0)).shape  # doctest: +SKIP
        (2, 3)
        """
        several, orders = checked_orders(nu)
        shape, which, x, y = self._places(face, u, v)
        found = jets(self, which, x, y, max(map(sum, orders), default=0))
        values = [found[order].reshape(*shape, 3) for order in orders]
        return values if several else values[0]

    def jet(
        self, face: ArrayLike, u: ArrayLike, v: ArrayLike, *, order: int = 2
    ) -> dict[tuple[int, int], Array]:
        """All derivatives up to a total order as {(i, j): (..., 3)}; arguments as of `evaluate`."""
        shape, which, x, y = self._places(face, u, v)
        found = jets(self, which, x, y, checked_integer("order", order, 0))
        return {nu: value.reshape(*shape, 3) for nu, value in found.items()}

    def normal(self, face: ArrayLike, u: ArrayLike, v: ArrayLike) -> Array:
        """Unit normals (..., 3), outwards; NaN where derivatives are dependent."""
        shape, which, x, y = self._places(face, u, v)
        found = jets(self, which, x, y, 1)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            du, dv = (d / np.abs(d).max(axis=1, keepdims=True) for d in (found[1, 0], found[0, 1]))
            cross = np.cross(du, dv)
            cross /= np.linalg.norm(cross, axis=1)[:, None]
        cross[self.reversed[which]] *= -1
        return np.asarray(cross.reshape(*shape, 3))

    def covers(self, face: ArrayLike, u: ArrayLike, v: ArrayLike) -> NDArray[np.bool_]:
        """Whether places are within the trims of their faces.

        Each span of a trimming curve counts as 24 chords: beside one it may be wrong.

        Examples
        --------
        >>> import limitsurf as ls
        >>> ls.read_brep("part.step").covers(0, 0.5, 0.5)  # doctest: +SKIP
        True
        """
        shape, which, x, y = self._places(face, u, v)
        box = self.domain[which]
        at = np.stack([x, y], axis=1)
        found = np.asarray(((at >= box[:, :, 0]) & (at <= box[:, :, 1])).all(axis=1))
        some = np.flatnonzero(found & ~self.untrimmed[which])
        if len(some):
            found[some] = self._odd(which[some], at[some])
        return found.reshape(shape)

    @cached_property
    def _chords(self) -> tuple[Array, Array, Array]:
        """Ends (k, 2) of pieces of all trims, and where those of each face begin (n + 1,)."""
        trims = self.trims
        most = int((trims.counts - trims.degree).max(initial=1))
        places = trims.evaluate(np.linspace(0, 1, _FINE * most + 1))
        each = places.shape[1] - 1
        count = np.bincount(trims.face, minlength=len(self)) * each
        ends = places[:, :-1].reshape(-1, 2), places[:, 1:].reshape(-1, 2)
        return (*ends, np.concatenate([[0], np.cumsum(count)]))

    def _odd(self, face: Array, at: Array) -> Array:
        """Whether a ray along u crosses trims an odd number of times."""
        a, b, first = self._chords
        found = np.zeros(len(face), dtype=bool)
        count = first[face + 1] - first[face]
        ends = np.searchsorted(np.cumsum(count), np.arange(0, int(count.sum()) + 1, _PAIRS))
        for start, stop in zip(ends, [*ends[1:], len(face)], strict=True):
            some = np.arange(start, stop)
            owner = np.repeat(some, count[some])
            own = count[some]
            step = np.arange(len(owner)) - np.repeat(np.cumsum(own) - own, own)
            one, two = (x[first[face[owner]] + step] for x in (a, b))
            u, v = at[owner].T
            across = (one[:, 1] > v) != (two[:, 1] > v)
            with np.errstate(invalid="ignore", divide="ignore"):
                where = one[:, 0] + (v - one[:, 1]) * (two - one)[:, 0] / (two - one)[:, 1]
            hits = np.bincount(owner[across & (where > u)], minlength=len(face))
            found |= hits % 2 == 1
        return found

    def to_mesh(self) -> Mesh:
        """The cage of faces that are regular parts of a Catmull-Clark surface.

        Each face must be a bicubic polynomial spline of uniform knots, with no trims but its
        border: what `bspline_faces` makes of limit faces that are exact. Faces that were merged are
        cut again. Where faces meet with a sharp edge it is a crease.

        Returns
        -------
        Mesh
            Quadrilaterals in the order of faces, those of one along v, then u, in the unit of
            `units`. Its limit surface is what the file has, within 1e-9 of the size.

        Raises
        ------
        ValueError
            A face that has trims, weights, another degree, or knots that are not uniform, as next
            to extraordinary vertices; faces that are no limit surface together. The first one is
            named.

        Examples
        --------
        >>> import limitsurf as ls, pathlib, tempfile
        >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = pathlib.Path(folder, "square.step")
        ...     ls.write(path, ls.LimitSurface(square), solid=False)
        ...     ls.read_brep(path).to_mesh().points.round(12).tolist()
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]
        """
        return cage_of(self)

    def _places(self, face: Any, u: Any, v: Any) -> tuple[Any, Array, Array, Array]:
        """The shape of an answer, and faces and parameters (Q,), checked."""
        which, x, y = np.broadcast_arrays(face, np.asarray(u, float), np.asarray(v, float))
        if which.dtype.kind not in "iu":
            raise TypeError(f"faces must be integers, got {which.dtype}")
        shape, n = which.shape, len(self)
        which, x, y = which.ravel().astype(np.int64), x.ravel(), y.ravel()
        bad = np.flatnonzero((which < 0) | (which >= n))
        if len(bad):
            raise IndexError(f"face {which[bad[0]]} is out of range of {n} faces")
        for axis, (name, at, knots) in enumerate((("u", x, self.knots_u), ("v", y, self.knots_v))):
            first = self.firsts[axis] + self.degree[:, axis]
            low, high = knots[first][which], knots[first + _spans(self, axis)][which]
            bad = np.flatnonzero((at < low) | (at > high))
            if len(bad):
                k = bad[0]
                text = f"[{low[k]}, {high[k]}] of face {which[k]}"
                raise ValueError(f"{name} = {at[k]} is not in {text}")
        return shape, which, x, y


def _spans(faces: SplineFaces, axis: int) -> Array:
    """From the first knot of a domain to its last one, (n,)."""
    return faces.counts[:, axis] - faces.degree[:, axis]
