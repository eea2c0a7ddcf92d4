"""Properties that are computed on first use and kept."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, Self, TypeVar, overload

T = TypeVar("T")


class cached_property(Generic[T]):  # noqa: N801  (like that of functools)
    """What ``functools.cached_property`` is from Python 3.12 on: without a lock.

    Before, one lock serves all instances of a class: threads wait for one another's surfaces, and
    a process forked meanwhile waits for ever. Here two threads may compute the same value, of which
    one is kept.

    Examples
    --------
    >>> from limitsurf.caching import cached_property
    >>> class Square:
    ...     side = 3
    ...
    ...     @cached_property
    ...     def area(self):
    ...         return self.side**2
    >>> Square().area
    9
    """

    def __init__(self, func: Callable[[Any], T]) -> None:
        self.func = func
        self.name = func.__name__
        self.__doc__ = func.__doc__

    @overload
    def __get__(self, instance: None, owner: type) -> Self: ...
    @overload
    def __get__(self, instance: object, owner: type) -> T: ...
    def __get__(self, instance: object | None, owner: type) -> Self | T:
        if instance is None:
            return self
        kept: T = vars(instance).setdefault(self.name, self.func(instance))
        return kept
