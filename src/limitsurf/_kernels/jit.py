"""How kernels are compiled: a typed decorator, and what Numba has no words for.

The intrinsics below are sums of products over short vectors of four channels, which the compiler
would not vectorise by itself, prefetching, and powers of two by their bits.
"""

from __future__ import annotations

import itertools
import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar, cast

import llvmlite
import numba
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import cpu_target
from numba.core.serialize import dumps
from numba.core.types.misc import unliteral
from numba.extending import intrinsic as _intrinsic

from limitsurf import disk_cache
from limitsurf._kernels import background, locks
from limitsurf._kernels.pipeline import Kernels, Parts, in_one_go, writable

F = TypeVar("F", bound=Callable[..., Any])
# called from kernels without the typing context that they are written with
intrinsic = cast(Callable[[Callable[..., Any]], Any], _intrinsic)


_OPTIONS: dict[str, Any] = {"fastmath": {"contract"}, "error_model": "numpy"}
# without Numba's runtime there is nothing to allocate, and no references to count in inner loops
_LEAN: dict[str, Any] = {**_OPTIONS, "_nrt": False}
_MOST = 1 << 26  # bytes of a compiled kernel
_PATIENCE = 30.0  # seconds to wait for another process that compiles the same


def kernel(function: F) -> F:
    """Compile for the types of the arguments, when first called; without the GIL, cached on disk.

    Products and sums may fuse; nothing else of the order of operations changes, so NaN, infinity,
    signed zeros and comparisons mean what they say.
    """
    return _cached(function, _OPTIONS)


def lean(function: F) -> F:
    """Compile, as `kernel` does, what allocates nothing: callers bring room to work in."""
    return _cached(function, _LEAN)


def _cached(function: F, options: dict[str, Any]) -> F:
    dispatcher = numba.njit(nogil=True, pipeline_class=Kernels, **options)(function)
    dispatcher._cache = cache = _Cache(function)
    compile_alone = dispatcher.compile

    def compile_once(given: tuple[Any, ...]) -> Any:
        """Also for arrays that are read-only: kernels write to none but those made for that."""
        signature = tuple(map(writable, given))
        with cache.reserved(signature, dispatcher.targetctx.codegen()), in_one_go(dispatcher):
            found = compile_alone(signature)
        if given != signature:
            dispatcher._insert([kind._code for kind in given], found, False)
        return found

    dispatcher.compile = compile_once
    return cast(F, dispatcher)


