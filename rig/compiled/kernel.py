"""The one decorator for compiled code, and a cache that never runs outdated physics.

numba's disk cache does not notice an edit in another file from which a kernel was inlined. The cache directory is
therefore keyed by a hash of everything that compiled code depends on (rig.compiled.kernel_store) and of the numba
version. `fastmath={"contract"}` (fused multiply-add) is allowed: it rounds once instead of twice, and the C versions of
the benchmarks do the same. Results are therefore bit-identical on one build and one processor type; both are recorded.
"""

from __future__ import annotations

import gc
import importlib
import os
import platform
import sys
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from functools import cache, partial
from pathlib import Path
from typing import Any, Self, TypeVar

import numba
from llvmlite import ir
from llvmlite.binding import Linkage, ModuleRef, newpassmanagers, parse_assembly, parse_bitcode
from numba.core import cgutils, codegen, event, registry, types

from rig.compiled import kernel_store

F = TypeVar("F", bound=Callable[..., Any])
Emission = tuple[Any, Callable[..., ir.Value]]
"""What defines an intrinsic: its signature, and the function that emits its code."""

_ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("rig.compiled.kernel", *(room.replace("/", ".") for room in kernel_store.ROOMS))
"""Modules whose kernels are stored by the hash of all sources; those of others are stored by their own source file."""
UNFILLED_NAME = "UnfilledShape"
"""Name of the type that stands for the constants to be filled in, and so a part of the names of compiled functions."""
_OPEN = Linkage.external
_SHARED = Linkage.linkonce_odr
_njit: Any = numba.njit  # noqa: TID251
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}}


@cache
def source_key() -> str:
    """Hash (16 hex digits) of numba's version and of everything that compiled code depends on
    (rig.compiled.kernel_store).
    """
    version = f"{numba.__version__} {platform.python_version()}"
    return kernel_store.key(_ROOT, kernel_store.root() / "sources.json", version, kernel_store.INSTEAD)


FOLDER = kernel_store.Folder(source_key())
"""Where the kernels compiled from these sources are stored."""
numba.config.CACHE_DIR = str(FOLDER.path)  # type: ignore[attr-defined]
_PROGRESS = kernel_store.CompileProgress(FOLDER)


class _Compiler(event.Listener):  # type: ignore[misc]
    """Imports numba's compiler (0.2 s), but without scipy.linalg (another 0.2 s), which it imports to look for BLAS.

    No kernel of ours calls BLAS. Only in processes of our own: elsewhere the kernels of others may need it.
    """

    def on_start(self, _: event.Event) -> None:
        """Called when a kernel is about to be compiled."""
        if "numba.np.arraymath" not in sys.modules and "scipy.linalg" not in sys.modules:
            sys.modules["scipy.linalg"] = None  # type: ignore[assignment]
            importlib.import_module("numba.np.arraymath")
            del sys.modules["scipy.linalg"]

    def on_end(self, _: event.Event) -> None:
        """Called when it has been compiled."""


class _Collector(event.Listener):  # type: ignore[misc]
    """Suspends Python's search for cyclic garbage while a kernel is compiled: it took a ninth of the time.

    What the compiler leaves behind is found by the first search after it.
    """

    def __init__(self) -> None:
        self._depth = 0
        self._suspended = False

    def on_start(self, _: event.Event) -> None:
        """Called when a kernel is about to be compiled, possibly for another one."""
        if not self._depth:
            self._suspended = gc.isenabled()
            gc.disable()
        self._depth += 1

    def on_end(self, _: event.Event) -> None:
        """Called when it has been compiled."""
        self._depth -= 1
        if self._suspended and not self._depth:
            gc.enable()


event.register("numba:compile", _Collector())  # type: ignore[no-untyped-call]
if os.environ.get("RIG_OWN_PROCESS"):
    for _listener in (_Compiler(), _PROGRESS):
        event.register("numba:compile", _listener)  # type: ignore[no-untyped-call]


