"""Records of arrays: of one length, of which searches keep many, and of polylines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from limitsurf import html

Array = NDArray[Any]


class Rows:
    """What is alike of dataclasses with slots whose fields are arrays (n, ...): n rows."""

    __slots__: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(getattr(self, self.__slots__[0]))

    def __getitem__(self, which: Any) -> Self:
        return type(self)(*(getattr(self, name)[which] for name in self.__slots__))

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """All rows of some, one after the other."""
        if len(parts) == 1:
            return parts[0]
        columns = ([getattr(part, name) for part in parts] for name in cls.__slots__)
        return cls(*map(np.concatenate, columns))


class Polylines:
    """What is alike of records of curves: `offsets`, which are `closed`, and points with a place.

    Of each curve there may be something more: arrays named in `_of_curves`.
    """

    offsets: Array
    closed: Array
    point: Array
    face: Array

    _of_curves: ClassVar[tuple[str, ...]] = ()

    def __len__(self) -> int:
        return len(self.closed)

    def __repr__(self) -> str:
        n, m = len(self), len(self.face)
        what = f"{n} curve{'s' * (n != 1)} of {m} points, {int(self.closed.sum())} closed"
        return f"{type(self).__name__}({what})"

    def _repr_html_(self) -> str:
        columns = {"points": np.diff(self.offsets), "closed": self.closed}
        columns |= {name: getattr(self, name) for name in self._of_curves}
        return html.table({**columns, "first point": self.point[self.offsets[:-1]]}, repr(self))


R = TypeVar("R", bound=Rows)


def taken(stack: list[R], most: int) -> R:
    """So many rows of what is pending, the last first, taken from there."""
    parts = [stack.pop()]
    count = len(parts[0])
    while stack and count < most:
        parts.append(stack.pop())
        count += len(parts[-1])
    one = parts[0].joined(parts)
    if count > most:
        stack.append(one[most:])
        return one[:most]
    return one


def numbered(keys: Sequence[Array]) -> tuple[Array, Array]:
    """Numbers (n,) of rows of keys, by the last key first, and the first row of each number."""
    order = np.lexsort(keys)
    new = np.zeros(len(order), dtype=bool)
    for key in keys:
        sorted_ = key[order]
        new[1:] |= sorted_[1:] != sorted_[:-1]
    new[:1] = True
    number = np.empty(len(order), dtype=np.int64)
    number[order] = np.cumsum(new) - 1
    return number, order[new]
