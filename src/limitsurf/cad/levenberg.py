"""Damped Gauss-Newton steps of a cage towards points, by distances from their feet.

Of a point x with its foot s on the surface, r = x - s. Whatever the vertices P do, the derivative
of ``|r|^2 / 2`` is that with the foot held in place, ``-w^T r`` with the weights w of the foot. Its
second derivative is ``w^T w M`` but for terms in which w changes, with M = 1 along r, 0 in
directions in which the foot slides along, and, far from the end, what curvature leaves of these
(``derivations/fitting.py``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from limitsurf.cad.feet import Feet, SharpEdges, followed, sought
from limitsurf.cad.gauss_newton import ENTRY, PAIRS, Normal, sums
from limitsurf.surface import LimitSurface

Array = NDArray[Any]
Loss: TypeAlias = Literal["linear", "huber", "soft_l1", "cauchy"]

LOSSES: tuple[Loss, ...] = get_args(Loss)
_ASIDE = 1e-6  # of a residual: what is along the surface where the foot cannot go on
_OFTEN = 8  # steps after which feet are sought on the whole surface
_TRIES = 12  # of dampings in a step
_DAMPING, _LEAST, _MOST, _LESS = 1e-3, 1e-15, 1e6, 0.02
_ROUNDING = 1e-14  # distances, of the size
_FEET = 1e-12  # how far feet may be off along the surface, of the size
_BENT = 1e-4  # root of the mean square, of the size, from which on curvature counts in a step
_TURN = 0.75  # of a step: a second one that is longer is none
_FADING, _LITTLE = 1e-6, 1e-8  # mean squares up to which such energies fade, and what is left
_GAINED = 1e-3  # of the sum of squares: less is nothing
_MAD = 1.4826  # standard deviations of a normal distribution in a median of distances
_AWAY = 8.0  # sizes of points and cage, from which on vertices have run away
_ON, _BOUNDARY, _CREASE = 0, 1, 2


@dataclass(frozen=True)
class Problem:
    """What is fitted, in units in which it is about 1.

    Attributes
    ----------
    points : (n, 3)
    weights : (n,)
        Their sum is 1.
    normals : (n, 3) or None
    kinds : (n,) int
        0 of points on the surface, 1 on boundaries, 2 on creases, 3 on either.
    loss, scale
        Scale is 0 where it is taken from the points.
    energy : csr_array (n_vertices, n_vertices) or None
        What is added to the mean of squares.
    corners : (vertices' places: Feet, points (c, 3))
    free : (n_free,) int
        Vertices that move.
    """

    points: Array
    weights: Array
    normals: Array | None
    kinds: Array
    loss: Loss
    scale: float
    energy: Any
    corners: tuple[Feet, Array]
    free: Array
    workers: int


@dataclass(frozen=True)
class State:
    """A surface and where on it the points have their feet."""

    surface: LimitSurface
    feet: Feet
    gap: Array  # (n, 3)
    distance: Array  # (n,)


@dataclass(frozen=True)
class Equations:
    """What a step solves, and what it was made of.

    Attributes
    ----------
    normal : Normal
        Second derivatives.
    right : (n_free, 3)
        Less the first ones.
    W : csr_array (n, n_vertices)
        Weights of the feet.
    weight : (n,)
    metric : (n, 6)
    gap : (n, 3)
        What counts of the gaps.
    free : (n_free,)
    """

    normal: Normal
    right: Array
    W: Any
    weight: Array
    metric: Array
    gap: Array
    free: Array

    def turned(self, damping: float, move: Array, gap: Array) -> Array | None:
        """A second step, by what gaps after the first have that was not promised; None if long.

        That is half of the second derivative along the step.
        """
        whole = np.zeros((self.W.shape[1], 3))
        whole[self.free] = move
        promised = self.gap - _times(self.metric, self.W @ whole)
        more = self.weight[:, None] * (across(self.metric, gap) - promised)
        found = self.normal.solve(damping, (self.W.T @ more)[self.free])
        if found is None or np.abs(found).max() > _TURN * np.abs(move).max():
            return None
        return found


class Steps:
    """Steps of one cage."""

    def __init__(self, problem: Problem, surface: LimitSurface) -> None:
        self.problem = problem
        self.fading: Any = None  # an energy that is to vanish with the error
        self.reach = _AWAY * max(1.0, float(np.abs(surface.points[problem.free]).max()))
        self.edges = SharpEdges(surface) if problem.kinds.any() else None
        self.state = self._at(surface, None)
        self.scale = self._scale()
        self.counted = self._counted()
        if not self.counted.any():
            raise ValueError(
                "no point has a normal at most 90 degrees from that of a place near it: normals "
                "are to point outward, as those of the cage do; turn them, or leave them out"
            )

    # ------------------------------------------------------------------ feet and what they cost

    def _at(self, surface: LimitSurface, before: Feet | None) -> State:
        """The state of a surface, with feet sought anew or from those before."""
        points, workers = self.problem.points, self.problem.workers
        kinds = self.problem.kinds
        feet = Feet(np.full(len(points), -1), *np.full((2, len(points)), np.nan))
        on = np.flatnonzero(kinds == _ON)
        normals = None if self.problem.normals is None else self.problem.normals[on]
        if before is None:
            found = sought(surface, points[on], normals, workers)
        else:
            found = followed(surface, points[on], normals, before[on], workers)
        parts = [(on, found)]
        if self.edges is not None:
            for kind in range(1, 4):
                which = np.flatnonzero(kinds == kind)
                allowed = self.edges.of_kind(kind)
                if len(which):
                    parts.append((which, self.edges.nearest(surface, points[which], allowed)))
        for which, some in parts:
            feet.face[which], feet.u[which], feet.v[which] = some.face, some.u, some.v
        gap = points - surface.evaluate(feet.face, feet.u, feet.v, workers=workers)
        return State(surface, feet, gap, np.sqrt((gap**2).sum(axis=1)))

    def _scale(self) -> float:
        """The distance from which on a robust loss counts less."""
        if self.problem.loss == "linear":
            return 1.0
        if self.problem.scale:
            return max(self.problem.scale, _ROUNDING)
        return max(_MAD * float(np.median(self.state.distance)), _ROUNDING)

    def _counted(self) -> Array:
        """Weights of points whose normals do not say that their feet are on the wrong side."""
        problem, feet = self.problem, self.state.feet
        if problem.normals is None:
            return problem.weights
        there = self.state.surface.normal(feet.face, feet.u, feet.v, workers=problem.workers)
        against = (there * problem.normals).sum(axis=1) < 0
        return np.where(against & (problem.kinds == _ON), 0.0, problem.weights)

    def data(self, state: State) -> float:
        """The mean of squared distances, as weights and the loss count them."""
        return float(self.counted @ _rho(self.problem.loss, state.distance, self.scale)[0])

    def cost(self, state: State) -> float:
        """What is to be least."""
        total, points = self.data(state) + self._off_corners(state), state.surface.points
        if self.problem.energy is not None:
            total += float((points * (self.problem.energy @ points)).sum())
        return total

    def _off_corners(self, state: State) -> float:
        """The mean of squared distances of corners from where they are to be."""
        places, targets = self.problem.corners
        if not len(targets):
            return 0.0
        gap = targets - state.surface.evaluate(places.face, places.u, places.v)
        return float((gap**2).sum()) / len(targets)

    def _done(self, enough: float) -> bool:
        """Whether the error is small enough: as was asked for, or of all that is to be least."""
        least = max(enough, _ROUNDING)
        if self._off_corners(self.state) > least**2:
            return False
        return self.rms <= enough or self.cost(self.state) <= _ROUNDING**2

    @property
    def rms(self) -> float:
        """Root of the mean square, as the loss counts it."""
        return float(np.sqrt(max(self.data(self.state) / max(self.counted.sum(), 1e-300), 0)))

    @property
    def ran_away(self) -> bool:
        """Whether vertices are so far off that the points cannot be why."""
        return bool(np.abs(self.state.surface.points[self.problem.free]).max() > self.reach)

    # ------------------------------------------------------------------ a step

    def equations(self) -> Equations:
        """Those of a step from where the surface is."""
        problem, state = self.problem, self.state
        feet, free, surface = state.feet, problem.free, state.surface
        _, slope = _rho(problem.loss, state.distance, self.scale)
        weight = self.counted * slope
        W = surface.weights(feet.face, feet.u, feet.v, workers=problem.workers)
        bent = self.rms > _BENT
        metric = metrics(surface, feet, state.gap, problem.kinds, problem.workers, bent=bent)
        blocks = sums(W, weight[:, None] * metric)
        gap = across(metric, state.gap)
        right = W.T @ (weight[:, None] * gap)
        diagonal = [k for k, (i, j) in enumerate(PAIRS) if i == j]
        if problem.energy is not None:
            right = right - problem.energy @ surface.points
            for k in diagonal:
                blocks[k] = blocks[k] + problem.energy
        places, targets = problem.corners
        if len(targets):
            C = surface.weights(places.face, places.u, places.v)
            right = right + C.T @ (targets - C @ surface.points) / len(targets)
            for k in diagonal:
                blocks[k] = blocks[k] + C.T @ C / len(targets)
        if len(free) < len(right):
            blocks = [one[free][:, free] for one in blocks]
        return Equations(Normal(blocks), right[free], W, weight, metric, gap, free)

    def step(self, damping: float, anew: bool) -> tuple[float, float, bool]:
        """One step: the damping for the next one, the cost, and whether there was a step."""
        if self.fading is not None:
            share = min(max(self.data(self.state) / _FADING, _LITTLE), 1.0)
            self.problem = replace(self.problem, energy=share * self.fading)
        equations = self.equations()
        normal, right = equations.normal, equations.right
        before, grow = self.cost(self.state), 4.0
        for _ in range(_TRIES):
            move = normal.solve(damping, right)
            if move is not None:
                if np.abs(move).max(initial=0) < _ROUNDING:
                    break
                trial, after = self._moved(move, anew)
                if (more := equations.turned(damping, move, trial.gap)) is not None:
                    other, least = self._moved(move + more, anew)
                    if least < after:
                        trial, after = other, least
                promised = 2 * float((move * right).sum()) - normal.curvature(move)
                if after < before:
                    self.state = trial
                    gain = (before - after) / promised if promised > 0 else 0
                    less = max(_LESS, 1 - (2 * gain - 1) ** 3) if gain > 0 else 1
                    return max(damping * less, _LEAST), before, True
            if damping >= _MOST:
                break
            damping, grow = min(damping * grow, _MOST), 2 * grow
        return damping, before, False

    def _moved(self, move: Array, anew: bool) -> tuple[State, float]:
        """The state after a step of the free vertices, and its cost."""
        points = self.state.surface.points.copy()
        points[self.problem.free] += move
        surface = self.state.surface.with_points(points)
        state = self._at(surface, None if anew else self.state.feet)
        return state, self.cost(state)

    def settle(self) -> bool:
        """Seek all feet anew; whether that brought some nearer than they were thought to be."""
        old = self.state
        self.state = self._at(old.surface, None)
        nearer = old.distance - self.state.distance > 1e-9 * old.distance + _ROUNDING
        return bool(nearer.any())

    def squares(self) -> Array:
        """Squared distances (n,) as the loss counts them."""
        return _rho(self.problem.loss, self.state.distance, self.scale)[0]

    def renew(self) -> None:
        """Take scale and counted points from where the surface is now."""
        self.scale, self.counted = self._scale(), self._counted()

    def to_end(self, steps: int, enough: float) -> tuple[list[float], bool]:
        """Steps until nothing is gained, the rms is below `enough`, or there were so many.

        Or until vertices have run away, which costs time, too: nearest places are hard to find on
        a surface that is folded onto itself.

        Returns the rms before and after each step, and whether it ended before it had to.
        """
        history, damping = [self.rms], _DAMPING
        converged = self._done(enough)
        for count in range(0 if converged else steps):
            damping, before, moved = self.step(damping, count % _OFTEN == 0)
            gained = before - self.cost(self.state)
            if moved:
                self.renew()
                history.append(self.rms)
                if self.ran_away:
                    return history, False
            converged = self._done(enough)
            if not converged and (not moved or gained <= _GAINED * before):
                # what feet say that were followed may not be all
                converged = not self.settle()
                self.renew()
                damping = _DAMPING
            if converged:
                break
        self.settle()
        self.renew()
        history[-1] = self.rms
        return history, converged


def _rho(loss: Loss, distance: Array, scale: float) -> tuple[Array, Array]:
    """What a loss counts for distances (n,), as a square, and its derivative by the square."""
    square = distance**2
    if loss == "linear":
        return square, np.ones(len(square))
    z = square / scale**2
    if loss == "huber":
        root = np.sqrt(np.maximum(z, 1))
        return scale**2 * np.where(z <= 1, z, 2 * root - 1), 1 / root
    if loss == "soft_l1":
        root = np.sqrt(1 + z)
        return scale**2 * 2 * (root - 1), 1 / root
    return scale**2 * np.log1p(z), 1 / (1 + z)


def metrics(
    surface: LimitSurface, feet: Feet, gap: Array, kinds: Array, workers: int, *, bent: bool
) -> Array:
    """M of each point, (n, 6) in the order of `PAIRS`; if not `bent`, with k = 0.

    ``n n^T + c1 d1 d1^T + c2 d2 d2^T`` with the principal directions and
    ``c = -d k / (1 - d k)``, or 0 where that is negative, of signed distances d and curvatures k.
    Of feet that a sharp edge holds, ``1 - t t^T`` with its tangent t; of those that a corner or the
    end of what has a limit holds, or where the surface has no normal, 1.
    """
    normal = surface.normal(feet.face, feet.u, feet.v, workers=workers)
    distance = np.sqrt((gap**2).sum(axis=1))
    along = (gap * normal).sum(axis=1)
    aside = np.sqrt(((gap - along[:, None] * normal) ** 2).sum(axis=1))
    aside = aside > _ASIDE * distance + _FEET
    held, at_corner, side = _on_sharp(surface, feet)
    held &= aside | (kinds != _ON)
    found = _outer(normal)
    far = np.flatnonzero(~held & (distance > _ROUNDING))
    if bent and len(far):
        known = surface.curvature(feet.face[far], feet.u[far], feet.v[far], workers=workers)
        for k, way in ((known.k1, known.d1), (known.k2, known.d2)):
            with np.errstate(all="ignore"):
                x = -along[far] * k
                c = np.where(np.isinf(x), 1.0, x / (1 + x))
            more = (c > 0) & np.isfinite(way).all(axis=1)
            found[far[more]] += np.minimum(c[more], 1)[:, None] * _outer(way[more])
    which = np.flatnonzero(held)
    if len(which):
        tangent = _tangents(surface, feet[which], side[which])
        own = (gap[which] * tangent).sum(axis=1)
        free = ~at_corner[which] & (np.abs(own) <= _ASIDE * distance[which] + _ROUNDING)
        found[which] = _outer(np.eye(3)).sum(axis=0) - np.where(free[:, None], _outer(tangent), 0)
    lost = ~np.isfinite(found).all(axis=1) | (aside & ~held)
    found[lost] = _outer(np.eye(3)).sum(axis=0)
    return found


def across(metric: Array, gap: Array) -> Array:
    """Gaps (n, 3) of points without what is along the surface by rounding of feet alone.

    Along a surface that can slide within itself nothing else would oppose that in a step.
    """
    found = _times(metric, gap)
    aside = np.sqrt(((gap - found) ** 2).sum(axis=1))
    exact = aside <= _ASIDE * np.sqrt((gap**2).sum(axis=1)) + _FEET
    return np.where(exact[:, None], found, gap)


def _times(metric: Array, vectors: Array) -> Array:
    """``M v`` of vectors (n, 3)."""
    return np.asarray(np.einsum("nij,nj->ni", metric[:, ENTRY], vectors))


def _outer(vectors: Array) -> Array:
    """``v v^T`` of vectors (n, 3): (n, 6)."""
    return np.stack([vectors[:, i] * vectors[:, j] for i, j in PAIRS], axis=1)


def _on_sharp(surface: LimitSurface, feet: Feet) -> tuple[Array, Array, Array]:
    """Whether feet are on sides that stay sharp, on two of them, and on which, (n,) each."""
    u, v = feet.u, feet.v
    if surface.topology.lattice.sloped:
        on = np.stack([v == 0, u + v >= 1, u == 0], axis=1)
    else:
        on = np.stack([v == 0, u == 1, v == 1, u == 0], axis=1)
    on &= surface.topology.sharp_sides[feet.face]
    count = on.sum(axis=1)
    return count > 0, count > 1, on.argmax(axis=1)


def _tangents(surface: LimitSurface, feet: Feet, side: Array) -> Array:
    """Unit directions (n, 3) along sides; NaN where there are none."""
    corners = np.array(surface.topology.lattice.corners, dtype=float)
    way = (np.roll(corners, -1, axis=0) - corners)[side]
    jet = surface.jet(feet.face, feet.u, feet.v, order=1)
    with np.errstate(all="ignore"):
        along = way[:, :1] * jet[1, 0] + way[:, 1:] * jet[0, 1]
        return np.asarray(along / np.sqrt((along**2).sum(axis=1))[:, None])