class _Library(codegen.JITCodeLibrary):  # type: ignore[misc]
    """Compiled code that calls its own copies of our functions that were linked into it.

    numba leaves these calls open: of several copies, each optimised inside another kernel, the one loaded first serves
    all. The copies differ in fused operations, so the last bits of a run depended on what else had been loaded, and on
    whether its kernels were compiled in its own process.

    The bitcode of a stored kernel is parsed only when another kernel links it. A run only calls it.

    Machine code is made when a function is first asked for by its address. Most kernels are only linked into others:
    numba would make, store and load code of theirs that nothing calls, a fifth of the time of compiling. For the same
    reason a kernel into which others are linked is optimised only before its machine code is made, as a whole.

    A library whose constants are still to be filled in (`by_address`) only has its text: `filled` makes of it what
    numba would have made for these constants, step by step.
    """

    _bitcode: bytes | None = None
    _emitted = True
    _whole = True  # optimised as far as machine code needs
    unfilled = ""
    """LLVM's text of a function whose constants are still to be filled in."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)  # type: ignore[no-untyped-call]
        self._filled: dict[Any, Self] = {}
        self._stored: tuple[str, str, Any] | None = None

    @classmethod
    def _unserialize(cls, codegen: Any, state: Any) -> Self:
        name, kind, data = state
        if kind == "linked":
            made = codegen.create_library(name)
            made._bitcode = data  # noqa: SLF001
            made._emitted = False  # noqa: SLF001
            made._finalized = True  # noqa: SLF001
            return made  # type: ignore[no-any-return]
        if kind == "unfilled":
            made = codegen.create_library(name)
            text, parts = data
            made.unfilled = zlib.decompress(text).decode()
            made._linking_libraries = [codegen.unserialize_library(part) for part in parts]  # noqa: SLF001
            made._finalized = True  # noqa: SLF001
            return made  # type: ignore[no-any-return]
        if kind != "object":
            return super()._unserialize(codegen, state)  # type: ignore[no-untyped-call, no-any-return]
        made = codegen.create_library(name)
        code, made._bitcode = data  # noqa: SLF001
        made.enable_object_caching()
        made._set_compiled_object(code)  # noqa: SLF001
        made._finalize_final_module()  # noqa: SLF001
        return made  # type: ignore[no-any-return]

    def serialize_using_object_code(self) -> tuple[str, str, Any]:
        """The form to be stored: without machine code if there is none yet."""
        if self._emitted and not self.unfilled:
            return super().serialize_using_object_code()  # type: ignore[no-untyped-call, no-any-return]
        return self._without_code()

    def _without_code(self) -> tuple[str, str, Any]:
        if self._stored is None:
            if self.unfilled:
                parts = [part._without_code() for part in dict.fromkeys(self._linking_libraries)]  # noqa: SLF001
                self._stored = self.name, "unfilled", (zlib.compress(self.unfilled.encode(), 1), parts)
            else:
                self._stored = self.name, "linked", self._get_module_for_linking().as_bitcode()
        return self._stored

    def add_ir_module(self, module: ir.Module) -> None:
        """Add the code of a function, or keep its text if its constants are still to be filled in.

        numba leaves all variables in memory. LLVM's first pass, which takes two fifths of the first ones, moves them to
        registers; here it does so once for all shapes.
        """
        if any(UNFILLED_NAME in function.name for function in module.functions):
            parsed = parse_assembly(cgutils.normalize_ir_text(str(module)))  # type: ignore[no-untyped-call]
            parsed.data_layout = self._codegen._data_layout  # noqa: SLF001
            passes = newpassmanagers.create_new_module_pass_manager()
            passes.add_sroa_pass()
            passes.run(parsed, self._codegen._pass_builder())  # type: ignore[no-untyped-call]  # noqa: SLF001
            self.unfilled = str(parsed)
        else:
            super().add_ir_module(module)  # type: ignore[no-untyped-call]

    def finalize(self) -> None:
        """Optimise the library and link it with others, once nothing more has to be filled in."""
        if self.unfilled:
            self._finalized = True
        else:
            super().finalize()  # type: ignore[no-untyped-call]

    def filled(self, shape: Any) -> Self:
        """The library that numba would have made for `shape`: with its constants filled in, here and in its parts."""
        if shape not in self._filled:
            made: Self = self._codegen.create_library(self.name)  # type: ignore[no-untyped-call]
            made.enable_object_caching()  # type: ignore[no-untyped-call]
            made.add_llvm_module(parse_assembly(shape.fill(self.unfilled)))  # type: ignore[no-untyped-call]
            for part in self._linking_libraries:
                made.add_linking_library(part.filled(shape) if part.unfilled else part)  # type: ignore[no-untyped-call]
            made.finalize()
            self._filled[shape] = made
        return self._filled[shape]

    def _get_module_for_linking(self) -> ModuleRef:
        if self._bitcode is not None:
            self._shared_module = parse_bitcode(self._bitcode)
            self._bitcode = None
            if self._emitted:
                defined: Any = self._codegen._engine._load_defined_symbols  # noqa: SLF001
                defined(self._shared_module)
        return super()._get_module_for_linking()  # type: ignore[no-untyped-call]

    def get_pointer_to_function(self, name: str) -> int:
        """The address of a function of this library; 0 if it has none of this name."""
        self._ensure_finalized()  # type: ignore[no-untyped-call]
        if self.unfilled:
            return 0
        if not self._emitted:
            if name not in {function.name for function in self._final_module.functions}:
                return 0
            self._emitted = True
            if not self._whole:
                self._run_passes()
            super()._finalize_final_module()  # type: ignore[no-untyped-call]
        if self._bitcode is not None:
            return self._codegen._engine.get_function_address(name)  # type: ignore[no-any-return]  # noqa: SLF001
        return super().get_pointer_to_function(name)  # type: ignore[no-untyped-call, no-any-return]

    def _optimize_final_module(self) -> None:
        self._whole = not self._object_caching_enabled or not self._copies()
        if self._whole:
            super()._optimize_final_module()  # type: ignore[no-untyped-call]
        else:
            cost = {"loop_vectorize": self._codegen._loopvect, "opt": self._codegen._opt_level}  # noqa: SLF001
            self._run_passes(slp_vectorize=False, cost="cheap", **cost)  # as numba does before all other passes

    def _run_passes(self, **options: Any) -> None:
        manager: Any = self._codegen._module_pass_manager  # noqa: SLF001
        passes, builder = manager(**options)
        passes.run(self._final_module, builder)

    def _copies(self) -> list[Any]:
        """Our functions that were linked into this library."""
        functions = self._final_module.functions
        return [f for f in functions if not f.is_declaration and f.linkage == _SHARED and f.name.startswith("_ZN3rig")]

    def _finalize_final_module(self) -> None:
        module = self._final_module
        own = [function for function in module.functions if not function.is_declaration]
        copies = self._copies()
        if copies and self._shared_module is None:
            shared = module.clone()  # the copy that others link keeps its symbols open, or they would have them twice
            for function in own:
                if function.linkage == _OPEN:
                    shared.get_function(function.name).linkage = _SHARED
            self._shared_module = shared
            for function in copies:
                function.linkage = "internal"
        if not self._object_caching_enabled or self._compiled_object is not None:  # of numba itself, or stored
            super()._finalize_final_module()  # type: ignore[no-untyped-call]
        else:
            self._emitted = False
            self._finalized = True


class _Codegen(codegen.JITCPUCodegen):  # type: ignore[misc]
    def set_env(self, env_name: str, env: Any) -> None:
        """Set the environment of a function, unless it has no machine code of its own."""
        if self._engine.get_global_value_address(env_name):
            super().set_env(env_name, env)  # type: ignore[no-untyped-call]


_codegen: Any = registry.cpu_target.target_context.codegen()  # type: ignore[attr-defined]
_codegen.__class__ = _Codegen
_codegen._library_class = _Library  # noqa: SLF001
for _kind in (newpassmanagers.ModulePassManager, newpassmanagers.FunctionPassManager):
    # llvmlite frees neither: of its two base classes the first one, which frees nothing, is asked. numba makes one for
    # each function of each kernel, also for those that are only declared: 1 MB for the smallest kernel.
    _kind._dispose = newpassmanagers.NewPassManager._dispose  # noqa: SLF001


def _before() -> None:
    """Called before a kernel is compiled. No kernel needs the extensions of numba that other packages may have.

    To look for them takes 15 ms. numba still does so before it compiles the code of a user.
    """
    _inline_without_copies()


@cache
def _inline_without_copies() -> None:
    """Let numba inline the very code that it has made for one call. It would copy it twice, before and after.

    In each block of a copy it also copies all variables of the function: a fifth of its time for our kernels.
    """
    worker: Any = importlib.import_module("numba.core.inline_closurecall").InlineWorker

    def inline_function(self: Any, caller: Any, block: Any, i: int, function: Any, arg_typs: Any = None) -> Any:
        made = self.run_untyped_passes(function)
        for own in made.blocks.values():
            own.__deepcopy__ = partial(_itself, own)
        try:
            return self.inline_ir(caller, block, i, made, function.__code__.co_freevars, arg_typs=arg_typs)
        finally:
            for own in made.blocks.values():
                del own.__deepcopy__

    worker.inline_function = inline_function


def _itself(block: Any, _: Any) -> Any:
    return block


def _compiled(function: F, addressed: bool = False, **options: Any) -> F:
    dispatcher = _njit(**_OPTIONS, no_cfunc_wrapper=True, **options)(function)
    templates = dispatcher.get_call_template
    # A literal in the source of a caller would be a type of its own, and numba would compile a kernel for it.
    plain: Any = types.unliteral
    dispatcher.get_call_template = lambda kinds, named: templates([plain(kind) for kind in kinds], named)
    dispatcher._compilation_chain_init_hook = _before  # noqa: SLF001
    FOLDER.keep(dispatcher, not function.__module__.startswith(ROOMS), addressed)
    return dispatcher  # type: ignore[no-any-return]


def kernel(function: F) -> F:
    """Compile `function`: cached on disk, without the GIL, divisions unchecked, fused multiply-add allowed."""
    return _compiled(function)


def _for_kernels(function: F, **options: Any) -> Any:
    """Compile `function` for other kernels alone: without reference counting, and without what Python would call."""
    dispatcher: Any = _compiled(function, _nrt=False, no_cpython_wrapper=True, **options)

    def refuse(*_: Any, **__: Any) -> None:
        raise TypeError(f"{function.__module__}.{function.__qualname__} can only be called by kernels")

    dispatcher.add_overload = lambda made: dispatcher.overloads.update({tuple(made.signature.args): made})
    dispatcher._compile_for_args = refuse  # noqa: SLF001
    return dispatcher


def inner(function: F) -> F:
    """Compile a kernel that only works on arrays passed to it: without reference counting (3 to 6 times faster here).

    It may slice, but it can neither allocate an array nor return one, and only other kernels call it.
    """
    return _for_kernels(function)  # type: ignore[no-any-return]


def by_address(function: F) -> F:
    """Compile an `inner` kernel that others call by its address (rig.solve.specialised); none contains it.

    Its first argument is a shape. numba, which takes most of the time, compiles a kernel with constants once for all of
    them.
    """
    dispatcher: Any = _for_kernels(function, addressed=True)
    of_numba = dispatcher._compiler.compile  # noqa: SLF001

    def compile(kinds: tuple[Any, ...], result: Any) -> Any:
        shape, *others = kinds
        if shape.unfilled is None:
            return of_numba(kinds, result)
        general = (shape.unfilled, *others)
        dispatcher.compile(general)
        return _for_shape(dispatcher.overloads[general], kinds)

    dispatcher._compiler.compile = compile  # noqa: SLF001
    return dispatcher  # type: ignore[no-any-return]


def _for_shape(general: Any, kinds: tuple[Any, ...]) -> Any:
    """What numba would have compiled for a shape, from what it has compiled for all of them."""
    shape = kinds[0]
    described = copy(general.fndesc)
    described.argtypes = kinds
    described.mangled_name = shape.fill(described.mangled_name)
    described.env_name = shape.fill(described.env_name)
    library = general.library.filled(shape)
    signature = general.signature.replace(args=kinds)
    return general._replace(fndesc=described, library=library, signature=signature, type_annotation="", metadata=None)


def inlined(function: F) -> F:
    """Compile an `inner` kernel that numba inlines into its callers, for code that runs many times in a step."""
    return _for_kernels(function, inline="always")  # type: ignore[no-any-return]


def fused(function: F) -> F:
    """Compile an `inner` kernel that the optimiser inlines into its callers: for a large one with several calls.

    An `inlined` kernel is analysed anew for each call; this one is not. It cannot return an array, not even one that
    was passed to it.
    """
    return _for_kernels(function, forceinline=True)  # type: ignore[no-any-return]


def entry(function: Any, *examples: Any) -> Callable[..., Any]:
    """The compiled code of a kernel for arguments of exactly the types of `examples`.

    A kernel checks the types of its arguments at every call, and reads a `Loan` through Python: 3 us, which a loop that
    calls it every millisecond of simulated time saves. Arguments of other types would be misread.
    """
    kinds = tuple(numba.typeof(example) for example in examples)  # type: ignore[no-untyped-call]
    function.compile(kinds)
    return function.overloads[kinds].entry_point  # type: ignore[no-any-return]


def as_python(function: F) -> F:
    """Compile `function` so that it rounds and divides by zero like Python: nothing is fused. Not stored on disk."""
    return _njit(function)  # type: ignore[no-any-return]


@contextmanager
def announce_compiling(what: str) -> Iterator[None]:
    """Tell the user that `what` is being compiled, which is not stored on disk, unlike kernels."""
    before = _PROGRESS.other
    _PROGRESS.other = what
    try:
        yield
    finally:
        _PROGRESS.other = before


def announce_parts(names: Sequence[str]) -> None:
    """Tell the user how much will be compiled: parts with these names, as `FOLDER.noted` knows them."""
    _PROGRESS.parts = names


def compiled() -> bool:
    """Tell the user that all kernels have been compiled, and the time; return False if none was missing."""
    return _PROGRESS.told()


def called_by_address(function: Callable[..., Any]) -> Any:
    """Compile answer(line, t_ns, heard, command, memory) -> int as a C function; the last three are pointers."""
    numbers = types.CPointer(types.float64)  # type: ignore[no-untyped-call]
    return numba.cfunc(types.int64(types.int64, types.int64, numbers, numbers, numbers))(function)
