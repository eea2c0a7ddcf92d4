"""Reading in a process of its own, with limits in proportion to the file.

Libraries that read files trust the counts in them: a wrong one makes them ask for any amount of
memory, read beyond their arrays, or read on for ever. So whatever they read is read here: a
function is called by name in a child that has so much address space and time, and what it returns
comes back as plain arrays, its warnings and errors as they are.
"""

from __future__ import annotations

import builtins
import inspect
import json
import os
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Iterable, Mapping
from contextlib import suppress
from importlib import import_module
from typing import IO, Any

import numpy as np

from limitsurf.mesh import Mesh, MeshError

try:
    import resource
except ImportError:  # on Windows: a child has a limit of time alone
    resource = None  # type: ignore[assignment]

SCALE = "LIMITSURF_READ_LIMITS"  # the variable that multiplies all limits
# of a child, beside what it takes before it reads, and for each byte of the files that it reads
MEMORY, MEMORY_PER_BYTE = 300 << 20, 128
SECONDS, SECONDS_PER_BYTE = 10.0, 2e-6  # of a processor
WAIT = 2  # times as many seconds pass before the end

_START = (
    "import json, sys; request = json.loads(sys.stdin.readline()); sys.path[:] = request['path'];"
    "from limitsurf.shell.apart import answer; answer(request)"
)
# one thread: each takes address space, whose amount would depend on the number of processors
_ALONE = dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "PXR_WORK_THREAD_LIMIT"), "1"
) | {"MALLOC_ARENA_MAX": "1", "PYTHONWARNINGS": "", "PYTHONIOENCODING": "utf-8"}
_LATE = [getattr(signal, name) for name in ("SIGALRM", "SIGXCPU") if hasattr(signal, name)]
_LIBRARIES = 1 << 30  # bytes of addresses for those that are loaded later
_ALIGNED = 64  # bytes at whose multiples arrays begin in an answer


def scale() -> float:
    """What limits are multiplied by."""
    given = os.environ.get(SCALE, "1")
    try:
        factor = float(given)
    except ValueError:
        factor = np.nan
    if not factor > 0:
        raise ValueError(f"the environment variable {SCALE} must be a number > 0, got {given!r}")
    return factor


def read_apart(
    name: str,
    size: int,
    function: str,
    *arguments: Any,
    modules: Iterable[str] = (),
    **options: Any,
) -> Any:
    """What a function returns, called in a process of its own.

    Parameters
    ----------
    name : str
        Of the file, for messages.
    size : int
        Of the file, which limits are in proportion to; `allow` adds that of others.
    function : str
        As "module:function". It returns a mesh, or arrays in tuples, lists and dicts.
    *arguments, **options
        What JSON holds.
    modules : iterable of str
        What to import before limits hold, if it can be.

    Raises
    ------
    MeshError
        Without an answer within the limits; otherwise whatever the function raises.

    Warns
    -----
    Warning
        Whatever the function warns of.
    """
    request = {
        "path": sys.path,
        "function": function,
        "arguments": arguments,
        "options": options,
        "modules": list(modules),
        "size": size,
        "scale": scale(),
    }
    # where the child cannot end itself
    patience = None if _LATE else 60 + WAIT * _seconds(size, scale())
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", _START],
            input=json.dumps(request).encode() + b"\n",
            capture_output=True,
            timeout=patience,
            env=os.environ | _ALONE,
        )
    except subprocess.TimeoutExpired:
        raise MeshError(_too_slow(name, size)) from None
    if -done.returncode in _LATE:
        raise MeshError(_too_slow(name, size))
    if done.returncode < 0:
        raise MeshError(
            f"{name}: truncated or broken: its reader was ended by signal {-done.returncode}, or "
            f"{_need_memory(size)}"
        )
    if done.returncode:
        said = (done.stderr.decode(errors="replace").strip() or "nothing").splitlines()[-1]
        raise MeshError(
            f"{name}: truncated or broken: its reader ended with {done.returncode}: {said[:300]}"
        )
    return _received(name, done.stdout)


