"""Which derivatives are asked for."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from limitsurf.engine.protocol import Order

_MOST = 10_000  # derivatives in a jet
_ZERO = 5  # order of derivatives that are 0 in all pieces


def checked_order(nu: Any) -> Order:
    """Two non-negative integers; those beyond the degree of all pieces are alike.

    Examples
    --------
    >>> from limitsurf.engine.orders import checked_order
    >>> checked_order([1, 7])
    (1, 5)
    """
    order = tuple(nu) if isinstance(nu, (tuple, list, np.ndarray)) else ()
    if len(order) == 2:
        i, j = order
        whole = isinstance(i, (int, np.integer)) and isinstance(j, (int, np.integer))
        if whole and i >= 0 and j >= 0 and type(i) is not bool and type(j) is not bool:
            return min(int(i), _ZERO), min(int(j), _ZERO)
    raise ValueError(f"nu must be two integers >= 0, got {nu!r}")


def checked_orders(nu: Any) -> tuple[bool, list[Order]]:
    """Whether it is several orders, a sequence of them, or one; and these.

    Examples
    --------
    >>> from limitsurf.engine.orders import checked_orders
    >>> checked_orders((1, 0)), checked_orders([(1, 0)])
    ((False, [(1, 0)]), (True, [(1, 0)]))
    """
    sequences = tuple, list, np.ndarray
    if isinstance(nu, sequences) and all(isinstance(one, sequences) for one in nu):
        return True, list(map(checked_order, nu))
    return False, [checked_order(nu)]


@lru_cache(maxsize=16)
def orders_up_to(order: int) -> tuple[tuple[Order, ...], tuple[Order, ...]]:
    """All derivatives up to an order, and which of the pieces' these are.

    Examples
    --------
    >>> from limitsurf.engine.orders import orders_up_to
    >>> orders_up_to(1)[0]
    ((0, 0), (1, 0), (0, 1))
    """
    count = (order + 1) * (order + 2) // 2
    if count > _MOST:
        raise ValueError(
            f"a jet of order {order} has {count:,} derivatives, more than {_MOST:,}; those "
            "beyond the third in u or in v are 0: ask for order 6, which has all others, or "
            "evaluate those you need by nu="
        )
    orders = tuple((m - j, j) for m in range(order + 1) for j in range(m + 1))
    return orders, tuple(map(checked_order, orders))
