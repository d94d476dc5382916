"""The one decorator for compiled code, and the cache that never runs yesterday's physics.

numba's disk cache does not notice an edit in another file that a kernel was inlined from. So the cache directory is
keyed by a hash of all that compiled code depends on (rig.sources) and of the numba version.
`fastmath={"contract"}` (fused multiply-add) is allowed: it rounds once instead of twice, and the C twins of the
benchmarks do the same. Results are therefore bit-identical on one build and one processor type; both are recorded.
"""

from __future__ import annotations

import functools
import importlib
import operator
import os
import platform
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core import cgutils, event, types
from numba.core.datamodel import models
from numba.core.imputils import lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate
from numba.experimental import structref
from numba.extending import infer_getattr, intrinsic, register_model

from rig import kept, sources

if os.environ.get("RIG_OWN_PROCESS") and "scipy.linalg" not in sys.modules:
    # In a process of our own: numba would import scipy.linalg (0.2 s) only to learn whether there is BLAS, which no
    # kernel of ours calls. Elsewhere other people's kernels may want it.
    sys.modules["scipy.linalg"] = None  # type: ignore[assignment]
    importlib.import_module("numba.np.arraymath")
    del sys.modules["scipy.linalg"]

F = TypeVar("F", bound=Callable[..., Any])

_ROOT = Path(__file__).resolve().parent.parent
_ROOMS = ("rig.kernel", *(room.replace("/", ".") for room in sources.ROOMS))
ROWS = 7


def source_key() -> str:
    """Hash (16 hex digits) of numba's version and of all that compiled code depends on (rig.sources)."""
    version = f"{numba.__version__} {platform.python_version()}"
    return sources.key(_ROOT, kept.root() / "sources.json", version)


FOLDER = kept.Folder(source_key())
"""Where what is compiled from these sources is kept."""
numba.config.CACHE_DIR = str(FOLDER.path)  # type: ignore[attr-defined]
if os.environ.get("RIG_OWN_PROCESS"):
    event.register("numba:compile", kept.Teller(FOLDER))  # type: ignore[no-untyped-call]


_njit: Any = numba.njit  # noqa: TID251
_OPTIONS: dict[str, Any] = {"cache": FOLDER.keeps, "nogil": True, "error_model": "numpy", "fastmath": {"contract"}}


def _compiled(function: F, **options: Any) -> F:
    dispatcher = _njit(**_OPTIONS, **options)(function)
    if FOLDER.keeps:
        FOLDER.keep(dispatcher, beside_sources=not function.__module__.startswith(_ROOMS))
    return dispatcher  # type: ignore[no-any-return]


def kernel(function: F) -> F:
    """Compile `function`: cached on disk, without the GIL, divisions unchecked, fused multiply-add allowed."""
    return _compiled(function)


def inner(function: F) -> F:
    """The same for a kernel that only works on arrays it is lent: no reference is counted (3 to 6 times faster here).

    It may slice, but neither allocate an array nor return one, and only other kernels call it.
    """
    return _compiled(function, _nrt=False)


def inlined(function: F) -> F:
    """An `inner` kernel that is written into its callers, for what runs many times in a step."""
    return _compiled(function, _nrt=False, inline="always")


class _BundleType(types.StructRef):  # type: ignore[misc]
    pass


class Bundle(structref.StructRefProxy):  # type: ignore[misc]
    """A handle on a tuple of arrays; a kernel reads `bundle.content`. The arrays are shared, not copied.

    Passing fifty arrays to a kernel costs 6 us a call, passing a handle on them 0.5 us.
    """


structref.register(_BundleType)  # type: ignore[no-untyped-call]
structref.define_proxy(Bundle, _BundleType, ["content"])  # type: ignore[no-untyped-call]


@kernel
def bundle(content):  # type: ignore[no-untyped-def]
    """A handle on `content`."""
    return Bundle(content)  # type: ignore[no-untyped-call]


class _Lent(types.Type):  # type: ignore[misc]
    """A pointer to a named tuple that lives in the frame of a caller."""

    def __init__(self, content: Any) -> None:
        self.content = content
        super().__init__(name=f"Lent({content})")


register_model(_Lent)(models.OpaqueModel)


def _lend(typing: Any, content: Any) -> Any:
    """`content`, a named tuple of arrays, to be read by name in the kernels that it is passed on to.

    Fifty arrays as arguments of every kernel are what compiling would spend its time on; this passes a pointer. It is
    good until the kernel that made it returns.
    """

    def borrow(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = cgutils.alloca_once_value(builder, arguments[0])  # type: ignore[no-untyped-call]
        return builder.bitcast(place, cgutils.voidptr_t)

    return _Lent(content)(content), borrow


lent: Any = intrinsic(_lend)


def _place(typing: Any, shape: Any, like: Any) -> Any:
    """An array of the kind of `like`, on the stack: its last axis is as long as the tuple `shape`, others as `ROWS`.

    The compiler keeps what is in it in registers, as it does with a local array of C. Where `shape` is no tuple the
    length is not known when compiling: `like` itself serves.
    """
    kind = types.Array(like.dtype, like.ndim, "C")

    def lay(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        if not isinstance(shape, types.BaseTuple):
            return arguments[1]
        lengths = [ROWS] * (like.ndim - 1) + [len(shape)]
        count = functools.reduce(operator.mul, lengths)
        double = context.get_data_type(like.dtype)
        data = cgutils.alloca_once(builder, double, size=count)  # type: ignore[no-untyped-call]
        array = context.make_array(kind)(context, builder)
        whole = functools.partial(context.get_constant, types.intp)
        strides = [8 * functools.reduce(operator.mul, lengths[axis + 1 :], 1) for axis in range(like.ndim)]
        context.populate_array(
            array,
            data=data,
            shape=[whole(length) for length in lengths],
            strides=[whole(stride) for stride in strides],
            itemsize=whole(8),
            meminfo=None,
        )
        return array._getvalue()  # noqa: SLF001

    return kind(shape, like), lay


local: Any = intrinsic(_place)


@infer_getattr
class _LentNames(AttributeTemplate):  # type: ignore[misc]
    key = _Lent

    def generic_resolve(self, kind: Any, name: str) -> Any:  # type: ignore[override]
        """The type of a field."""
        return kind.content.types[kind.content.fields.index(name)] if name in kind.content.fields else None


@lower_getattr_generic(_Lent)  # type: ignore[no-untyped-call, untyped-decorator]
def _lent_field(context: Any, builder: Any, kind: Any, pointer: Any, name: str) -> Any:
    typed = builder.bitcast(pointer, context.get_value_type(kind.content).as_pointer())
    at = cgutils.gep_inbounds(builder, typed, 0, kind.content.fields.index(name))  # type: ignore[no-untyped-call]
    return builder.load(at)


def entry(function: Any, *examples: Any) -> Callable[..., Any]:
    """The compiled code of a kernel for arguments of the types of `examples`, to be called with such arguments only.

    A kernel looks at the types of its arguments at every call, and at a `Bundle` from Python: 3 us that a loop which
    calls it every millisecond of simulated time need not pay. Other types would be misread, so keep them fixed.
    """
    kinds = tuple(numba.typeof(example) for example in examples)  # type: ignore[no-untyped-call]
    function.compile(kinds)
    return function.overloads[kinds].entry_point  # type: ignore[no-any-return]
