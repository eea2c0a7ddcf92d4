"""Reading in a process of its own, with limits in proportion to the file.

Libraries that read files trust the counts in them: a wrong one makes them ask for any amount of
memory, read beyond their arrays, or read on for ever. So whatever they read is read here: a
function is called by name in a child that has so much address space and time, and what it returns
comes back as plain arrays, its warnings and errors as they are.

What loads a library once can read many files: on Linux a child is a fork of a process that has done
so, and waits for the next for a while (`_Server`); elsewhere each loads what it needs.
"""

from __future__ import annotations

import atexit
import builtins
import inspect
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Iterable, Mapping
from contextlib import suppress
from importlib import import_module
from typing import IO, Any

import numpy as np

from limitsurf import memory
from limitsurf.cage.checks import MeshError
from limitsurf.cage.mesh import Mesh

try:
    import resource
except ImportError:  # on Windows: a child has a limit of time alone
    resource = None  # type: ignore[assignment]

SCALE = "LIMITSURF_READ_LIMITS"  # the variable that multiplies all limits
# of a child, beside what it takes before it reads, and for each byte of the files that it reads
MEMORY, MEMORY_PER_BYTE = 300 << 20, 128
SECONDS, SECONDS_PER_BYTE = 10.0, 2e-6  # of a processor
WAIT = 2  # times as many seconds pass before the end

AN_ANSWER = 1 << 25  # bytes of points of frames that one answer has, and a frame more at most
A_WHILE = 2.0  # seconds of a processor after which no other frame is added to an answer

IDLE = 60.0  # seconds that a server waits for the next request

_START = (
    "import json, sys; request = json.loads(sys.stdin.readline()); sys.path[:] = request['path'];"
    "from limitsurf.shell.io.apart import answer; answer(request)"
)
_SERVE = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[2]);"
    "from limitsurf.shell.io.apart import serve; serve(int(sys.argv[1]), json.loads(sys.argv[3]))"
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
    try:
        code, output, said = _run(request)
    except subprocess.TimeoutExpired:
        raise MeshError(_too_slow(name, size)) from None
    if -code in _LATE:
        raise MeshError(_too_slow(name, size))
    if code < 0:
        raise MeshError(
            f"{name}: truncated or broken: its reader was ended by signal {-code}, or "
            f"{_need_memory(size)}"
        )
    if code:
        words = (said.decode(errors="replace").strip() or "nothing").splitlines()[-1]
        raise MeshError(f"{name}: truncated or broken: its reader ended with {code}: {words[:300]}")
    return _received(name, output)


def _run(request: dict[str, Any]) -> tuple[int, bytes, bytes]:
    """The exit code of a child, and what it writes to the standard output and error."""
    if sys.platform == "linux" and (server := _Server.free(request)) is not None:
        try:
            return (*server.ask(request), b"")
        except OSError:  # it has ended
            server.end()
        except BaseException:
            server.end()
            raise
        finally:
            server.lock.release()
    # where the child cannot end itself
    patience = None if _LATE else 60 + WAIT * _seconds(request["size"], request["scale"])
    done = subprocess.run(
        [sys.executable, "-P", "-c", _START],
        input=json.dumps(request).encode() + b"\n",
        capture_output=True,
        timeout=patience,
        env=os.environ | _ALONE,
    )
    return done.returncode, done.stdout, done.stderr


def allow(size: int) -> None:
    """Let a child read so many bytes more, as far as there is memory; elsewhere do nothing."""
    if _Child.started:
        most = _Child.room / (_Child.scale * MEMORY_PER_BYTE)
        _Child.size = int(max(_Child.size, min(_Child.size + size, most)))
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


class _Server:
    """A process that has loaded a library, and forks for every file that is to be read."""

    known: dict[tuple[Any, ...], _Server] = {}  # noqa: RUF012  (of all instances)

    def __init__(self, modules: list[str]) -> None:
        self.lock = threading.Lock()
        self.link, theirs = socket.socketpair()
        with theirs:
            arguments = [str(theirs.fileno()), json.dumps(sys.path), json.dumps(modules)]
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-c", _SERVE, *arguments],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=os.environ | _ALONE,
                start_new_session=True,
            )

    @classmethod
    def free(cls, request: dict[str, Any]) -> _Server | None:
        """A server, locked; None if that for the modules of a request is busy."""
        key = os.getpid(), *request["modules"]
        server = cls.known.get(key)
        if server is not None and server.process.poll() is not None:
            server.end()
            server = None
        if server is None:
            server = cls.known[key] = cls(request["modules"])
        return server if server.lock.acquire(blocking=False) else None

    def ask(self, request: dict[str, Any]) -> tuple[int, bytes]:
        """The exit code of the fork that answers a request, and its answer."""
        around = {"environment": dict(os.environ) | _ALONE, "folder": os.getcwd()}
        body = json.dumps(request | around).encode()
        reading, writing = os.pipe()
        with open(reading, "rb") as pipe:
            try:
                socket.send_fds(self.link, [len(body).to_bytes(8, "big")], [writing])
            finally:
                os.close(writing)
            self.link.sendall(body)
            content = pipe.read()
        return int.from_bytes(_exactly(self.link, 4), "big", signed=True), content

    def end(self) -> None:
        """End it and what it has begun."""
        self.link.close()
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()


@atexit.register
def _end_servers() -> None:
    for (process, *_), server in _Server.known.items():
        if process == os.getpid():
            server.end()


def _exactly(link: socket.socket, length: int) -> bytes:
    """So many bytes from a socket; OSError if it ends before."""
    blocks = []
    while length:
        block = link.recv(min(length, 1 << 16))
        if not block:
            raise OSError("the other side has ended")
        blocks.append(block)
        length -= len(block)
    return b"".join(blocks)


def serve(number: int, modules: list[str]) -> None:
    """Answer requests from a socket, as long as somebody is there and asks."""
    for each in modules:
        with suppress(ImportError):
            import_module(each)
    with socket.socket(fileno=number) as link, suppress(OSError, ValueError):
        link.settimeout(IDLE)
        while True:
            length, (writing, *_), *_ = socket.recv_fds(link, 8, 1)
            request = json.loads(_exactly(link, int.from_bytes(length, "big")))
            child = os.fork()
            if not child:
                link.close()
                os.dup2(writing, 1)
                os.close(writing)
                code = 1
                with suppress(BaseException):
                    os.environ.clear()
                    os.environ.update(request["environment"])
                    os.chdir(request["folder"])
                    sys.path[:] = request["path"]
                    answer(request)
                    code = 0
                os._exit(code)
            os.close(writing)
            status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
            link.sendall(status.to_bytes(4, "big", signed=True))


class _Child:
    """The limits of this process, if it is a child that reads."""

    started = False
    size = 0  # bytes of files
    scale = 1.0
    room = 0.0  # bytes of memory that there were, before it reads
    space = data = 2 << 30  # bytes of addresses, and of memory to write to, before it reads
    begun = (0.0, 0.0)  # seconds by the clock, and of the processor

    @classmethod
    def start(cls, size: int, factor: float) -> None:
        cls.room = memory.available()
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
