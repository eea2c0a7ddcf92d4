"""What is asked, and who can answer: request, and the functions that both engines have."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf import numbers
from limitsurf.masked import may_be_masked, unmasked

if TYPE_CHECKING:
    from limitsurf.scheme.lattice import Lattice

Array = NDArray[Any]
Order: TypeAlias = tuple[int, int]

# by how much u + v may be above 1, by rounding
_BEYOND = 4 * 2.0**-52

# derivatives that curvature comes from
JET = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))


@dataclass(slots=True)
class Request:
    """Places on limit faces: arrays of one shape, whether they are exact numbers, and threads.

    Examples
    --------
    >>> import numpy as np
    >>> from limitsurf.engine.protocol import Request
    >>> asked = Request.of(np.arange(2)[:, None], 0.5, [0.25, 0.75], exact=False, workers=1)
    >>> asked.face.shape, asked.v[0].tolist()
    ((2, 2), [0.25, 0.75])
    """

    face: Array
    u: Array
    v: Array
    exact: bool
    workers: int

    @classmethod
    def of(cls, face: Any, u: Any, v: Any, exact: bool, workers: int) -> Self:
        """What was given to a call, broadcast; masked queries have NaN for u.

        The numbers are exact if they are to be, or one of them is.
        """
        masks: Sequence[Array | None] = ()
        if may_be_masked(face, u, v):
            (face, u, v), masks = zip(*map(unmasked, (face, u, v)), strict=True)
        faces, us, vs = np.asarray(face), np.asarray(u), np.asarray(v)
        if faces.size == 0 and faces.dtype == float:
            faces = faces.astype(np.int64)
        if faces.dtype.kind not in "iu":
            faces = _within_range(faces)
        if exact or numbers.RATIONAL.dtype in (us.dtype, vs.dtype):
            us, vs, exact = numbers.RATIONAL.array(us), numbers.RATIONAL.array(vs), True
        else:
            for name, x in (("u", us), ("v", vs)):
                if x.dtype.kind not in "iuf":
                    raise TypeError(f"{name} must be real numbers, got {x.dtype}")
            us, vs = us.astype(float, copy=False), vs.astype(float, copy=False)
        if not faces.shape == us.shape == vs.shape:
            try:
                faces, us, vs = np.broadcast_arrays(faces, us, vs)
            except ValueError:
                raise ValueError(
                    f"face, u and v of shapes {faces.shape}, {us.shape} and {vs.shape} "
                    "cannot be broadcast together"
                ) from None
        for mask in masks:
            if mask is not None:  # a query without an answer
                us = np.where(mask, np.nan, us)
        if workers != 1 or workers is True:
            workers = threads(workers)
        return cls(faces, us, vs, exact, workers)

    def check(self, n_faces: int, lattice: Lattice) -> None:
        """Complain of the first face or parameter out of range.

        In triangles, floats that are beyond u + v = 1 by rounding are put on that side.
        """
        bad = (self.face < 0) | (self.face >= n_faces)
        if bad.any():
            raise IndexError(
                f"limit face {_first(self.face, bad)} is out of range: there are {n_faces}, "
                f"0 to {n_faces - 1}"
            )
        for name, x in (("u", self.u), ("v", self.v)):
            with np.errstate(invalid="ignore"):
                bad = np.asarray(x < 0 if lattice.sloped else (x < 0) | (x > 1), dtype=bool)
            if not self.exact:
                bad &= np.isfinite(x)
            if bad.any():
                raise ValueError(f"{name} = {_first(x, bad)} is outside [0, 1]")
        if lattice.sloped:
            self._check_sum()

    def _check_sum(self) -> None:
        u, v = self.u, self.v
        with np.errstate(invalid="ignore"):
            beyond = np.maximum(u, v) - 1 + np.minimum(u, v)  # with all digits
            over = np.asarray(beyond > 0, dtype=bool)
        if not self.exact:
            over &= np.isfinite(u) & np.isfinite(v)
        if not over.any():
            return
        bad = over if self.exact else over & (beyond > _BEYOND)
        if bad.any():
            raise ValueError(
                f"u + v = {_first(np.asarray(u + v), bad)} is outside the triangle u, v >= 0, "
                "u + v <= 1"
            )
        self.u, self.v = on_slope(u, v, over)

    def flat(self, which: Any = slice(None)) -> Request:
        """All of them in C order, or those of some places in it, as (Q,) arrays."""
        parts = self.face.flat[which], self.u.flat[which], self.v.flat[which]
        return Request(*parts, self.exact, self.workers)


class Engine(Protocol):
    """One implementation; Q request, d channels of the points.

    Queries out of range raise an IndexError or a ValueError, whoever answers.
    """

    def derivatives(
        self, request: Request, orders: Sequence[Order], out: Sequence[Array] | None = None
    ) -> Sequence[Array]:
        """Derivatives in (u, v) of these orders, (Q, d) each: the arrays of `out`, if given."""
        ...

    def normals(self, request: Request, out: Array | None = None) -> Array:
        """Unit normals (Q, 3), also where they are limits: the array `out`, if given."""
        ...

    def tangents(self, request: Request, width: int) -> tuple[Array, Array]:
        """Unit vectors along d/du and d/dv, of `width` channels each, (Q, d); NaN in doubt."""
        ...

    def curvatures(self, request: Request) -> Array:
        """Curvatures k1, k2, mean and Gaussian, and directions d1 and d2, (Q, 10)."""
        ...

    def weights(self, request: Request, orders: Sequence[Order]) -> list[Any]:
        """Sparse rows (Q, n_vertices) that give derivatives of these orders, on one pattern."""
        ...


def on_slope(u: Array, v: Array, which: Array | bool = True) -> tuple[Array, Array]:
    """Parameters of which some are put on u + v = 1: the larger one becomes 1 - the other."""
    larger = u > v
    return np.where(which & larger, 1 - v, u), np.where(which & ~larger, 1 - u, v)


def threads(workers: int) -> int:
    """How many threads `workers` asks for, after SciPy: -1 is one for each processor.

    Examples
    --------
    >>> from limitsurf.engine.protocol import threads
    >>> threads(3)
    3
    """
    whole = isinstance(workers, (int, np.integer)) and not isinstance(workers, bool)
    if not whole or workers < -1 or workers == 0:
        raise ValueError(f"workers must be a positive integer, or -1 for all, got {workers!r}")
    if workers < 0:
        # those that this process may run on
        count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
        return max(1, count or 1)
    return int(workers)


def _within_range(faces: Array) -> Array:
    """Integers that NumPy has as objects, since some of them are beyond 64 bits: as no face."""
    flat = faces.ravel().tolist()
    whole = faces.dtype == object and all(isinstance(x, int | np.integer) for x in flat)
    if not whole or any(isinstance(x, bool) for x in flat):
        raise TypeError(f"faces must be integers, got {faces.dtype}")
    beyond = np.array([not -(2**63) <= x < 2**63 for x in flat], dtype=bool).reshape(faces.shape)
    if beyond.any():
        raise IndexError(f"limit face {_first(faces, beyond)} is out of range")
    return faces.astype(np.int64)


def _first(values: Array, bad: Array) -> str:
    """The first offending value, where it is, and how many there are."""
    place = np.unravel_index(int(np.argmax(bad)), bad.shape) if bad.ndim else ()
    where = f" at index {', '.join(map(str, place))}" if place else ""
    count = int(np.count_nonzero(bad))
    more = f" ({count - 1} more like it)" if count > 1 else ""
    return f"{values[place]}{where}{more}"