class _Cache(NullCache):  # type: ignore[misc]
    """Machine code of one kernel on disk, in place of Numba's own cache: a file for each signature.

    A file is a SHA-256 of its name and of what follows, a pickle: that and the machine code are
    taken from nobody who is not trusted (see `disk_cache`), and never if damaged. Numba's own would
    take both from anybody, stop at damaged files and full disks, and not read where it cannot
    write.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        code = function.__code__
        # of those that others write by these decorators nothing is marked
        self._marked = function.__module__.startswith(f"{__package__}.")
        name = f"{Path(code.co_filename).stem}.{function.__qualname__}-{code.co_firstlineno}"
        self._name = "".join(c for c in name if c not in "<>")  # which some systems do not allow
        constants = [x for x in code.co_consts if not hasattr(x, "co_code")]
        self._code = code.co_code, constants, code.co_names, _closed_over(function)

    @contextmanager
    def reserved(self, sig: Any, codegen: Any) -> Iterator[None]:
        """Let no other process compile the same meanwhile; wait for one that does, for a while."""
        name = self._file(sig, codegen)
        if disk_cache.there(name):
            yield
            return
        background.say("kernels are being compiled, which takes seconds, once on this machine")
        with disk_cache.alone(f"{name}.lock", _PATIENCE):
            yield
        disk_cache.renew()

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled kernel; None if it is to be compiled."""
        target_context.refresh()
        name = self._file(sig, target_context.codegen())
        if self._marked:
            used.setdefault(name)
        content = disk_cache.read(name, _MOST)
        if content is None or content[:32] != _digest(name, content[32:]):
            return None
        try:
            found = CompileResult._rebuild(target_context, *pickle.loads(content[32:]))
        except Exception:  # whatever the right bytes may lead to in surroundings that are not right
            return None
        if self._marked:
            used[name] = found
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled kernel, where that is possible."""
        if data.library.has_dynamic_globals:  # addresses in this process
            return
        name = self._file(sig, data.codegen)
        if self._marked:
            used[name] = data
        _keep(name, data)

    def _file(self, sig: Any, codegen: Any) -> str:
        """Where in the cache."""
        key = _key(sig, codegen.magic_tuple(), self._code)
        return f"{background.folder()}/{self._name}-{key}.nbc"


def _closed_over(function: Callable[..., Any]) -> list[Any]:
    """What tells apart kernels that one function makes for several shapes of faces.

    That is what they close over, and what functions among that close over: numbers, and modules.
    """
    found: list[Any] = []
    for cell in function.__closure__ or ():
        x = cell.cell_contents
        inner = getattr(x, "py_func", None)
        found.append(x if isinstance(x, (int, float)) else getattr(x, "__module__", ""))
        if inner is not None:
            found.append(_closed_over(inner))
    return found


def _digest(name: str, content: bytes) -> bytes:
    return sha256(name.encode() + content).digest()


def _key(*parts: Any) -> str:
    """Of what machine code depends on beside its sources."""
    versions = numba.__version__, llvmlite.__version__
    return sha256(repr((parts, versions)).encode()).hexdigest()[:32]


# files of the kernels of this process, in the order of their first use, and what they hold
used: dict[str, CompileResult | None] = {}


def _keep(name: str, kernel: CompileResult) -> None:
    content = dumps(kernel._reduce())
    disk_cache.write(name, _digest(name, content) + content)


def mark(kind: str) -> None:
    """Write down that all kernels for something are those that this process has used.

    Those which it has from another cache are kept in this one too.
    """
    for file, kernel in used.items():
        if kernel is not None and not disk_cache.there(file):
            _keep(file, kernel)
    name, content = _mark(kind), "\n".join(used).encode()
    disk_cache.write(name, _digest(name, content) + content)


def complete(kind: str) -> bool:
    """Whether all kernels for something are in the cache, for this processor."""
    name = _mark(kind)
    content = disk_cache.read(name, _MOST)
    if content is None or content[:32] != _digest(name, content[32:]):
        return False
    return all(map(disk_cache.there, content[32:].decode().split("\n")))


def _mark(kind: str) -> str:
    key = _key(kind, cpu_target.target_context.codegen().magic_tuple())
    return f"{background.folder()}/{background.MARK}{kind}-{key}"


def _part(function: F, **options: Any) -> F:
    """What is lowered once for all calls, whether or not their arguments are constants."""
    dispatcher = numba.njit(pipeline_class=Parts, **_LEAN | options)(function)
    template = dispatcher.get_call_template

    def of_all(args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
        return template(tuple(writable(unliteral(kind)) for kind in args), kws)

    dispatcher.get_call_template = of_all
    return cast(F, dispatcher)


def outlined(function: F) -> F:
    """Compile apart from the kernels that call it: in large loops, registers are scarce."""
    return _part(function)


def inlined(function: F) -> F:
    """Compile as part of the kernels that call it: arrays are costly to hand over."""
    return _part(function, forceinline=True)


def unfused(function: F) -> F:
    """Compile as `inlined` does, but each operation is rounded by itself on all machines."""
    # (without a word callers decide)
    return _part(function, forceinline=True, fastmath=False)


# a fork while another thread compiles must not leave the lock held for ever in the child
locks.locks.append(global_compiler_lock)

_I8, _I32, _I64, _F64 = ir.IntType(8), ir.IntType(32), ir.IntType(64), ir.DoubleType()
_FOUR = ir.VectorType(_F64, 4)
_UNDEFINED = ir.Constant(_FOUR, ir.Undefined)


def _data(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Pointer to the first element of an array."""
    return context.make_array(kind)(context, builder, value).data


def _vector(builder: Any, pointer: Any, index: Any) -> Any:
    """Pointer to the four numbers from `index` on."""
    return builder.bitcast(builder.gep(pointer, [index]), _FOUR.as_pointer())


def _spread(builder: Any, pointer: Any, index: Any) -> Any:
    """The number at `index`, four times."""
    one = builder.insert_element(_UNDEFINED, builder.load(builder.gep(pointer, [index])), _I32(0))
    return builder.shuffle_vector(one, _UNDEFINED, ir.Constant(ir.VectorType(_I32, 4), [0] * 4))


def _added(builder: Any, total: Any, a: Any, b: Any) -> Any:
    """Total + a b, fused where the machine can; a b to begin with."""
    if total is None:
        return builder.fmul(a, b)
    form = ir.FunctionType(_FOUR, [_FOUR] * 3)
    fused = cgutils.get_or_insert_function(builder.module, form, "llvm.fmuladd.v4f64")
    return builder.call(fused, [a, b, total])


