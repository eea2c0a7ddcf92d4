"""How much memory there is, and refusing what will not fit before it is begun."""

from __future__ import annotations

import os
import re
from contextlib import suppress

try:
    import resource
except ImportError:  # on Windows
    resource = None  # type: ignore[assignment]

__all__ = ["available", "refuse_beyond"]


def available() -> float:
    """Bytes that this process could take yet, infinity where the system does not say."""
    found = [float("inf")]
    with suppress(OSError, ValueError, AttributeError):
        found.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    with suppress(OSError), open("/proc/meminfo") as file:
        rows = dict(re.findall(r"(?m)^(MemAvailable|SwapFree): *(\d+) kB$", file.read()))
        if "MemAvailable" in rows:
            found.append(1024 * sum(map(int, rows.values())))
    with suppress(OSError, ValueError):  # of a container; "max" is no number
        most, taken = (int(_text(f"/sys/fs/cgroup/memory.{name}")) for name in ("max", "current"))
        found.append(most - taken)
    with suppress(OSError, ValueError, AttributeError):
        most, _ = resource.getrlimit(resource.RLIMIT_AS)
        if most != resource.RLIM_INFINITY:
            pages = int(_text("/proc/self/statm").split()[0])
            found.append(most - pages * os.sysconf("SC_PAGE_SIZE"))
    return max(min(found), 0)


def _text(path: str) -> str:
    with open(path) as file:
        return file.read()


def refuse_beyond(number: int, each: int, what: str, advice: str = "") -> None:
    """Refuse so many things, of so many bytes each, if there is not as much memory.

    Raises
    ------
    MemoryError
        With both amounts, and advice on what fits.

    Examples
    --------
    >>> from limitsurf.memory import refuse_beyond
    >>> refuse_beyond(10**6, 8, "numbers")
    >>> refuse_beyond(10**30, 8, "numbers")  # doctest: +IGNORE_EXCEPTION_DETAIL
    Traceback (most recent call last):
    MemoryError: 1e+30 numbers take some 7.5e+21 GiB of memory, of which 20 are available
    """
    room = available()
    if number * each > room:
        raise MemoryError(
            f"{_short(number)} {what} take some {_short(number * each, 2**30)} GiB of memory, "
            f"of which {room / 2**30:.3g} are available{advice and f': {advice}'}"
        )


def _short(number: int, unit: int = 1) -> str:
    """A number in some units, which may be beyond float64."""
    return f"{number / unit:.3g}" if number < 10**300 else "more than 1e300"
