"""Samples of a surface: places drawn by chance, by area, by parameters or apart from each other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from limitsurf import html, memory
from limitsurf.cage.checks import checked_integer
from limitsurf.engine.protocol import threads
from limitsurf.patches import NO_LIMIT
from limitsurf.query.density import AreaDensity, Places
from limitsurf.query.index import Cells, checked_surface
from limitsurf.surface import LimitSurface

Array = NDArray[Any]
Method: TypeAlias = Literal["area", "parameter", "blue_noise"]

METHODS: tuple[str, ...] = get_args(Method)
_MORE = 5  # samples by area of which those of blue noise are chosen, to each
_ALPHA, _BETA, _GAMMA = 8, 0.65, 1.5  # of Yuksel's weights


@dataclass(frozen=True, eq=False, repr=False)
class Samples:
    """Places of a surface drawn by chance, made by `sample`.

    Attributes
    ----------
    point : (n, 3) float64
        ``surface.evaluate(face, u, v)``.
    normal : (n, 3)
        ``surface.normal(face, u, v)``.
    face : (n,) int64
        Limit faces.
    u, v : (n,) float64
    spacing : float or None
        Of blue noise: the smallest distance between any two points, measured; inf of fewer than
        two. None for other methods.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> ls.sample(ls.LimitSurface(square), 100, rng=1)
    Samples(100 samples)
    """

    point: Array
    normal: Array
    face: Array
    u: Array
    v: Array
    spacing: float | None = None

    def __len__(self) -> int:
        return len(self.face)

    def _repr_html_(self) -> str:
        names = ("face", "u", "v", "point", "normal")
        return html.table({name: getattr(self, name) for name in names}, repr(self))

    def __repr__(self) -> str:
        n = len(self)
        apart = "" if self.spacing is None else f", at least {self.spacing:.4g} apart"
        return f"{type(self).__name__}({n} sample{'s' * (n != 1)}{apart})"


def sample(
    surface: LimitSurface,
    n: int,
    *,
    method: Method = "area",
    rng: Any = None,
    channel: str | None = None,
    workers: int = 1,
) -> Samples:
    """Random places of a surface: evenly by its area, by parameters, or at distances.

    Parameters
    ----------
    surface : LimitSurface
        Of float64 points, (n_vertices, 3).
    n : int
        How many.
    method : {"area", "parameter", "blue_noise"}
        * "area": independent samples; each part of the surface gets its share by true area,
          whatever the parametrization, also around special corners.
        * "parameter": independent samples, each on any limit face with equal probability, and
          there evenly in (u, v); in triangles, where u + v <= 1.
        * "blue_noise": samples by area that keep a distance from each other, without a pattern.
    rng : None, int, Generator, BitGenerator, SeedSequence or RandomState, optional
        What ``numpy.random.default_rng`` takes. With the same int samples are the same, whatever
        `workers`; with a Generator each call draws on from where it is; with None they differ.
    channel : str, optional
        A face-varying channel of three columns, to take samples of instead of the points.
    workers : int
        Threads, as for `LimitSurface.evaluate`.

    Returns
    -------
    Samples
        In no order: the first k of "area" and "parameter" are samples as well.

    Raises
    ------
    TypeError
        For a surface of exact points, and for what is no source of random numbers.
    ValueError
        For `n` that is no integer >= 0, an unknown method, a surface without area (or, by
        parameter, without limit faces), points that are not (n_vertices, 3) or not finite.
    MemoryError
        At once, for more than there is memory for.

    Notes
    -----
    By area, the surface is cut into the cells of `SurfaceIndex`; around special corners all rings
    are drawn from. Places are drawn evenly in parameters and kept with a probability, that of a
    density by a proved bound of it. So the density is that of area but for rounding: of
    derivatives by some 1e-16 of the largest coordinate, and what has less than 1e-15 of the area is
    not drawn from as often as it should be. Derived in ``derivations/samples.py``. The
    first call for a surface makes its `SurfaceIndex`; cages that are far from the origin lose as
    many digits of area as they do of size.

    Blue noise is by weighted sample elimination (Yuksel, "Sample elimination for generating Poisson
    disk sample sets", Computer Graphics Forum 2015), from 5 n samples by area. Distances are those
    in space, not along the surface: where two sheets are near each other, they share samples. The
    points are some 0.7 of as far apart as any n could be on a plane of the same area; `spacing`
    says how far.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> surface = ls.LimitSurface(square)
    >>> found = ls.sample(surface, 1000, rng=7)
    >>> found.point.shape, abs(found.normal[0]).tolist()
    ((1000, 3), [0.0, 0.0, 1.0])
    >>> ls.sample(surface, 50, method="blue_noise", rng=7).spacing > 0.08
    True
    """
    surface, count = checked_surface(surface, channel), threads(workers)
    n = checked_integer("n", n, 0)
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    random = _generator(rng)
    each = 400 * (_MORE if method == "blue_noise" else 1)
    memory.refuse_beyond(n, each, "samples", "ask for fewer")
    if not n:
        nothing = np.zeros(0)
        places = Places(np.zeros(0, dtype=np.int64), nothing, nothing)
    elif method == "parameter":
        places = _by_parameter(surface, n, random)
    else:
        density = AreaDensity.of(Cells.of(surface, count), count)
        places = density.draw(n * (1 if method == "area" else _MORE), random, count)
        if method == "blue_noise":
            scaled = np.ldexp(surface.evaluate(*places, workers=workers), density.cells.power)
            kept = _apart(scaled, n, density.area)
            places = Places(*(x[kept] for x in places))
    point = surface.evaluate(*places, workers=workers).reshape(-1, 3)
    normal = surface.normal(*places, workers=workers).reshape(-1, 3)
    return Samples(point, normal, *places, _spacing(point) if method == "blue_noise" else None)


def _generator(rng: Any) -> np.random.Generator:
    """A source of random numbers, of whatever NumPy makes one of."""
    try:
        return np.random.default_rng(rng)
    except (TypeError, ValueError) as error:
        raise type(error)(
            f"rng must be None, an integer >= 0 or a numpy.random.Generator, got {rng!r}"
        ) from None


def _by_parameter(surface: LimitSurface, n: int, rng: np.random.Generator) -> Places:
    """Places that are even in limit faces and their parameters."""
    faces = np.flatnonzero(surface.patches.codes[: len(surface.limit_faces)] != NO_LIMIT)
    if not len(faces):
        raise ValueError("there is no limit face to take samples of")
    face, (u, v) = faces[rng.integers(len(faces), size=n)], rng.random((2, n))
    if surface.topology.lattice.sloped:
        u, v = np.where(u + v > 1, [1 - u, 1 - v], [u, v])
    return Places(face, u, v)


def _apart(points: Array, n: int, area: float) -> Array:
    """Which of some points (m, 3) to keep, (n,): the others are too near to more of them.

    Whoever has the largest sum of weights of neighbours goes first. A point whose sum is larger
    than those of all its neighbours goes before them whatever happens elsewhere, as sums only fall:
    so all such points of a certain size go at once, and what the sum of each was says who would
    have gone first.
    """
    from scipy.spatial import cKDTree

    most = np.sqrt(area / (2 * np.sqrt(3) * n))
    least = most * (1 - (n / len(points)) ** _GAMMA) * _BETA
    tree = cKDTree(points)
    near = int(tree.count_neighbors(tree, 2 * most))
    memory.refuse_beyond(near, 60, "pairs of neighbours", "ask for fewer samples")
    pairs = tree.query_pairs(2 * most, output_type="ndarray")
    far = np.sqrt(((points[pairs[:, 0]] - points[pairs[:, 1]]) ** 2).sum(axis=1))
    weight = (1 - np.clip(far, 2 * least, 2 * most) / (2 * most)) ** _ALPHA
    one = np.concatenate([pairs[:, 0], pairs[:, 1]])
    order = np.argsort(one, kind="stable")
    other = np.concatenate([pairs[:, 1], pairs[:, 0]])[order]
    weight = np.concatenate([weight, weight])[order]
    start = np.searchsorted(one[order], np.arange(len(points) + 1))
    total = np.bincount(one[order], weight, len(points))
    left, gone = len(points) - n, np.full(len(points), -1.0)
    alive = np.ones(len(points), dtype=bool)
    while alive.any():
        largest = total[alive].max()
        if (gone >= largest).sum() >= left or largest <= 0:
            break
        which = np.flatnonzero(alive & (total >= 0.9 * largest))
        owner, entry = _runs(start, which)
        own, beside = which[owner], other[entry]
        ahead = total[beside] > total[own]
        ahead |= (total[beside] == total[own]) & (beside < own)
        ahead &= alive[beside]
        first = np.ones(len(which), dtype=bool)
        first[owner[ahead]] = False
        removed = which[first]
        gone[removed], alive[removed] = total[removed], False
        _, entry = _runs(start, removed)
        np.subtract.at(total, other[entry], weight[entry])
    order = np.lexsort((np.arange(len(points)), -gone))
    return np.sort(order[left:])


def _runs(start: Array, which: Array) -> tuple[Array, Array]:
    """Entries of some rows: of which of them, and where they are."""
    count = start[which + 1] - start[which]
    owner = np.repeat(np.arange(len(which)), count)
    step = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    return owner, start[which][owner] + step


def _spacing(points: Array) -> float:
    """The smallest distance between any two points (n, 3)."""
    from scipy.spatial import cKDTree

    if len(points) < 2:
        return float(np.inf)
    power = int(np.frexp(np.abs(points).max())[1])
    scaled = np.ldexp(points, -power)
    distance, _ = cKDTree(scaled).query(scaled, k=2)
    return float(np.ldexp(distance[:, 1].min(), power))