@intrinsic
def prefetch(typing: Any, array: Any, index: Any) -> Any:
    """Ask for the cache line of ``array.ravel()[index]``; harmless wherever that is."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = builder.gep(
            _data(context, builder, signature.args[0], arguments[0]), [arguments[1]]
        )
        form = ir.FunctionType(ir.VoidType(), [_I8.as_pointer(), _I32, _I32, _I32])
        ask = cgutils.get_or_insert_function(builder.module, form, "llvm.prefetch.p0")
        builder.call(ask, [builder.bitcast(pointer, _I8.as_pointer()), _I32(0), _I32(3), _I32(1)])
        return context.get_dummy_value()

    return types.void(array, types.int64), generate


@intrinsic
def bits(typing: Any, x: Any) -> Any:
    """The bits of a float64 as an int64."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], _I64)

    return types.int64(types.float64), generate


@intrinsic
def of_bits(typing: Any, x: Any) -> Any:
    """The float64 of these bits."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], _F64)

    return types.float64(types.int64), generate


@intrinsic
def store(typing: Any, addresses: Any, k: Any, place: Any, x: Any) -> Any:
    """Write a float64 to place number `place` from address number `k` on."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        addresses = _data(context, builder, signature.args[0], arguments[0])
        start = builder.load(builder.gep(addresses, [arguments[1]]))
        pointer = builder.inttoptr(start, _F64.as_pointer())
        builder.store(arguments[3], builder.gep(pointer, [arguments[2]]))
        return context.get_dummy_value()

    return types.void(addresses, types.int64, types.int64, types.float64), generate


def _points(context: Any, builder: Any, given: Any, arguments: Any) -> Callable[[int], Any]:
    """Four channels of the k-th control point, from (points, ids, at, base, channel, ...)."""
    data, ids = (_data(context, builder, given[k], arguments[k]) for k in (0, 1))
    array = context.make_array(given[0])(context, builder, arguments[0])
    width = builder.extract_value(array.shape, 1)

    def point(k: int) -> Any:
        place = builder.gep(ids, [builder.add(arguments[2], _I64(k))])
        number = builder.add(builder.sext(builder.load(place), _I64), arguments[3])
        start = builder.add(builder.mul(number, width), arguments[4])
        return builder.load(_vector(builder, data, start), align=8)

    return point


def _largest(builder: Any, largest: Any, values: Any) -> Any:
    """The larger ones of four values and the sizes of four others."""
    absolute = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(_FOUR, [_FOUR]), "llvm.fabs.v4f64"
    )
    sizes = builder.call(absolute, [values])
    return builder.select(builder.fcmp_ordered(">", sizes, largest), sizes, largest)


def bicubic(order: int, sized: bool = False) -> Any:
    """An intrinsic for derivatives up to an order of a bicubic patch, four channels at once.

    ``f(points, ids, at, base, channel, weights, out)``: points (n, width) float64; flat ids from
    `at` on, plus `base`, are the rows of 16 control points; weights (2, order + 1, 4) along u and v
    by order of the derivative; out (count, 4), in the order of `LimitSurface.jet`. All is relative
    to control point 5; if `sized`, a last row of `out` has the largest absolute values of any
    control point.
    """
    terms = [(m - j, j) for m in range(order + 1) for j in range(m + 1)]

    @intrinsic
    def contract(
        typing: Any, points: Any, ids: Any, at: Any, base: Any, channel: Any, weights: Any,
        out: Any,
    ) -> Any:  # fmt: skip
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            given = signature.args
            point = _points(context, builder, given, arguments)
            weights, out = (_data(context, builder, given[k], arguments[k]) for k in (5, 6))
            origin = point(5)
            along, across = (
                [
                    [_spread(builder, weights, _I64(first + 4 * m + k)) for k in range(4)]
                    for m in range(order + 1)
                ]
                for first in (0, 4 * (order + 1))
            )
            found: list[Any] = [None] * len(terms)
            largest = ir.Constant(_FOUR, None)
            for j in range(4):
                rows: list[Any] = [None] * (order + 1)
                for i in range(4):
                    own = builder.fsub(point(4 * j + i), origin)
                    if sized:
                        largest = _largest(builder, largest, own)
                    for m in range(order + 1):
                        rows[m] = _added(builder, rows[m], along[m][i], own)
                for k, (m, n) in enumerate(terms):
                    found[k] = _added(builder, found[k], across[n][j], rows[m])
            for k, value in enumerate([*found, largest] if sized else found):
                builder.store(value, _vector(builder, out, _I64(4 * k)), align=8)
            return context.get_dummy_value()

        places = [types.int64] * 3
        return types.void(points, ids, *places, weights, out), generate

    return contract


