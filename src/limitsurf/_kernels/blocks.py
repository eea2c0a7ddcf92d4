"""Arrays by their addresses: one prepared block in place of many arguments.

Handing 25 arrays to a kernel costs more than the query that it answers; a block is one array.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from operator import index
from typing import Any

import numpy as np
from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.core.datamodel import register_default as register_model
from numba.core.imputils import lower_getattr_generic
from numba.core.types import UniTuple  # type: ignore[attr-defined]
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.np.arrayobj import populate_array
from numba.np.numpy_support import as_dtype
from numpy.typing import NDArray

from limitsurf._kernels.jit import intrinsic

Array = NDArray[Any]
_SLOT = 5  # words of a field: a number, or an address and the shape


class Block:
    """Where the fields of named tuples are: arrays and integers of some kinds, by number.

    Kernels believe what a block says: arrays must be of the types that they know.

    Attributes
    ----------
    words : ndarray
        What kernels take, int64. It is valid as long as the block, which keeps the arrays alive.

    Examples
    --------
    >>> import numpy as np
    >>> from numba.core.types import float64, int64
    >>> from limitsurf._kernels.blocks import Block
    >>> Block([(int64, float64[:, ::1])], (7, np.zeros((2, 3)))).words[[0, 6, 7]].tolist()
    [7, 2, 3]
    """

    def __init__(self, kinds: Sequence[tuple[Any, ...]], *tuples: tuple[Any, ...]) -> None:
        self._given = kinds, *tuples
        flat = [*chain(*kinds)], [*chain(*tuples)]
        slots = np.zeros((len(flat[0]), _SLOT), dtype=np.int64)
        for k, (words, kind, field) in enumerate(zip(slots, *flat, strict=True)):
            if not isinstance(kind, types.Array):
                words[0] = index(field)
                continue
            wanted = as_dtype(kind.dtype), kind.ndim
            if (field.dtype, field.ndim) != wanted or not field.flags.carray:
                raise TypeError(f"field {k} of a block must be a contiguous array of {wanted}")
            words[: field.ndim + 1] = field.ctypes.data, *field.shape
        self.words: Array = slots.reshape(-1)

    def __reduce__(self) -> tuple[type[Block], tuple[Any, ...]]:
        # addresses are of this process and of these arrays
        return type(self), self._given


def _placed(context: Any, builder: Any, kind: Any, pointer: Any, shape: Any) -> Any:
    """A contiguous array of some type and shape at an address."""
    made = context.make_array(kind)(context, builder)
    item = context.get_abi_sizeof(context.get_data_type(kind.dtype))
    size = context.get_constant(types.intp, item)
    strides = [size]
    for n in shape[:0:-1]:
        strides.insert(0, builder.mul(strides[0], n))
    data = builder.bitcast(pointer, made.data.type)
    populate_array(made, data=data, shape=shape, strides=strides, itemsize=size, meminfo=None)
    return made._getvalue()


class Fields(types.Type):
    """Fields of a named tuple in a block, by one address: they are read where they are used.

    As tuples of arrays, each call between parts of kernels would hand over two hundred numbers.
    """

    def __init__(self, made: Any, first: int, kinds: tuple[Any, ...]) -> None:
        self.fields = {name: (first + k, kinds[k]) for k, name in enumerate(made._fields)}
        super().__init__(f"Fields({made.__name__}, {first})")


@register_model(Fields)
class _Model(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, cgutils.intp_t.as_pointer())


@infer_getattr
class _Kinds(AttributeTemplate):  # type: ignore[misc]
    key = Fields

    def generic_resolve(self, fields: Any, name: str) -> Any:
        return fields.fields[name][1]


def _field(context: Any, builder: Any, fields: Any, data: Any, name: str) -> Any:
    """A field, from words that nobody writes to while kernels run."""
    k, kind = fields.fields[name]

    def word(n: int) -> Any:
        found = builder.load(builder.gep(data, [context.get_constant(types.intp, n)]))
        found.set_metadata("invariant.load", builder.module.add_metadata([]))
        return found

    value = word(_SLOT * k)
    if not isinstance(kind, types.Array):
        return value
    shape = [word(_SLOT * k + 1 + axis) for axis in range(kind.ndim)]
    return _placed(context, builder, kind, builder.inttoptr(value, cgutils.voidptr_t), shape)


lower_getattr_generic(Fields)(_field)


def unpacking(made: type, first: int, kinds: tuple[Any, ...]) -> Any:
    """An intrinsic for a named tuple whose fields are in a block from number `first` on.

    ``f(words)``; `kinds` are types of the fields, contiguous arrays and integers.
    """
    fields = Fields(made, first, kinds)

    @intrinsic
    def unpack(typing: Any, words: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return context.make_array(signature.args[0])(context, builder, arguments[0]).data

        return fields(words), generate

    return unpack


def within(kind: Any) -> Any:
    """An intrinsic for an array of a type, of items of 8 bytes, in the room of a flat one.

    ``f(room, at, shape)``: from item `at` on.
    """

    @intrinsic
    def place(typing: Any, room: Any, at: Any, shape: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
            pointer = builder.gep(data, [arguments[1]])
            sizes = cgutils.unpack_tuple(builder, arguments[2])
            return _placed(context, builder, kind, pointer, sizes)

        sizes = UniTuple(types.int64, kind.ndim)
        return kind(room, types.int64, sizes), generate

    return place
