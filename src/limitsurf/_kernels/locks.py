"""Locks that a fork waits for."""

import os
import threading
from typing import Any

# Held while something is made on first use: modules imported, kernels compiled, surfaces packed. A
# fork waits for it, since its child has no thread that would ever finish; the locks are always
# taken in this order.
preparing = threading.RLock()
locks: list[Any] = [preparing]


def _before_fork() -> None:
    for lock in locks:
        lock.acquire()


def _after_fork() -> None:
    for lock in reversed(locks):
        lock.release()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(
        before=_before_fork, after_in_parent=_after_fork, after_in_child=_after_fork
    )
