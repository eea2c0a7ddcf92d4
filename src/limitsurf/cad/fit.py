"""Cages fitted to points, or to another surface, by least squares of distances."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf import html
from limitsurf.cad.fairness import Energy, checked_energy, refuse_rough
from limitsurf.cad.fairness import fairness as energy_of
from limitsurf.cad.feet import Feet, SharpEdges
from limitsurf.cad.levenberg import LOSSES, Loss, Problem, Steps
from limitsurf.cad.parts import Parts
from limitsurf.cad.targets import KINDS, Target
from limitsurf.cage.checks import checked_integer, checked_number, users_level
from limitsurf.cage.mesh import Mesh
from limitsurf.engine.protocol import threads
from limitsurf.fem.checks import reals
from limitsurf.fem.places import vertex_places
from limitsurf.query.index import checked_surface
from limitsurf.surface import LimitSurface

Array = NDArray[Any]
Refine: TypeAlias = Literal["auto"]

_TOLERANCE = 1e-4  # that nobody chose, of the longest side of the box of the points
_LEVELS = 6  # of refinement, at most
_GAIN = 0.8  # what a refinement must make of the error of a part to be followed by another
_FAR = 20  # sizes, of the larger one, between the boxes of cage and points, that make no sense
_SUPPORTED = 1e-12  # of the largest sum of squared weights: vertices with less are not seen
_LARGEST = 1e300
_THIN = 1e-12  # of its length, the width of a cage that is a line
_SMOOTHING = 1e-6  # where points do not determine the cage


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """A cage fitted to points, made by `fit`.

    Attributes
    ----------
    mesh : Mesh
        The cage: faces, creases, tags, channels and data of the one that was given, or of its
        refinement.
    surface : LimitSurface
        Of this cage.
    history : (steps + 1,) float64
        Root of the mean square of the distances, as weights and loss count them, at the start and
        after each step; while creases go to sharp edges that were detected, with places on these.
    levels : (steps + 1,) int64
        How often the cage had been refined by then, at most.
    error : (n,) float64
        Distance of each point; NaN of points that are not finite.
    face : (n,) int64
        Limit faces of the nearest places; -1 of points that are not finite.
    u, v : (n,) float64
    point : (n, 3) float64
        The points that were fitted: those given, or samples of the surface that was.
    converged : bool
        Whether it ended since nothing was to be gained, or the error was within the tolerance.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> points = ls.sample(ls.LimitSurface(square), 50, rng=1).point
    >>> ls.fit(square, points + [0, 0, 1], tolerance=1e-9)
    Fit(50 points, rms 1 -> ... in 2 steps, converged)
    """

    mesh: Mesh
    surface: LimitSurface
    history: Array
    levels: Array
    error: Array
    face: Array
    u: Array
    v: Array
    point: Array
    converged: bool

    @property
    def rms(self) -> float:
        """The last of `history`."""
        return float(self.history[-1])

    def _repr_html_(self) -> str:
        names = ("face", "u", "v", "error", "point")
        return html.table({name: getattr(self, name) for name in names}, repr(self))

    def __repr__(self) -> str:
        n, steps = len(self.error), len(self.history) - 1
        start, end = (float(f"{self.history[k]:.3g}") for k in (0, -1))
        how = "converged" if self.converged else "not converged"
        said = f"rms {start:g} -> {end:g} in {steps} step{'s' * (steps != 1)}"
        return f"{type(self).__name__}({n} point{'s' * (n != 1)}, {said}, {how})"


def fit(
    mesh: Mesh | LimitSurface,
    points: ArrayLike | Mesh | LimitSurface,
    *,
    normals: ArrayLike | None = None,
    weights: ArrayLike | None = None,
    edges: ArrayLike | str | None = "auto",
    corners: Mapping[int, ArrayLike] | None = None,
    fixed: ArrayLike | None = None,
    fairness: Energy | None = None,
    smoothing: float | None = None,
    loss: Loss = "linear",
    scale: float | None = None,
    tolerance: float | None = None,
    refine: Refine | None = None,
    max_iterations: int = 50,
    rng: Any = 0,
    workers: int = 1,
) -> Fit:
    """Move the vertices of a cage so that its limit surface is near points.

    Parameters
    ----------
    mesh : Mesh or LimitSurface
        Where to start: a cage with points (n_vertices, 3) whose surface has the shape roughly. Its
        faces, creases, other tags, channels and data are kept.
    points : (n, 3) array_like, Mesh or LimitSurface
        A scan; or another surface (that of a Mesh is its limit surface), of which 20,000 samples
        are taken evenly by area, and its boundaries and sharp creases. Points that are not finite
        are left out.
    normals : (n, 3) array_like, optional
        Of the points, of any length, to the outside. The nearest place of a point is then one with
        a normal at most 90 degrees away, as on its own side of a thin wall, within a quarter of the
        size; a point that has none does not count. Rows of zeros or NaN say nothing.
    weights : (n,) array_like, optional
        How much squared distances count, >= 0; only their ratios matter.
    edges : "auto", "detect", (n,) array_like or None
        Points that lie on a boundary or a sharp crease, whose distances are those from such edges
        of the surface: an array of truth values, or of "", "boundary" and "crease", which then go
        to their like. "auto" knows them where `points` are a surface, and has none among points
        alone. "detect" takes points for boundary ones that have no neighbour in 160 degrees of the
        plane through their 24 nearest ones, which puts the boundary some quarter of the spacing of
        the points too far inward.
        Sharp edges are found, too, where the cage has sharp creases: where normals of neighbours
        are 30 degrees apart or more, or, if they are not given but estimated, 45, the planes of
        both sides meet in one. Creases go there first, and from there on only the points count.
        None has none. Without them boundaries follow points that lie
        beyond them, but do not shrink to points that end before; creases come to be where what
        lies on both sides of them meets.
    corners : mapping {vertex: (3,)}, optional
        Where the surface is to be at vertices of the cage; together they count as all points do.
    fixed : (n_vertices,) bool or sequence of int, optional
        Vertices that do not move; not together with `refine`.
    fairness : {"thin_plate", "membrane", "variation"}, optional
        The energy that a surface without bumps has little of (`ls.fairness`); by default the first
        of these that is finite.
    smoothing : float, optional
        What is added to the mean of squared distances: so many times the energy, as a mean over
        the limit faces. It has no unit: 1e-4 smooths visibly, 1e-8 fills holes. By default 0;
        where points are too few or too one-sided to say where all vertices are, with a warning,
        1e-6, or the mean of squared distances, of the size, if that is less: it vanishes with the
        error.
    loss : {"linear", "huber", "soft_l1", "cauchy"}
        How squares of distances d count: as they are; or, with z = (d / scale)^2, as z up to 1 and
        2 sqrt(z) - 1 beyond; 2 (sqrt(1 + z) - 1); log(1 + z). So few points that are far off have
        less or no influence.
    scale : float, optional
        The distance from which on a loss counts less: some standard deviations of the noise. By
        default 1.48 times the median of the distances, taken anew at each step.
    tolerance : float, optional
        An error, as in `history`, that is small enough to stop, in units of the points. By default
        steps go on until nothing is gained; with `refine`, 1e-4 of the longest side of the box
        around the points.
    refine : "auto", optional
        Parts of the cage that hang together and whose error is above the tolerance are refined
        once, and fitted again, until it is not, or refinement takes less than a fifth off the
        error, or there would be less than one point for each number that is sought. A part is
        refined as a whole: a face split by itself would leave n-gons around it, each with a pole of
        its own, and another surface than before.
    max_iterations : int
        Steps, at most, for each cage, and as many before in which creases go to detected edges;
        where they were not enough, `converged` is False.
    rng : None, int, Generator, ...
        Chance, for samples of a surface, as in `sample`.
    workers : int
        Threads, as for `LimitSurface.evaluate`.

    Returns
    -------
    Fit

    Raises
    ------
    TypeError
        For what is no cage, exact points, points and weights that are no real numbers.
    ValueError
        For arrays of other shapes, no point or none that is finite, negative weights, vertices that
        do not exist, unknown options, edges that the cage has not, a surface without limit faces,
        normals that all point to the other side;
        for points that are more than 20 sizes away from the cage, in which case units or axes
        differ; for a cage whose vertices are all on one line.

    Warns
    -----
    UserWarning
        Where the points do not determine the cage: too few, none at some vertices, or such that
        vertices run away, more than eight times as far from the middle of the points as these and
        those of the given cage. Then the fit begins anew with a smoothing of 1e-6.

    Notes
    -----
    Steps are those of Gauss and Newton for distances of the points from their nearest places, with
    Levenberg's damping (a step that makes the error larger is not taken), each followed by a second
    one for what it bends away. Squared distances are expanded to second order, less what would make
    them negative: as squared distances from tangent planes, and, far from the end, where the
    surface is curved away from a point, along it as well (Wang, Pottmann and Liu, "Fitting B-spline
    curves to point clouds by curvature-based squared distance minimization", ACM Transactions on
    Graphics 2006; derived in ``derivations/fitting.py``). From points of a surface of the same cage
    steps converge quadratically, to rounding, where the cage begins near enough: within a part of
    its shorter edges, and of the distance between sheets of the surface. Farther away ripples can
    slide onto their neighbours, where no step makes the error less. Nearest places are followed by
    Newton's method, and sought on the whole surface every eighth step and at the end.

    A cage is not always determined by its surface: on a flat part vertices can move in its plane,
    and where opposite moves of neighbours leave it as it is (on a cube, by Catmull and Clark's
    scheme). Damping leaves them near where they started.

    Examples
    --------
    >>> import numpy as np
    >>> import limitsurf as ls
    >>> corners = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> scan = ls.sample(ls.LimitSurface(ls.Mesh(corners, quads)), 500, rng=1).point
    >>> start = ls.Mesh(np.multiply(corners, [1.2, 0.9, 1.1]), quads)
    >>> found = ls.fit(start, scan)
    >>> bool(found.error.max() < 1e-12)
    True
    """
    surface = _checked_cage(mesh)
    target = Target.of(points, normals, weights, edges, rng)
    options = _Options.of(
        surface, target, corners, fixed, fairness, smoothing, loss, scale, tolerance, refine,
        max_iterations, threads(workers),
    )  # fmt: skip
    return _run(surface, target, options)


def _checked_cage(given: Any) -> LimitSurface:
    """The surface of a cage that can be fitted."""
    if not isinstance(given, (Mesh, LimitSurface)):
        raise TypeError(f"mesh must be a Mesh or a LimitSurface, got {type(given).__name__}")
    surface = checked_surface(LimitSurface(given) if isinstance(given, Mesh) else given)
    if not surface.patches.with_limit[: len(surface.limit_faces)].any():
        raise ValueError("the cage has no face with a limit: there is nothing to fit")
    return surface


@dataclass(frozen=True)
class _Options:
    """What a fit is asked for, checked; lengths are in units of the points."""

    corners: tuple[Array, Array]  # vertices (c,), places (c, 3)
    free: Array | None  # vertices that move; None of all
    fairness: Energy | None
    smoothing: float | None
    loss: Loss
    scale: float
    tolerance: float
    refine: bool
    steps: int
    workers: int

    @classmethod
    def of(
        cls, surface: LimitSurface, target: Target, corners: Any, fixed: Any, *rest: Any
    ) -> _Options:
        """Those that `fit` was given, in its order."""
        fairness, smoothing, loss, scale, tolerance, refine, steps, workers = rest
        if loss not in LOSSES:
            raise ValueError(f"loss must be one of {', '.join(LOSSES)}, got {loss!r}")
        if refine not in (None, *get_args(Refine)):
            raise ValueError(f"refine must be None or 'auto', got {refine!r}")
        if refine and fixed is not None:
            raise ValueError("vertices cannot be fixed where the cage is to be refined")
        if fairness is not None:
            order = checked_energy(fairness)
            refuse_rough(surface.topology.rules.scheme, order, fairness)
        if smoothing is not None:
            smoothing = checked_number("smoothing", smoothing, least=0, below=np.inf)
        if scale is not None:
            scale = checked_number("scale", scale, above=0, below=np.inf)
        if tolerance is None:
            finite = target.points[np.isfinite(target.points).all(axis=1)]
            side = float((finite.max(axis=0) / 2 - finite.min(axis=0) / 2).max()) * 2
            tolerance = _TOLERANCE * side if refine else 0.0
        else:
            tolerance = checked_number("tolerance", tolerance, above=0, below=np.inf)
        steps = checked_integer("max_iterations", steps, 0)
        pinned, free = _pinned(surface, corners), _free(surface, fixed)
        return cls(
            pinned,
            free,
            fairness,
            smoothing,
            loss,
            scale or 0.0,
            tolerance,
            bool(refine),
            steps,
            workers,
        )


def _pinned(surface: LimitSurface, corners: Any) -> tuple[Array, Array]:
    """Vertices (c,) and where their limits are to be, (c, 3)."""
    if corners is None:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 3))
    if not isinstance(corners, Mapping):
        raise TypeError(
            f"corners must be a mapping of vertices to points, got {type(corners).__name__}"
        )
    if surface.topology.lattice.dual:
        name = surface.topology.rules.scheme.name
        raise ValueError(f"corners: vertices have no places on surfaces of scheme {name!r}")
    n, used = surface.mesh.n_vertices, surface.mesh.vertex_faces > 0
    vertices = []
    for vertex, place in corners.items():
        number = checked_integer("a vertex in corners", vertex, 0)
        if number >= n or not used[number]:
            raise ValueError(f"corners: vertex {number} is not one of a face, of {n} vertices")
        found = reals(f"the corner at vertex {number}", place)
        if found.shape != (3,) or not np.isfinite(found).all():
            raise ValueError(
                f"the corner at vertex {number} must be three finite numbers, got {place!r}"
            )
        vertices.append(number)
    places = np.array([np.asarray(x, dtype=float) for x in corners.values()]).reshape(-1, 3)
    return np.array(vertices, dtype=np.int64), places


def _free(surface: LimitSurface, fixed: Any) -> Array | None:
    """Vertices that move."""
    if fixed is None:
        return None
    n, given = surface.mesh.n_vertices, np.asarray(fixed)
    if given.size == 0:
        return None
    moves = np.ones(n, dtype=bool)
    if given.dtype.kind == "b":
        if given.shape != (n,):
            raise ValueError(f"fixed must be of shape ({n},) if it is a mask, got {given.shape}")
        moves = ~given
    elif given.dtype.kind in "iu":
        wrong = given[(given < 0) | (given >= n)]
        if wrong.size:
            raise IndexError(f"fixed: vertex {wrong.flat[0]} is out of range, need 0 to {n - 1}")
        moves[given] = False
    else:
        raise TypeError(f"fixed must be a mask or numbers of vertices, got {given.dtype}")
    if not moves.any():
        raise ValueError("fixed: all vertices are, there is nothing to fit")
    return np.flatnonzero(moves)


def _run(surface: LimitSurface, target: Target, options: _Options) -> Fit:
    """Fit a cage, and its refinements."""
    given, known = target.points, np.flatnonzero(np.isfinite(target.points).all(axis=1))
    target = target.some(known).on_edges_of(surface)
    frame = _Frame.of(target.points, surface)
    history: list[float] = []
    levels: list[int] = []
    before = np.full(len(target.points), 1e300)
    enough = float(np.ldexp(options.tolerance, -frame.power))
    pinned = options.corners
    _refuse_line(surface.with_points(frame.scaled(surface.points)))
    if target.detect and len(SharpEdges(surface).of_kind(KINDS["crease"])):
        surface, history = _drawn(surface, target, options, frame)
        levels = [0] * len(history)
    for level in range(_LEVELS + 1):
        problem = _problem(surface, target, options, frame, pinned)
        scaled = surface.with_points(frame.scaled(surface.points))
        run = Steps(problem, scaled)
        _with_energy(run, surface, options)
        if options.smoothing is not None:
            run.reach = np.inf  # as was asked for
        rms, converged = run.to_end(options.steps, enough)
        if run.ran_away:
            run = _held(problem, scaled, options)
            rms, converged = run.to_end(options.steps, enough)
        history += rms[level > 0 :]
        levels += [level] * (len(rms) - (level > 0))
        surface = _where_it_ended(run, surface, frame)
        if not options.refine or rms[-1] <= enough or level == _LEVELS:
            break
        finer, before = _finer(surface, run, before, enough)
        if finer is None:
            break
        pinned = _same_places(surface, finer, pinned)
        surface = finer
    return _record(surface, given, known, run, frame, (history, levels, converged))


@dataclass(frozen=True)
class _Frame:
    """Units in which points are about 1: ``(x - origin) 2^-power``."""

    origin: Array
    power: int

    @classmethod
    def of(cls, points: Array, surface: LimitSurface) -> _Frame:
        """That of points; cages that are far away from them are refused."""
        used = surface.points[surface.mesh.vertex_faces > 0]
        low, high = points.min(axis=0), points.max(axis=0)
        lower, upper = used.min(axis=0), used.max(axis=0)
        half = max(float((high / 2 - low / 2).max()), float((upper / 2 - lower / 2).max()))
        apart = float(np.maximum(low / 2 - upper / 2, lower / 2 - high / 2).max())
        if half == 0:
            raise ValueError("the cage and the points have no extent: all are at one place each")
        if not half < _LARGEST:
            raise ValueError(f"coordinates differ by up to {2 * half:g}, need less than 1e300")
        if apart > 2 * _FAR * half:
            raise ValueError(
                f"the points are {apart / half:.3g} times the size of the larger of both away from "
                "the cage: units, axes or origins differ; move the cage to the points first"
            )
        return cls(low / 2 + high / 2, int(np.frexp(half)[1]))

    def scaled(self, points: Array) -> Array:
        """Points in these units."""
        return np.asarray(np.ldexp(points - self.origin, -self.power))

    def back(self, points: Array) -> Array:
        """Points in their own units."""
        return np.asarray(np.ldexp(points, self.power) + self.origin)


def _problem(
    surface: LimitSurface,
    target: Target,
    options: _Options,
    frame: _Frame,
    pinned: tuple[Array, Array],
) -> Problem:
    """What is to be solved for a cage."""
    n = len(target.points)
    weights = np.full(n, 1 / n)
    if target.weights is not None:
        weights = target.weights / target.weights.max()
        weights = weights / weights.sum()
    vertices, places = pinned
    at = Feet(*(np.zeros((3, 0))))
    if len(vertices):
        number = np.cumsum(surface.mesh.vertex_faces > 0) - 1
        at = Feet(*vertex_places(surface))[number[vertices]]
    moves = np.arange(surface.mesh.n_vertices) if options.free is None else options.free
    return Problem(
        frame.scaled(target.points), weights, target.normals, target.kinds, options.loss,
        float(np.ldexp(options.scale, -frame.power)), None, (at, frame.scaled(places)), moves,
        options.workers,
    )  # fmt: skip


def _with_energy(
    run: Steps, surface: LimitSurface, options: _Options, *, quiet: bool = False
) -> None:
    """Add to what is minimized the energy that was asked for, or that it takes."""
    unseen, share = _unseen(run), options.smoothing
    fading = bool(unseen) and share is None
    if unseen and not share and not quiet:
        done = f"; smoothing={_SMOOTHING:g}, less as the error falls, is added" if fading else ""
        warnings.warn(f"{unseen}{done}", UserWarning, stacklevel=users_level())
    if share or fading:
        energy = _energy(surface, options.fairness) * (1 / len(surface.limit_faces))
        if fading:
            run.fading = _SMOOTHING * energy
        else:
            run.problem = replace(run.problem, energy=share * energy)


def _drawn(
    surface: LimitSurface, target: Target, options: _Options, frame: _Frame
) -> tuple[LimitSurface, list[float]]:
    """The cage with its creases near sharp edges of the points, and the course of that.

    Places on these are known less well than points: from here on they do not count.
    """
    more = target.with_creases(frame.scaled(target.points))
    if more is None:
        return surface, []
    unit = _Frame(np.zeros(3), 0)
    problem = _problem(surface, more, options, unit, options.corners)
    problem = replace(
        problem,
        scale=float(np.ldexp(options.scale, -frame.power)),
        corners=(problem.corners[0], frame.scaled(options.corners[1])),
    )
    run = Steps(problem, surface.with_points(frame.scaled(surface.points)))
    _with_energy(run, surface, options, quiet=True)
    history, _ = run.to_end(options.steps, 0.0)
    if run.ran_away:
        return surface, []
    return _where_it_ended(run, surface, frame), history[:-1]


def _where_it_ended(run: Steps, surface: LimitSurface, frame: _Frame) -> LimitSurface:
    """The surface with the vertices that move where steps took them, in units of the points."""
    points, free = surface.points.copy(), run.problem.free
    points[free] = frame.back(run.state.surface.points[free])
    return surface.with_points(points)


def _held(problem: Problem, start: LimitSurface, options: _Options) -> Steps:
    """The same from the start, with an energy that does not vanish."""
    warnings.warn(
        "vertices ran away to many times the size of points and cage: the points do not say where "
        f"they are to be, as those of a plane do not of a closed cage; smoothing={_SMOOTHING:g} is "
        "added; begin with a cage of their shape",
        UserWarning,
        stacklevel=users_level(),
    )
    share = _SMOOTHING / len(start.limit_faces)
    run = Steps(replace(problem, energy=share * _energy(start, options.fairness)), start)
    run.reach = np.inf
    return run


def _refuse_line(surface: LimitSurface) -> None:
    """Refuse cages of which all vertices are on a line, or at one place."""
    used = surface.points[surface.mesh.vertex_faces > 0]
    sizes = np.linalg.svd(used - used.mean(axis=0), compute_uv=False)
    if not sizes[1] > _THIN * sizes[0]:
        where = "on one line" if sizes[0] else "at one place"
        raise ValueError(
            f"the surface of the cage has no extent: its vertices are all {where}, where no place "
            "is nearer to a point than others; begin with a cage of about the shape of the points"
        )


def _energy(surface: LimitSurface, wanted: Energy | None) -> Any:
    """The matrix of an energy; of plates, or of membranes where these have none that is finite."""
    if wanted is None:
        scheme = surface.topology.rules.scheme
        wanted = "membrane" if scheme.local else "thin_plate"
    return energy_of(surface, wanted)


def _unseen(run: Steps) -> str:
    """What says that points do not determine the vertices that move; nothing if they seem to."""
    surface, problem, feet = run.state.surface, run.problem, run.state.feet
    W = surface.weights(feet.face, feet.u, feet.v, workers=problem.workers)
    support = W.multiply(W).T @ (problem.weights > 0).astype(float)
    used = surface.mesh.vertex_faces[problem.free] > 0
    loose = problem.free[used & ~(support[problem.free] > _SUPPORTED * support.max(initial=0))]
    if len(loose):
        return (
            f"{len(loose)} of {int(used.sum())} vertices are at no point, the first is vertex "
            f"{loose[0]}: the points do not say where they are to be"
        )
    held = np.count_nonzero(problem.weights) + 2 * len(problem.corners[1])
    held += np.count_nonzero(problem.kinds)
    if held < 3 * int(used.sum()):
        return (
            f"{held} distances are too few for {int(used.sum())} vertices, which have three "
            "coordinates each: they do not say where all are to be"
        )
    return ""


def _finer(
    surface: LimitSurface, run: Steps, before: Array, enough: float
) -> tuple[LimitSurface | None, Array]:
    """A surface of which parts with too large an error are refined, if that may help.

    `before` (n,) and what is returned with it are the errors of the part of each point.
    """
    parts = Parts(surface.mesh)
    owner = parts.of_face[surface.limit_faces.face[run.state.feet.face]]
    counted = run.counted
    share = np.bincount(owner, counted, len(parts))
    squares = run.squares()
    error = np.sqrt(np.bincount(owner, counted * squares, len(parts)) / np.maximum(share, 1e-300))
    last = np.bincount(owner, counted * before, len(parts)) / np.maximum(share, 1e-300)
    mesh = surface.mesh
    of_vertex, used = np.zeros(mesh.n_vertices, dtype=np.int64), mesh.vertex_faces > 0
    of_vertex[mesh.indices] = parts.of_face[mesh.corner_face]
    vertices = np.bincount(of_vertex[used], minlength=len(parts))
    points = np.bincount(owner, counted > 0, len(parts))
    # (a refinement has about four times as many vertices)
    wanted = (error > enough) & (error < _GAIN * last) & (points >= 12 * vertices)
    if not wanted.any():
        return None, before
    rules = surface.rules
    finer = LimitSurface(parts.refined(wanted, rules), **rules, engine=surface.engine)
    return finer, np.where(wanted[owner], error[owner], before)


def _same_places(
    old: LimitSurface, new: LimitSurface, pinned: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Vertices of a refinement whose limits are those of some vertices."""
    from scipy.spatial import cKDTree

    if not len(pinned[0]):
        return pinned
    was, now = (x.evaluate(*vertex_places(x)) for x in (old, new))
    number = np.cumsum(old.mesh.vertex_faces > 0) - 1
    _, near = cKDTree(now).query(was[number[pinned[0]]])
    return np.flatnonzero(new.mesh.vertex_faces > 0)[near], pinned[1]


def _record(
    surface: LimitSurface,
    given: Array,
    known: Array,
    run: Steps,
    frame: _Frame,
    course: tuple[list[float], list[int], bool],
) -> Fit:
    """What was found, in units of the points."""
    history, levels, converged = course
    error, u, v = np.full((3, len(given)), np.nan)
    face = np.full(len(given), -1)
    feet = run.state.feet
    error[known] = np.ldexp(run.state.distance, frame.power)
    face[known], u[known], v[known] = feet.face, feet.u, feet.v
    mesh = surface.mesh
    return Fit(
        mesh, surface, np.ldexp(np.array(history), frame.power), np.array(levels), error, face, u,
        v, given, converged,
    )  # fmt: skip