def allow(size: int) -> None:
    """Let a child read so many bytes more; elsewhere do nothing."""
    if _Child.started:
        _Child.size += size
        _Child.limit()


def _seconds(size: int, factor: float) -> float:
    return factor * (SECONDS + SECONDS_PER_BYTE * size)


def _memory(size: int, factor: float) -> int:
    return int(min(factor * (MEMORY + MEMORY_PER_BYTE * size), 2**62))


def _too_slow(name: str, size: int) -> str:
    return (
        f"{name}: reading it takes more than {_seconds(size, scale()):.0f} s, the limit for "
        f"{size} bytes: broken, or {_remedy()}"
    )


def _need_memory(size: int) -> str:
    return (
        f"reading it takes more than {_memory(size, scale()) >> 20} MiB of memory, the limit for "
        f"{size} bytes: {_remedy()}"
    )


def _remedy() -> str:
    return f"if you trust the file, set the environment variable {SCALE}={4 * scale():g}"


def _received(name: str, content: bytes) -> Any:
    """The value in an answer; its warnings are warned of, its error raised."""
    head, _, _ = content.partition(b"\n")
    answer = json.loads(head)
    place, arrays = _aligned(len(head) + 1), []
    for kind, shape in answer.get("arrays", ()):
        found = np.ndarray(shape, kind, content, place)
        arrays.append(found)
        place += _aligned(found.nbytes)
    for category, message in answer["warnings"]:
        warnings.warn(message, getattr(builtins, category, UserWarning), stacklevel=5)
    if "memory" in answer:
        raise MeshError(f"{name}: {_need_memory(answer['memory'])}")
    if "error" in answer:
        kind, words, culprits = answer["error"]
        error = MeshError(*words) if kind == "MeshError" else getattr(builtins, kind)(*words)
        if culprits is not None:
            error.culprits = _unpacked(culprits, arrays)
        raise error
    return _unpacked(answer["value"], arrays)


