"""Records lent to kernels: a pointer to a named tuple of arrays and numbers, whose fields are read by name.

With fifty arrays as arguments of every kernel, compile time would go into the arguments, and a call from Python would
take 6 us. A `Loan` lays out a record in memory as compiled code does, word by word, and passes its address. A field
that is itself a record is lent in the same way.
"""

from __future__ import annotations

import ctypes
import hashlib
import struct
from functools import cache
from itertools import repeat
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.core.imputils import lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate
from numba.extending import NativeValue, infer_getattr, intrinsic, register_model, unbox
from numpy.typing import NDArray

from rig.compiled.kernel import Emission

_NOTHING = ctypes.c_char * 0


class Lent(types.Type):  # type: ignore[misc]
    """The type of a pointer to a record, a named tuple of the type `content`.

    `inside`: lent by a kernel. The words of any other record do not change while a kernel runs, so it reads them once.
    """

    def __init__(self, content: Any, inside: bool = False) -> None:
        self.content = content
        self.inside = inside
        # The names of compiled functions are made of those of types: written out, this one alone has 12,000 letters.
        record = content.name.partition("(")[0]
        digest = hashlib.sha256(content.name.encode()).hexdigest()[:16]
        super().__init__(name=f"Lent{'Inside' if inside else ''}({record} {digest})")


register_model(Lent)(models.OpaqueModel)


class Loan:
    """A record for kernels: a named tuple of arrays (in C order), integers, floats and further records.

    The arrays are shared with the kernel; the numbers are copied when the Loan is made. `content`: the record. `like`:
    a Loan of a record of the same type, of which only the fields that are others are laid out. The type is known before
    a kernel is called: numba ignores what is raised while it asks for a type, and a Ctrl-C was lost there.
    """

    def __init__(self, content: Any, like: Loan | None = None) -> None:
        self.content = content
        before = repeat((None, b"")) if like is None else zip(like.content, like.words)
        self.words: list[bytes] = [
            words if field is old else _laid_out(field) for field, (old, words) in zip(content, before)
        ]
        self._memory = np.frombuffer(b"".join(self.words), dtype=np.int64)
        self.address = address(self._memory)
        self._numba_type_: Lent = lent_type(content) if like is None else like._numba_type_


def address(array: NDArray[Any]) -> int:
    """Where the numbers of an array in C order begin in memory; `array.ctypes` takes four times as long."""
    if not array.flags.writeable:
        return int(array.ctypes.data)
    return ctypes.addressof(_NOTHING.from_buffer(array))  # type: ignore[arg-type]


def lent_type(content: Any) -> Lent:
    """The type of a lent record."""
    return _lent(_kind(content))


def _kind(value: Any) -> Any:
    """What the type of a field follows from, to be compared."""
    if isinstance(value, np.ndarray):
        return value.dtype, value.ndim, value.flags.writeable, value.flags.aligned
    return (type(value), *map(_kind, value)) if isinstance(value, tuple) else numba.typeof(value)  # type: ignore[no-untyped-call]


@cache
def _lent(kind: tuple[Any, ...]) -> Lent:
    return Lent(_type_of(kind))


def _type_of(kind: Any) -> types.Type:
    """`numba.typeof` of a field of some kind."""
    if isinstance(kind, types.Type):
        return kind
    first, *rest = kind
    if isinstance(first, type):
        return types.NamedTuple(list(map(_type_of, rest)), first)  # type: ignore[no-untyped-call]
    ndim, writeable, aligned = rest
    return types.Array(numba.from_dtype(first), ndim, "C", readonly=not writeable, aligned=aligned)


def _laid_out(value: Any) -> bytes:
    """The words of a field."""
    if isinstance(value, np.ndarray):
        assert value.flags.c_contiguous
        if not value.size:
            return _without_numbers(value.itemsize, value.shape, value.strides)
        at = address(value)
        return struct.pack(f"{5 + 2 * value.ndim}q", 0, 0, value.size, value.itemsize, at, *value.shape, *value.strides)
    if isinstance(value, tuple):
        return b"".join(map(_laid_out, value))
    assert type(value) is not bool  # a word is eight bytes
    return struct.pack("d" if isinstance(value, float) else "q", value)


@cache
def _without_numbers(itemsize: int, shape: tuple[int, ...], strides: tuple[int, ...]) -> bytes:
    """The words of an array that has no numbers, wherever it is."""
    return struct.pack(f"{5 + 2 * len(shape)}q", 0, 0, 0, itemsize, 0, *shape, *strides)


@unbox(Lent)  # type: ignore[no-untyped-call, untyped-decorator]
def _unbox(kind: Any, loan: Any, c: Any) -> NativeValue:
    number = c.pyapi.object_getattr_string(loan, "address")
    pointer = c.pyapi.long_as_voidptr(number)
    c.pyapi.decref(number)
    return NativeValue(pointer)  # type: ignore[no-untyped-call]


def _lend(typing: Any, content: Any) -> Emission:
    """Lend a named tuple from one kernel to the kernels it calls; valid until the lending kernel returns."""

    def borrow(context: Any, builder: Any, signature: Any, arguments: Any) -> ir.Value:
        place = cgutils.alloca_once_value(builder, arguments[0])  # type: ignore[no-untyped-call]
        return builder.bitcast(place, cgutils.voidptr_t)

    return Lent(content, inside=True)(content), borrow


lent: Any = intrinsic(_lend)


@infer_getattr
class _Names(AttributeTemplate):  # type: ignore[misc]
    key = Lent

    def generic_resolve(self, kind: Any, name: str) -> types.Type | None:  # type: ignore[override]
        """The type of a field."""
        if name not in kind.content.fields:
            return None
        of_field = kind.content.types[kind.content.fields.index(name)]
        return Lent(of_field, kind.inside) if isinstance(of_field, types.BaseNamedTuple) else of_field


@lower_getattr_generic(Lent)  # type: ignore[no-untyped-call, untyped-decorator]
def _field(context: Any, builder: Any, kind: Any, pointer: Any, name: str) -> ir.Value:
    typed = builder.bitcast(pointer, context.get_value_type(kind.content).as_pointer())
    index = kind.content.fields.index(name)
    at = cgutils.gep_inbounds(builder, typed, 0, index)  # type: ignore[no-untyped-call]
    if isinstance(kind.content.types[index], types.BaseNamedTuple):
        return builder.bitcast(at, cgutils.voidptr_t)
    return builder.load(at) if kind.inside else _constant(builder, at)


def _constant(builder: Any, at: Any) -> ir.Value:
    """Load a value that nothing changes, word by word: otherwise every store to an array might have changed it."""
    kind = at.type.pointee
    if not isinstance(kind, ir.LiteralStructType | ir.ArrayType):
        word = builder.load(at)
        word.set_metadata("invariant.load", builder.module.add_metadata([]))
        return word
    whole = ir.Constant(kind, ir.Undefined)
    for i in range(len(kind)):
        whole = builder.insert_value(whole, _constant(builder, cgutils.gep_inbounds(builder, at, 0, i)), i)  # type: ignore[no-untyped-call]
    return whole