def gathered(size: int, own: int, count: int, sized: bool = False) -> Any:
    """An intrinsic for `count` sums of products of control points, four channels at once.

    ``f(points, ids, at, base, channel, weights, scale, out)``: points (n, width) float64; flat ids
    from `at` on, plus `base`, are the rows of `size` control points, taken relative to number
    `own`; flat weights (count, size), all times `scale`; out (count, 4). If `sized`, a last row of
    `out` has the largest absolute values of any control point.
    """

    @intrinsic
    def contract(
        typing: Any, points: Any, ids: Any, at: Any, base: Any, channel: Any, weights: Any,
        scale: Any, out: Any,
    ) -> Any:  # fmt: skip
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            given = signature.args
            point = _points(context, builder, given, arguments)
            weights, out = (_data(context, builder, given[k], arguments[k]) for k in (5, 7))
            origin = point(own)
            found: list[Any] = [None] * count
            largest = ir.Constant(_FOUR, None)
            for k in range(size):
                if k == own:
                    continue
                near = builder.fsub(point(k), origin)
                if sized:
                    largest = _largest(builder, largest, near)
                for row in range(count):
                    weight = _spread(builder, weights, _I64(row * size + k))
                    found[row] = _added(builder, found[row], weight, near)
            one = builder.insert_element(_UNDEFINED, arguments[6], _I32(0))
            scale = builder.shuffle_vector(
                one, _UNDEFINED, ir.Constant(ir.VectorType(_I32, 4), [0] * 4)
            )
            found = [builder.fmul(x, scale) for x in found]
            for k, value in enumerate([*found, largest] if sized else found):
                builder.store(value, _vector(builder, out, _I64(4 * k)), align=8)
            return context.get_dummy_value()

        places = [types.int64] * 3
        return types.void(points, ids, *places, weights, types.float64, out), generate

    return contract


