"""How far a shape of a CAD system is from a limit surface, by closest points both ways."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from limitsurf import html
from limitsurf.cad import foreign
from limitsurf.cad.opencascade import failures
from limitsurf.cad.rational import jets
from limitsurf.cad.spline_faces import SplineFaces
from limitsurf.cage.checks import checked_integer
from limitsurf.integrals.checks import checked
from limitsurf.query.closest import closest_point
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_NEAREST = 24  # known places of a shape among which seeds are chosen, for each point
_EACH, _SEEDS = 2, 6  # seeds on one face, and in all
_STEPS = 40
_SETTLED = 1e-24  # of the squared size of a face's domain: a step that changes nothing
_BLOCK = 1 << 14  # points at a time
_MOST = 256  # places along a face that is much longer than others
_SHIFT = 1 / (2**0.5 * 1e3)  # keeps places off the lines where faces and trims like to end


@dataclass(frozen=True, eq=False, repr=False)
class Comparison:
    """Distances between a shape and a limit surface, made by `compare`.

    Attributes
    ----------
    from_shape : (k,) float64
        From places on the shape to the surface.
    shape_face, shape_u, shape_v : (k,)
        These places, in the parameters of `faces`.
    from_surface : (m,) float64
        From places on the surface to the shape.
    face, u, v : (m,)
        These places.
    faces : SplineFaces
        The shape.

    Examples
    --------
    >>> import limitsurf as ls
    >>> mesh = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> square = ls.LimitSurface(mesh)
    >>> ls.compare(square, ls.to_brep(square, solid=False)).largest < 1e-12
    True
    """

    from_shape: NDArray[np.float64]
    shape_face: NDArray[np.int64]
    shape_u: NDArray[np.float64]
    shape_v: NDArray[np.float64]
    from_surface: NDArray[np.float64]
    face: NDArray[np.int64]
    u: NDArray[np.float64]
    v: NDArray[np.float64]
    faces: SplineFaces

    @property
    def largest(self) -> float:
        """The largest distance found, either way: below the Hausdorff distance."""
        return float(max(self.from_shape.max(initial=0), self.from_surface.max(initial=0)))

    def __repr__(self) -> str:
        one, other = (float(x.max(initial=0)) for x in (self.from_shape, self.from_surface))
        text = f"at most {one:.3g} from shape to surface, {other:.3g} from surface to shape"
        return f"{type(self).__name__}({text}, at {len(self.u) + len(self.shape_u)} places)"

    def _repr_html_(self) -> str:
        columns = {name: getattr(self, name) for name in ("face", "u", "v", "from_surface")}
        return html.table(columns, repr(self))


def compare(
    surface: LimitSurface,
    shape: Any,
    *,
    n: int = 8,
    channel: str | None = None,
    workers: int = 1,
) -> Comparison:
    """How far a shape is from a limit surface, and the surface from the shape.

    Parameters
    ----------
    surface : LimitSurface
        Of float64 points (n_vertices, 3), in the unit of the shape.
    shape : SplineFaces, TopoDS_Shape, or what has one as ``wrapped``
        What `read_brep` or `to_brep` made, or any other shape.
    n : int
        Places in each direction: of each limit face n x n, and as many of each face of the shape
        for each of its spans, up to 32 x 32, or in proportion where a face is longer than others.
    channel : str, optional
        A face-varying channel of three columns instead of the points.
    workers : int
        Threads that search; answers do not depend on it.

    Returns
    -------
    Comparison

    Raises
    ------
    ValueError
        A shape without faces, points that are not in space.
    ImportError
        OpenCASCADE is not installed, and needed for a shape of its own.

    Notes
    -----
    From places of the shape to the limit surface distances are those of `closest_point`. The other
    way damped steps of Newton's method begin at a few of the nearest known places, on up to three
    faces or more: a distance may be too large where all end elsewhere, and beside open trimmed
    edges, where that of a known place counts. What is between places is not seen: this is a
    measurement, no bound.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> cube = ls.LimitSurface(ls.Mesh(points, quads))
    >>> found = ls.compare(cube, ls.to_brep(cube, depth=3), n=4)
    >>> 1e-6 < found.largest < 1e-2
    True
    """
    surface = checked(surface, "compare", channel)
    n = checked_integer("n", n, 1)
    faces = _faces_of(shape)
    where = _places(faces, n)
    points = faces.evaluate(*where)
    there = closest_point(surface, points, workers=workers)
    mine = _limit_places(surface, n)
    limit = surface.evaluate(*mine, workers=workers)
    return Comparison(
        np.asarray(there.distance), *where, _to_shape(faces, limit, where, points), *mine, faces
    )


def _faces_of(shape: Any) -> SplineFaces:
    """The faces of a shape."""
    if isinstance(shape, SplineFaces):
        return shape
    found = getattr(shape, "wrapped", shape)
    if not type(found).__name__.startswith("TopoDS_"):
        raise TypeError(
            f"compare needs SplineFaces (of read_brep) or a shape (of to_brep), got "
            f"{type(shape).__name__}; ls.deviation measures those of bspline_faces"
        )
    with failures("the shape"):
        known = foreign.contents(found)
    none = np.full((known["faces"], 3), np.nan)
    return SplineFaces.of(known, names=[""] * known["faces"], colors=none)


def _places(faces: SplineFaces, n: int) -> tuple[Array, Array, Array]:
    """Places on all faces, within their trims."""
    length = _lengths(faces)
    long = np.ceil(32 * length / max(float(np.median(length)), np.finfo(float).tiny))
    spans = np.clip((faces.counts - faces.degree) * n, n, np.clip(long, max(n, 32), _MOST))
    spans = spans.astype(np.int64)
    number = spans.prod(axis=1)
    face = np.repeat(np.arange(len(faces)), number)
    step = np.arange(len(face)) - np.repeat(np.cumsum(number) - number, number)
    i, j = np.divmod(step, spans[face, 1])
    share = (np.stack([i, j], axis=1) + 0.5 + _SHIFT) / spans[face]
    low, high = np.moveaxis(faces.domain[face], 2, 0)
    u, v = (low + share * (high - low)).T
    kept = faces.covers(face, u, v)
    return face[kept], u[kept], v[kept]


def _lengths(faces: SplineFaces) -> Array:
    """About how long faces (k, 2) are along u and v: between places that are evenly distributed."""
    share = (np.arange(5) + 0.5) / 5
    low, high = np.moveaxis(faces.domain, 2, 0)[..., None]
    at = low + share * (high - low)  # (k, 2, 5)
    points = faces.evaluate(np.arange(len(faces))[:, None, None], at[:, 0, :, None], at[:, 1, None])
    steps = (np.linalg.norm(np.diff(points, axis=axis), axis=-1) for axis in (1, 2))
    return np.stack(
        [x.sum(axis=axis).max(axis=1) for axis, x in zip((1, 2), steps, strict=True)], axis=1
    )


def _limit_places(surface: LimitSurface, n: int) -> tuple[Array, Array, Array]:
    """Places on all limit faces."""
    known = np.flatnonzero(surface.patches.with_limit)
    x = (np.arange(n) + 0.5) / n
    u, v = (a.ravel() for a in np.meshgrid(x, x, indexing="ij"))
    if surface.topology.lattice.sloped:
        u, v = np.where(u + v > 1, [1 - v, 1 - u], [u, v])
    face = np.repeat(known, len(u))
    return face, np.tile(u, len(known)), np.tile(v, len(known))


def _to_shape(
    faces: SplineFaces, points: Array, where: tuple[Array, Array, Array], known: Array
) -> Array:
    """Distances (Q,) of points from a shape of which some places are known."""
    if not len(known):
        return np.full(len(points), np.inf)
    tree = cKDTree(known)
    blocks = range(0, len(points), _BLOCK)
    found = [_distances(faces, points[start : start + _BLOCK], where, tree) for start in blocks]
    return np.concatenate(found)


def _distances(
    faces: SplineFaces, points: Array, where: tuple[Array, Array, Array], tree: cKDTree
) -> Array:
    """Those of a block of points (Q, 3)."""
    count = min(_NEAREST, tree.n)
    near, seed = tree.query(points, k=count)
    near, seed = near.reshape(len(points), count), seed.reshape(len(points), count)
    owner, rank = np.nonzero(_chosen(where[0][seed]))
    face, u, v = (x[seed[owner, rank]] for x in where)
    u, v = _feet(faces, face, u, v, points[owner])
    far = np.linalg.norm(jets(faces, face, u, v, 0)[0, 0] - points[owner], axis=1)
    trimmed = np.flatnonzero(~faces.untrimmed[face])
    outside = trimmed[~faces.covers(face[trimmed], u[trimmed], v[trimmed])]
    far[outside] = np.inf
    best = near.min(axis=1)
    np.minimum.at(best, owner, far)
    return np.asarray(best)


def _chosen(face: Array) -> Array:
    """Which of places on faces (Q, k), nearest first, to begin at: a few, of several faces."""
    same = face[:, :, None] == face[:, None, :]
    before = np.tril(same, -1).sum(axis=2)
    kept = before < _EACH
    return np.asarray(kept & (kept.cumsum(axis=1) <= _SEEDS))


def _feet(
    faces: SplineFaces, face: Array, u: Array, v: Array, points: Array
) -> tuple[Array, Array]:
    """Where places end that move within their faces towards points (Q, 3), never farther away.

    Steps that lead away are tried again, damped after Levenberg and Marquardt.
    """
    u, v = u.copy(), v.copy()
    damping = np.zeros(len(u))
    box = faces.domain[face]
    small = _SETTLED * ((box[:, :, 1] - box[:, :, 0]) ** 2).sum(axis=1)
    which = np.arange(len(u))
    for _ in range(_STEPS):
        jet = jets(faces, face[which], u[which], v[which], 2)
        gap = points[which] - jet[0, 0]
        new = _step(jet, gap, u[which], v[which], box[which], damping[which])
        far = points[which] - jets(faces, face[which], *new, 0)[0, 0]
        nearer = (far**2).sum(axis=1) <= (gap**2).sum(axis=1)
        moved = (new[0] - u[which]) ** 2 + (new[1] - v[which]) ** 2 > small[which]
        on = which[nearer]
        u[on], v[on] = new[0][nearer], new[1][nearer]
        more = damping[which]
        damping[which] = np.where(
            nearer, np.where(more > 0.1, more / 8, 0), np.maximum(1, 4 * more)
        )
        which = which[moved]
        if not len(which):
            break
    return u, v


def _step(
    jet: dict[tuple[int, int], Array], gap: Array, u: Array, v: Array, box: Array, damping: Array
) -> tuple[Array, Array]:
    """Places within a face after one step of Newton's method, or else of Gauss's."""
    a, b = jet[1, 0], jet[0, 1]
    aa, ab, bb = ((x * y).sum(axis=1) for x, y in ((a, a), (a, b), (b, b)))
    ag, bg = (a * gap).sum(axis=1), (b * gap).sum(axis=1)
    bent = [(jet[nu] * gap).sum(axis=1) for nu in ((2, 0), (1, 1), (0, 2))]
    p, q, r = aa - bent[0], ab - bent[1], bb - bent[2]
    convex = (p > 0) & (r > 0) & (p * r - q * q > 1e-6 * aa * bb)
    p, q, r = (np.where(convex, *both) for both in ((p, aa), (q, ab), (r, bb)))
    p, r = p + damping * aa, r + damping * bb
    # on a side that it would leave, a place moves along it
    at = np.stack([u, v], axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        det = p * r - q * q
        both = np.stack([(r * ag - q * bg) / det, (p * bg - q * ag) / det], axis=1)
        alone = np.stack([ag / p, bg / r], axis=1)
    new = at + np.nan_to_num(both, posinf=0, neginf=0)
    leaves = ((at <= box[:, :, 0]) & (new < box[:, :, 0])) | (
        (at >= box[:, :, 1]) & (new > box[:, :, 1])
    )
    along = at + np.where(leaves, 0, np.nan_to_num(alone, posinf=0, neginf=0))
    new = np.where(leaves.any(axis=1)[:, None], along, new)
    new = np.clip(new, box[:, :, 0], box[:, :, 1])
    return new[:, 0], new[:, 1]