def _aligned(length: int) -> int:
    return -(-length // _ALIGNED) * _ALIGNED


def _unpacked(value: Any, arrays: list[Any]) -> Any:
    if not isinstance(value, list):
        return value
    kind, content = value
    if kind == "array":
        return arrays[content]
    if kind == "mesh":
        return Mesh(**_unpacked(content, arrays))
    if kind == "dict":
        return {key: _unpacked(item, arrays) for key, item in content}
    items = [_unpacked(item, arrays) for item in content]
    return tuple(items) if kind == "tuple" else items


def _packed(value: Any, arrays: list[Any]) -> Any:
    """A value as JSON holds it, its arrays put aside."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, np.ndarray):
        if value.dtype.hasobject:
            return ["list", [_packed(item, arrays) for item in value]]
        arrays.append(np.ascontiguousarray(value))
        return ["array", len(arrays) - 1]
    if isinstance(value, Mesh):
        # all that a mesh is made of has the name of the argument
        others = list(inspect.signature(Mesh).parameters)[2:]
        given = {name: getattr(value, name) for name in others}
        given |= {"points": value.points, "faces": (value.sizes, value.indices)}
        return ["mesh", _packed(given, arrays)]
    if isinstance(value, Mapping):
        return ["dict", [[key, _packed(item, arrays)] for key, item in value.items()]]
    kind = "tuple" if isinstance(value, tuple) else "list"
    return [kind, [_packed(item, arrays) for item in value]]


class _Child:
    """The limits of this process, if it is a child that reads."""

    started = False
    size = 0  # bytes of files
    scale = 1.0
    space = data = 2 << 30  # bytes of addresses, and of memory to write to, before it reads
    begun = (0.0, 0.0)  # seconds by the clock, and of the processor

    @classmethod
    def start(cls, size: int, factor: float) -> None:
        cls.size, cls.scale, cls.begun = size, factor, (time.monotonic(), time.process_time())
        with suppress(OSError), open("/proc/self/statm", "rb") as file:
            pages = list(map(int, file.read().split()))
            cls.space, cls.data = (pages[k] * os.sysconf("SC_PAGE_SIZE") for k in (0, 5))
        cls.started = True
        _limit("RLIMIT_CORE", 0)
        _limit("RLIMIT_FSIZE", 1 << 26)  # what it prints, at the most
        for number in (signal.SIGINT, *_LATE):  # however they were
            signal.signal(number, signal.SIG_DFL)
        cls.limit()

    @classmethod
    def limit(cls, more: int = 0) -> None:
        clock, processor = cls.begun
        seconds = _seconds(cls.size, cls.scale)
        memory = _memory(cls.size, cls.scale) + more
        _limit("RLIMIT_DATA", cls.data + memory)
        _limit("RLIMIT_AS", cls.space + _LIBRARIES + memory)  # where that is not all
        _limit("RLIMIT_CPU", int(processor + seconds) + 1)
        if hasattr(signal, "setitimer"):
            left = clock + WAIT * seconds - time.monotonic()
            signal.setitimer(signal.ITIMER_REAL, max(left, 1e-3))


def _limit(name: str, value: int) -> None:
    """Set a limit of this process, as far as the system knows and allows it."""
    with suppress(AttributeError, ValueError, OSError):
        kind = getattr(resource, name)
        hard = resource.getrlimit(kind)[1]
        known = hard != resource.RLIM_INFINITY
        resource.setrlimit(kind, (min(value, hard) if known else value, hard))


def answer(request: dict[str, Any]) -> None:
    """Call the function of a request, and write what comes of it to the standard output."""
    with os.fdopen(os.dup(1), "wb") as output, open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 1)  # for readers that print
        os.dup2(nowhere.fileno(), 2)
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            for silent in (DeprecationWarning, PendingDeprecationWarning, ImportWarning):
                warnings.simplefilter("ignore", silent)
            warnings.simplefilter("ignore", ResourceWarning)
            found: dict[str, Any] = {}
            arrays: list[Any] = []
            try:
                found["value"] = _packed(_called(request), arrays)
            except MemoryError:
                _Child.limit(1 << 26)  # for the answer
                found["memory"] = _Child.size
            except Exception as error:
                if "bad_alloc" in str(error):  # of C++
                    found["memory"] = _Child.size
                found["error"] = _packed_error(error)
        found["warnings"] = [[item.category.__name__, str(item.message)] for item in said]
        found["arrays"] = [[array.dtype.str, array.shape] for array in arrays]
        _send(output, found, arrays)


def _called(request: dict[str, Any]) -> Any:
    module, _, name = request["function"].partition(":")
    for each in request["modules"]:
        with suppress(ImportError):
            import_module(each)
    function = getattr(import_module(module), name)
    _Child.start(request["size"], request["scale"])
    return function(*request["arguments"], **request["options"])


def _packed_error(error: Exception) -> list[Any]:
    kind = type(error)
    while kind is not MeshError and getattr(builtins, kind.__name__, None) is not kind:
        kind = kind.__base__  # type: ignore[assignment]
    plain = all(x is None or isinstance(x, (bool, int, float, str)) for x in error.args)
    words = list(error.args) if plain else [str(error)]
    if not plain and issubclass(kind, UnicodeError):  # which has arguments of its own
        kind = ValueError
    if isinstance(error, OSError) and plain and error.filename is not None:
        words.append(os.fsdecode(error.filename))
    culprits = getattr(error, "culprits", None)
    return [kind.__name__, words, None if culprits is None else _packed(culprits, [])]


def _send(output: IO[bytes], found: dict[str, Any], arrays: list[Any]) -> None:
    head = json.dumps(found).encode() + b"\n"
    output.write(head.ljust(_aligned(len(head))))
    for array in arrays:
        output.write(array.reshape(-1).view(np.uint8).data)
        output.write(bytes(_aligned(array.nbytes) - array.nbytes))