def polynomials(order: int, degrees: tuple[int, ...]) -> Any:
    """An intrinsic for polynomials at one place, four at once.

    Of degree ``degrees[j]`` in S beside ``T^j``, which do not grow with j.
    ``f(c, at, size, S, T, rows)``: coefficients c (..., stride) float64, from place `at` on rows of
    `size` polynomials, a multiple of four, a row for each ``S^i T^j``, by j, then i; rows
    (6 or more, stride) get all derivatives up to the order, in the order of `LimitSurface.jet`.
    """
    starts = [sum(degrees[:j]) + j for j in range(len(degrees))]

    @intrinsic
    def evaluate(typing: Any, c: Any, at: Any, size: Any, S: Any, T: Any, rows: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            given = signature.args
            array = context.make_array(given[5])(context, builder, arguments[5])
            stride = builder.extract_value(array.shape, 1)
            data, rows = (_data(context, builder, given[k], arguments[k]) for k in (0, 5))
            _, at, size, S, T, _ = arguments

            def four(x: Any) -> Any:
                one = builder.insert_element(_UNDEFINED, x, _I32(0))
                same = ir.Constant(ir.VectorType(_I32, 4), [0] * 4)
                return builder.shuffle_vector(one, _UNDEFINED, same)

            def powers(x: Any, degree: int) -> list[list[Any]]:
                """Factors of the coefficients of a polynomial in its derivatives, but the first."""
                of = [x]
                for _ in range(1, degree):
                    of.append(builder.fmul(x, of[-1]))

                def times(counts: Any) -> list[Any]:
                    counts = [ir.Constant(_FOUR, [float(k)] * 4) for k in counts]
                    return [builder.fmul(k, y) for k, y in zip(counts, of, strict=False)]

                first, second = range(2, degree + 1), range(2, degree)
                return [of, times(first), times([k * (k + 1) for k in second])]

            def value(terms: list[Any], powers: list[list[Any]], times: int) -> Any:
                total = terms[times]
                if times == 2:
                    total = builder.fadd(total, total)
                for factor, term in zip(powers[times], terms[times + 1 :], strict=False):
                    total = _added(builder, total, factor, term)
                return total

            S, T = powers(four(S), degrees[0]), powers(four(T), len(degrees) - 1)
            with cgutils.for_range(builder, builder.udiv(size, _I64(4)), intp=_I64) as loop:
                k = builder.mul(loop.index, _I64(4))
                start = builder.add(at, k)
                grid = [
                    [
                        builder.load(
                            _vector(
                                builder,
                                data,
                                builder.add(start, builder.mul(stride, _I64(first + i))),
                            ),
                            align=8,
                        )
                        for i in range(degree + 1)
                    ]
                    for first, degree in zip(starts, degrees, strict=True)
                ]
                for m in range(order + 1):
                    along = [value(row, S, m) for row in grid if len(row) > m]
                    for n in range(order + 1 - m):
                        number = (m + n) * (m + n + 1) // 2 + n
                        place = builder.add(builder.mul(stride, _I64(number)), k)
                        found = value(along, T, n)
                        builder.store(found, _vector(builder, rows, place), align=8)
            return context.get_dummy_value()

        given = c, types.int64, types.int64, types.float64, types.float64, rows
        return types.void(*given), generate

    return evaluate


def scaling(count: int) -> Any:
    """An intrinsic that multiplies `count` rows by the products of two, four numbers at once.

    ``f(rows, size, factors, a, b)``: rows (count or more, ...) float64, of which the first `size`
    numbers count, a multiple of four; factors are ``factors[a + k] * factors[b + k]``, flat.
    """

    @intrinsic
    def scale(typing: Any, rows: Any, size: Any, factors: Any, a: Any, b: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            given = signature.args
            array = context.make_array(given[0])(context, builder, arguments[0])
            stride = builder.extract_value(array.shape, 1)
            rows, factors = (_data(context, builder, given[k], arguments[k]) for k in (0, 2))
            _, size, _, a, b = arguments
            with cgutils.for_range(builder, builder.udiv(size, _I64(4)), intp=_I64) as loop:
                k = builder.mul(loop.index, _I64(4))
                x, y = (
                    builder.load(_vector(builder, factors, builder.add(start, k)), align=8)
                    for start in (a, b)
                )
                factor = builder.fmul(x, y)
                for row in range(count):
                    place = _vector(builder, rows, builder.add(builder.mul(stride, _I64(row)), k))
                    builder.store(
                        builder.fmul(builder.load(place, align=8), factor), place, align=8
                    )
            return context.get_dummy_value()

        return types.void(rows, types.int64, factors, types.int64, types.int64), generate

    return scale


def differences(size: int, own: int) -> Any:
    """An intrinsic for `size` control points relative to number `own`, four channels at once.

    ``f(points, extras, ids, at, channel, near)``: points (n, width) float64; flat ids from `at` on
    are rows of it, or from n on of extras (m, 2 width), unevaluated sums of two. near (size, 4)
    gets four channels.
    """

    @intrinsic
    def subtract(
        typing: Any, points: Any, extras: Any, ids: Any, at: Any, channel: Any, near: Any
    ) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            given = signature.args
            data, more, ids, near = (
                _data(context, builder, given[k], arguments[k]) for k in (0, 1, 2, 5)
            )
            array = context.make_array(given[0])(context, builder, arguments[0])
            n, width = (builder.extract_value(array.shape, axis) for axis in (0, 1))
            nothing = cgutils.alloca_once(builder, _FOUR)
            builder.store(ir.Constant(_FOUR, None), nothing)
            nothing = builder.bitcast(nothing, _FOUR.as_pointer())

            def point(k: int) -> tuple[Any, Any]:
                place = builder.gep(ids, [builder.add(arguments[3], _I64(k))])
                number = builder.sext(builder.load(place), _I64)
                extra = builder.icmp_signed(">=", number, n)
                row = builder.mul(builder.mul(builder.sub(number, n), width), _I64(2))
                other = builder.add(row, arguments[4])
                inner = builder.add(builder.mul(number, width), arguments[4])
                high = _vector(builder, data, inner)
                high = builder.select(extra, _vector(builder, more, other), high)
                low = _vector(builder, more, builder.add(other, width))
                low = builder.select(extra, low, nothing)
                return builder.load(high, align=8), builder.load(low, align=8)

            high, low = point(own)
            for k in range(size):
                first, second = point(k)
                step = builder.fadd(builder.fsub(first, high), builder.fsub(second, low))
                builder.store(step, _vector(builder, near, _I64(4 * k)), align=8)
            return context.get_dummy_value()

        given = points, extras, ids, types.int64, types.int64, near
        return types.void(*given), generate

    return subtract


def combination(count: int) -> Any:
    """An intrinsic for `count` sums of products, four channels at once.

    ``f(rows, size, values, at, width, out)``: rows (count or more, ...) float64, of which the first
    `size` numbers count, a multiple of four; flat values from `at` on are (size, width), of which
    the first four columns count; out (count, 4).
    """
    # enough sums side by side to hide how long each addition takes
    parts = 4 if count < 3 else 2

    @intrinsic
    def contract(
        typing: Any, rows: Any, size: Any, values: Any, at: Any, width: Any, out: Any
    ) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            given = signature.args
            array = context.make_array(given[0])(context, builder, arguments[0])
            stride = builder.extract_value(array.shape, 1)
            rows, values, out = (_data(context, builder, given[k], arguments[k]) for k in (0, 2, 5))
            _, size, _, at, width, _ = arguments
            totals = [
                [cgutils.alloca_once(builder, _FOUR) for _ in range(count)] for _ in range(parts)
            ]
            for total in itertools.chain(*totals):
                builder.store(ir.Constant(_FOUR, None), total)
            with cgutils.for_range(builder, builder.udiv(size, _I64(parts)), intp=_I64) as loop:
                for part in range(parts):
                    k = builder.add(builder.mul(loop.index, _I64(parts)), _I64(part))
                    start = builder.add(at, builder.mul(k, width))
                    value = builder.load(_vector(builder, values, start), align=8)
                    for row, total in enumerate(totals[part]):
                        place = builder.add(builder.mul(stride, _I64(row)), k)
                        weight = _spread(builder, rows, place)
                        builder.store(_added(builder, builder.load(total), weight, value), total)
            for row in range(count):
                found = [builder.load(totals[part][row]) for part in range(parts)]
                while len(found) > 1:
                    found = [
                        builder.fadd(a, b) for a, b in zip(found[::2], found[1::2], strict=True)
                    ]
                builder.store(found[0], _vector(builder, out, _I64(4 * row)), align=8)
            return context.get_dummy_value()

        given = (rows, types.int64, values, types.int64, types.int64, out)
        return types.void(*given), generate

    return contract


def products(channels: int) -> Any:
    """An intrinsic for sums of products at eight places at once, for some channels.

    ``f(weights, at, size, stride, values, first, width, out, k, begin)``: flat weights from `at` on
    are rows of `stride`, of which the first eight count; flat values from `first` on are rows of
    `width`, of which the first `channels` count; of both there are `size` rows. The sums go to
    ``out[k, :channels, begin:begin + 8]``.
    """

    @intrinsic
    def contract(
        typing: Any, weights: Any, at: Any, size: Any, stride: Any, values: Any, first: Any,
        width: Any, out: Any, k: Any, begin: Any,
    ) -> Any:  # fmt: skip
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            given = signature.args
            array = context.make_array(given[7])(context, builder, arguments[7])
            planes, length = (builder.extract_value(array.shape, axis) for axis in (1, 2))
            weights, values, out = (
                _data(context, builder, given[k], arguments[k]) for k in (0, 4, 7)
            )
            _, at, size, stride, _, first, width, _, row_of_out, begin = arguments
            totals = [
                [cgutils.alloca_once(builder, _FOUR) for _ in range(2)] for _ in range(channels)
            ]
            for total in itertools.chain(*totals):
                builder.store(ir.Constant(_FOUR, None), total)
            with cgutils.for_range(builder, size, intp=_I64) as loop:
                start = builder.add(at, builder.mul(loop.index, stride))
                halves = [
                    builder.load(_vector(builder, weights, builder.add(start, _I64(k))), align=8)
                    for k in (0, 4)
                ]
                row = builder.add(first, builder.mul(loop.index, width))
                for c, pair in enumerate(totals):
                    value = _spread(builder, values, builder.add(row, _I64(c)))
                    for half, total in zip(halves, pair, strict=True):
                        builder.store(_added(builder, builder.load(total), half, value), total)
            plane = builder.mul(row_of_out, planes)
            for c, pair in enumerate(totals):
                row = builder.mul(builder.add(plane, _I64(c)), length)
                for k, total in enumerate(pair):
                    place = builder.add(builder.add(row, begin), _I64(4 * k))
                    builder.store(builder.load(total), _vector(builder, out, place), align=8)
            return context.get_dummy_value()

        whole = types.int64
        given = (
            weights, whole, whole, whole, values, whole, whole, out, whole, whole,
        )  # fmt: skip
        return types.void(*given), generate

    return contract
