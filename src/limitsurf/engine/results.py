"""Where results go: to new arrays, or to those that callers bring."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.engine.protocol import Order, Request

Array = NDArray[Any]


class Results:
    """Arrays (Q, d) for kernels to write to; `joint` (n, Q, d) is all of them, if there is that."""

    def __init__(self, arrays: Sequence[Array], joint: Array | None) -> None:
        self.arrays, self.joint = arrays, joint

    @classmethod
    def new(cls, shape: tuple[int, int, int]) -> Results:
        """Arrays that nobody has yet."""
        made: Any = np.empty(shape)
        return cls(made, made)

    @classmethod
    def into(cls, arrays: Sequence[Array]) -> Results:
        """Given arrays, each contiguous."""
        if len(arrays) == 1:
            return cls(arrays, arrays[0][None])
        # those of an earlier answer lie one behind the other, and nothing beside them
        first, whole = arrays[0], arrays[0].base
        if not isinstance(whole, np.ndarray) or whole.size != len(arrays) * first.size:
            return cls(arrays, None)
        starts = [x.ctypes.data for x in arrays]
        if starts != [whole.ctypes.data + k * first.nbytes for k in range(len(arrays))]:
            return cls(arrays, None)
        if whole.dtype != first.dtype or not whole.flags.carray:
            return cls(arrays, None)
        return cls(arrays, whole.reshape(len(arrays), *first.shape))

    def place(self, part: slice) -> tuple[Array, int]:
        """An array (n, ..., d) for results of some queries, and the first one's place in it."""
        if self.joint is not None:
            return self.joint, part.start
        return np.empty((len(self.arrays), part.stop - part.start, self.arrays[0].shape[1])), 0

    def keep(self, part: slice, found: Array) -> None:
        """Take what was written to the array of `place`."""
        if self.joint is None:
            for result, value in zip(self.arrays, found, strict=True):
                result[part] = value


def by_order(orders: Sequence[Order], found: Any, shape: tuple[int, ...]) -> dict[Order, Array]:
    """Derivatives (n, Q, d), one array or several, in a shape for each.

    Examples
    --------
    >>> import numpy as np
    >>> from limitsurf.engine.results import by_order
    >>> by_order([(0, 0), (1, 0)], np.zeros((2, 4, 1)), (2, 2))[1, 0].shape
    (2, 2)
    """
    if isinstance(found, np.ndarray):
        found = found.reshape(len(orders), *shape)
    else:
        found = [x.reshape(shape)[()] for x in found]
    return dict(zip(orders, found, strict=True))


def written(
    out: Mapping[str, Any],
    shape: tuple[int, ...],
    request: Request,
    write: Callable[[Request, list[Array]], Any],
) -> None:
    """Have results of some shape written to arrays of a caller, by their names in errors.

    `write` takes the request and contiguous arrays (Q, d). What the results would overwrite of the
    request is copied before; arrays that are not contiguous and aligned are written to in the end.

    Raises
    ------
    TypeError
        For what is no array of float64, and on exact requests.
    ValueError
        For an array of another shape, or a read-only one.

    Examples
    --------
    >>> import numpy as np
    >>> from limitsurf.engine.protocol import Order, Request
    >>> from limitsurf.engine.results import written
    >>> asked, room = Request.of(0, [0.5, 0.75], 0.25, exact=False, workers=1), np.empty((2, 1))
    >>> written({"out": room}, (2, 1), asked, lambda asked, rows: rows[0].fill(7))
    >>> room.tolist()
    [[7.0], [7.0]]
    """
    for name, x in out.items():
        _check(name, x, shape, request.exact)
    _check_apart(out)
    parts = request.face, request.u, request.v
    if any(np.may_share_memory(part, x) for x in out.values() for part in parts):
        face, u, v = (part.copy() for part in parts)
        request = Request(face, u, v, request.exact, request.workers)
    flat = request.face.size, prod(shape[request.face.ndim :])
    rows = [x.reshape(flat) if x.flags.carray else np.empty(flat) for x in out.values()]
    write(request, rows)
    for x, row in zip(out.values(), rows, strict=True):
        if not x.flags.carray:
            x[...] = row.reshape(shape)


def arrays_of(out: Any, orders: Sequence[Order]) -> dict[str, Any]:
    """The arrays of a dict for these derivatives, by their names in errors.

    Examples
    --------
    >>> from limitsurf.engine.results import arrays_of
    >>> arrays_of({(0, 0): 7}, [(0, 0)])
    {'out[(0, 0)]': 7}
    """
    if not isinstance(out, dict):
        raise TypeError(
            f"out must be a dict of arrays, as jet returns it, got {type(out).__name__}"
        )
    for nu in orders:
        if nu not in out:
            raise ValueError(f"out has no array for the derivative {nu}")
    if len(out) > len(orders):
        more = next(nu for nu in out if nu not in orders)
        raise ValueError(f"out has an array for {more!r}, which is not a derivative of the jet")
    return {f"out[{nu}]": out[nu] for nu in orders}


def _check_apart(out: Mapping[str, Array]) -> None:
    """Complain of arrays that share memory, where one result would overwrite another."""
    bounds = []
    for name, x in out.items():
        reach = [step * (n - 1) for step, n in zip(x.strides, x.shape, strict=True)]
        first = x.ctypes.data + sum(step for step in reach if step < 0)
        bounds += [(first, first + sum(map(abs, reach)) + x.itemsize, name)] if x.size else []
    before: list[tuple[int, str]] = []  # ends of those that may reach into the next
    for first, end, name in sorted(bounds):
        before = [one for one in before if one[0] > first]
        for _, other in before:
            if np.shares_memory(out[name], out[other]):
                both = " and ".join(x for x in out if x in (name, other))
                raise ValueError(f"{both} share memory: give an array of its own for each")
        before.append((end, name))


def _check(name: str, x: Any, shape: tuple[int, ...], exact: bool) -> None:
    """Complain of what results of a shape cannot be written to."""
    if exact:
        raise TypeError(
            f"{name} takes results in float64, and exact numbers have none: leave it out, or give "
            "u, v and points in float64"
        )
    kind = type(x).__name__
    if not isinstance(x, np.ndarray) or isinstance(x, np.ma.MaskedArray):
        raise TypeError(f"{name} must be an array of float64, got {kind}")
    if x.dtype != np.dtype(float):
        raise TypeError(f"{name} must be an array of float64, got {x.dtype}")
    if x.shape != shape:
        raise ValueError(f"{name} must have the shape of the result, {shape}, got {x.shape}")
    if any(step == 0 < n - 1 for step, n in zip(x.strides, x.shape, strict=True)):
        raise ValueError(f"{name} has the same numbers in several places: give an array of its own")
    if not x.flags.writeable:
        raise ValueError(f"{name} is read-only: results cannot be written to it")
