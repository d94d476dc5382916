"""Stores compiled kernels in the user's cache, under the hash of their sources, as files with a checksum.

A damaged file, or one that another user can have written, costs the compilation of one kernel, never a run. Every
checkout with the same sources shares the kernels. When all kernels take more than `LIMIT`, those that were unused for
longest are deleted.

The hash of what compiled code depends on: the statements of the modules that hold it and of those they import.

Comments, docstrings, line numbers and all other modules have no influence: an edit of a plant, an effect, an instrument
or a benchmark recompiles nothing. Each module is parsed once; its summary is stored beside the kernels, separately for
each checkout.
"""

from __future__ import annotations

import ast
import atexit
import hashlib
import io
import json
import logging
import os
import pickle
import shutil
import sys
import time
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import IO, Any, NamedTuple

import platformdirs
from llvmlite.binding import add_symbol
from numba.core import event
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, UserProvidedCacheLocator
from numba.core.runtime import _nrt_python  # type: ignore[attr-defined]

from rig.machine import files
from rig.machine.files import own_bytes, own_file, own_folder, trusted

ROOMS = ("rig/solve",)
"""Folders whose kernels are stored for all processes as long as their sources do not change."""
_DECORATORS = {"kernel", "inner", "by_address", "inlined", "fused"}
LIMIT = 1 << 30
"""Largest size of the kernels of all sources in bytes; those of the present sources are never deleted. # chosen"""
INSTEAD = "RIG_KERNELS to another folder"
_SUM = 4  # bytes of the checksum (CRC-32) before a stored kernel
_SHOWN_S = 0.5  # s between two progress messages on a terminal
_LINE_S = 5.0  # s between two progress messages elsewhere
_WORTH_S = 2.0  # s: shortest total that is noted for the next start
_ASK_S = 0.02  # s between two checks whether another process has finished
_log = logging.getLogger("rig")


class Module(NamedTuple):
    """The summary of one source file. `stamp`: size and time of modification; `digest`: hash of its statements."""

    stamp: list[int]
    digest: str
    holds: bool
    """Whether the file contains compiled code."""
    imports: list[str]
    """Dotted names of the imported modules of this project."""


def key(root: Path, kept: Path, version: str, instead: str) -> str:
    """Hash (16 hex digits) of `version` and of everything that the kernels of these sources depend on.

    `root`: folder that contains the package `rig`; `kept`: file that stores the summaries, unless another user can have
    written it; `instead`: what the user can then set.
    """
    known: dict[str, Module] = {}
    with suppress(OSError, ValueError, TypeError):  # missing or damaged
        known = {name: Module(*summary) for name, summary in json.loads(own_bytes(kept, instead)).items()}
    summaries: dict[str, Module] = {}

    def read(name: str) -> Module:
        path = root / name
        status = path.stat()
        stamp = [status.st_size, status.st_mtime_ns]
        if name not in summaries:
            old = known.get(str(path))
            summaries[name] = old if old is not None and old.stamp == stamp else _summary(path.read_bytes(), stamp)
        return summaries[name]

    rooms = [path.relative_to(root).as_posix() for room in ROOMS for path in (root / room).glob("*.py")]
    todo = [name for name in rooms if read(name).holds]
    needed = {"rig/compiled/kernel.py", *todo}
    read("rig/compiled/kernel.py")
    while todo:
        for name in _files(root, read(todo.pop()).imports):
            if name not in needed:
                needed.add(name)
                todo.append(name)
    read_here = {str(root / name): summary for name, summary in summaries.items()}
    if any(known.get(path) != summary for path, summary in read_here.items()) and trusted(kept.parent, instead):
        others = {path: summary for path, summary in known.items() if Path(path).is_file()}  # of other checkouts
        draft = kept.with_suffix(f".{os.getpid()}")
        with suppress(OSError):  # a folder that cannot be written costs only the time of parsing
            own_folder(kept.parent)
            draft.write_text(json.dumps(others | read_here))
            own_file(draft)
            draft.replace(kept)
    text = "".join(f"{name} {summaries[name].digest}\n" for name in sorted(needed))
    return hashlib.sha256(f"{version}\n{text}".encode()).hexdigest()[:16]


def _summary(source: bytes, stamp: list[int]) -> Module:
    tree = ast.parse(source)
    holds = False
    imports = []
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Module):
            first = node.body[0] if node.body else None
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                node.body[0] = ast.Pass()  # its docstring
        if isinstance(node, ast.FunctionDef):
            holds = holds or any(isinstance(d, ast.Name) and d.id in _DECORATORS for d in node.decorator_list)
        elif isinstance(node, ast.ImportFrom) and node.module and node.module.partition(".")[0] == "rig":
            imports += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return Module(stamp, hashlib.sha256(ast.dump(tree).encode()).hexdigest(), holds, imports)


def _files(root: Path, imports: list[str]) -> Iterator[str]:
    """The files of those dotted names that are modules. Packages are skipped; they only collect modules."""
    for name in imports:
        path = f"{name.replace('.', '/')}.py"
        if (root / path).is_file():
            yield path


class CheckedFile(IndexDataCacheFile):  # type: ignore[misc]
    """The files of one kernel: an index and one file for each set of argument types.

    Each file begins with the CRC-32 of the rest; numba would unpickle and link what a full disk or a crash left behind.
    A file that is damaged or unreadable counts as absent: the kernel is compiled and the file is written anew.
    """

    warned = False
    """Whether this process has warned that it cannot store what it compiles."""

    def save(self, key: Any, data: Any) -> None:
        """Store a compiled kernel. If this fails, the process continues with the kernel in memory and warns once.

        Only one process writes at a time: if two read the index, add to it and write it back, one addition would be
        lost and two kernels would get the same file.
        """
        try:
            folder = Path(self._cache_path)
            if not files.trusted(folder, INSTEAD):
                return
            with _alone(folder):
                super().save(key, data)  # type: ignore[no-untyped-call]
        except OSError as fault:
            if not CheckedFile.warned:
                CheckedFile.warned = True
                _log.warning(
                    "compiled kernels cannot be stored in %s (%s): the next start compiles them again; "
                    "make room, or set RIG_KERNELS to another folder",
                    folder.parent,
                    fault.strerror,
                )

    def _load_index(self) -> dict[Any, str]:
        try:
            content = io.BytesIO(_whole(self._index_path))
            if pickle.load(content) != self._version:
                return {}
            stamp, overloads = pickle.load(content)
        except (OSError, ImportError, AttributeError):  # it may refer to a type of a module that no longer exists
            return {}
        return overloads if stamp == self._source_stamp else {}

    def _load_data(self, name: str) -> Any:
        return pickle.loads(_whole(self._data_path(name)))  # type: ignore[no-untyped-call]

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[io.BytesIO]:
        content = io.BytesIO()
        yield content
        whole = content.getvalue()
        with super()._open_for_write(filepath) as file:  # a draft beside it, then renamed
            files.own_file(file.fileno())
            file.write(zlib.crc32(whole).to_bytes(_SUM) + whole)


class _Place(UserProvidedCacheLocator):  # type: ignore[misc]
    """A folder that need not exist: numba would try to write to it and then use the folder of the sources."""

    def ensure_cache_path(self) -> None:
        """Do nothing: no test file is written."""


class _Places(CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes: list[type[object]] = [_Place]  # noqa: RUF012 (as numba declares it)

    def reduce(self, data: Any) -> tuple[Any, ...]:
        """The stored form of a kernel, without the environments, empty of constants, of functions linked into it.

        Loading such an environment imports the module of its function, and with it much of numba's compiler. What numba
        would show, each step of the kernel with its types, is left out as well.
        """
        *kept, environments = data._replace(type_annotation="")._reduce()  # noqa: SLF001
        return (*kept, tuple(environment for environment in environments if environment.consts))


class _Kept(FunctionCache):  # type: ignore[misc]
    """The stored kernels of a function; they are loaded without importing numba's compiler (0.2 s).

    Nothing is read before the first of them is needed: most functions are only parts of other kernels.
    """

    _impl_class = _Places

    def __init__(self, function: Any, folder: Folder, beside_sources: bool, by_address: bool) -> None:
        self._function = function
        self._folder = folder
        self._beside_sources = beside_sources
        self._by_address = by_address
        self._name = repr(function)
        self._impl = None

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The stored kernel for these types; None if there is none."""
        if self._impl is None:
            self._open()
        _link_runtime()
        return self._load_overload(sig, target_context)  # type: ignore[no-untyped-call]

    def _open(self) -> None:
        function = self._function
        folder = self._folder
        super().__init__(function)  # type: ignore[no-untyped-call]
        if self._beside_sources:
            self._cache_file.__class__ = CheckedFile
            return
        base = f"{function.__qualname__}.py{sys.version_info[0]}{sys.version_info[1]}"
        self._cache_path = str(folder.path / function.__module__)
        self._impl.locator.ensure_cache_path = folder.prune  # called before something is kept
        self._cache_file = CheckedFile(self._cache_path, base, "")  # type: ignore[no-untyped-call]

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store a compiled kernel, unless the folder cannot be written."""
        if self._folder.keeps:
            if self._by_address and not data.library.unfilled:
                data.library.get_pointer_to_function(data.fndesc.llvm_func_name)
            super().save_overload(sig, data)  # type: ignore[no-untyped-call]
        if data.type_annotation:
            vars(data.type_annotation).clear()  # each step of it with its types, 2,000 objects


@cache
def _link_runtime() -> None:
    """Make the functions of numba's runtime that compiled code calls known to the linker by name."""
    for name, address in _nrt_python.c_helpers.items():
        add_symbol(name if name.startswith("_") else f"NRT_{name}", address)


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Hold the write lock of a folder of kernels."""
    files.own_folder(folder)
    with (folder / ".lock").open("wb") as lock:
        files.take(lock, wait=True)
        yield


def _whole(path: str) -> memoryview:
    """The content of a file without its checksum. Raises OSError if the file is unreadable or damaged."""
    stored = files.own_bytes(Path(path), INSTEAD)
    content = memoryview(stored)[_SUM:]
    if len(stored) <= _SUM or zlib.crc32(content).to_bytes(_SUM) != stored[:_SUM]:
        raise OSError(f"{path} is damaged")
    return content


def root() -> Path:
    """The directory of the kernels of all sources; the environment variable `RIG_KERNELS` changes it."""
    chosen = os.environ.get("RIG_KERNELS")
    return Path(chosen) if chosen else platformdirs.user_cache_path("friction-rig") / "kernels"


class Folder:
    """The kernels of one set of sources.

    `keeps`: whether kernels can be stored there; stored ones are loaded in any case, unless another user can have
    written them.
    """

    def __init__(self, key: str) -> None:
        self.root = root()
        self.path = self.root / key
        self._pruned = False
        if not all(files.trusted(folder, INSTEAD) for folder in (self.root, self.path)):
            self.path = Path(os.devnull) / key  # where nothing is, and nothing can be written
        try:
            files.own_folder(self.path)
            os.utime(self.path)
            self.keeps = os.access(self.path, os.W_OK)
        except OSError:  # compile in memory at every start; numba would store them beside the sources
            self.keeps = False

    def keep(self, dispatcher: Any, beside_sources: bool, by_address: bool = False) -> None:
        """Store what `dispatcher` compiles.

        `beside_sources`: store it for the present state of its own source file only. `by_address`: with machine code,
        which is otherwise stored only if Python calls it.
        """
        function = dispatcher.py_func
        if function.__code__.co_filename.startswith("<"):  # of a part: stored as a whole (rig.compiled.c_functions)
            return
        dispatcher._cache = _Kept(function, self, beside_sources, by_address)  # noqa: SLF001 (numba has no public way)

    @contextmanager
    def claimed(self, part: str, longest: float = 0.0) -> Iterator[bool]:
        """Whether this process may compile `part` now. Waits up to `longest` s while another process compiles it.

        When the other process has finished, its result is found in this folder. If it has not finished after `longest`
        s, it counts as hung and the answer is yes.
        """
        lock = None
        with suppress(OSError):  # not writable or full: every process compiles
            lock = (self.path / f".{part}").open("ab", buffering=0)
        if lock is None:
            yield True
            return
        with lock:
            until = time.monotonic() + longest
            mine = _taken(lock)
            while not mine and time.monotonic() < until:
                time.sleep(_ASK_S)
                mine = _taken(lock)
            yield mine or longest > 0.0
            if mine and not self.noted(part):
                with suppress(OSError):  # full disk: compiled again next time
                    lock.write(b"compiled")

    def noted(self, part: str) -> bool:
        """Whether `part` has been compiled before."""
        try:
            return (self.path / f".{part}").stat().st_size > 0
        except OSError:
            return False

    def prune(self) -> None:
        """Delete the kernels of other sources that were unused for longest; once per process that compiles."""
        if self._pruned:
            return
        self._pruned = True
        with suppress(OSError):
            others = [folder for folder in self.path.parent.iterdir() if folder.is_dir() and folder != self.path]
            left = LIMIT - _size(self.path)
            for folder in sorted(others, key=lambda folder: folder.stat().st_mtime, reverse=True):
                left -= _size(folder)
                if left < 0:
                    shutil.rmtree(folder, ignore_errors=True)


def _taken(lock: IO[bytes]) -> bool:
    try:
        return files.take(lock)
    except OSError:  # a file system without locks
        return True


def _size(folder: Path) -> int:
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())


class CompileProgress(event.Listener):  # type: ignore[misc]
    """Tells the user that kernels are being compiled, and the progress, so that no start is silent."""

    def __init__(self, folder: Folder) -> None:
        self._folder = folder
        self._notes = folder.path / "seconds"
        self._depth = 0
        self._count = 0
        self._spent = 0.0
        self._begun = 0.0
        self._shown = 0.0
        self.parts: Sequence[str] = ()
        """The names of what will be compiled, by this process and by others, as far as it is known."""
        self.other = ""
        """What is being compiled without being stored, in words; "" for kernels."""
        self._others: set[str] = set()
        self._told = False

    def on_start(self, _: event.Event) -> None:
        """Called when a kernel is about to be compiled, possibly for another one."""
        if self.other:
            if self.other not in self._others:
                self._others.add(self.other)
                sys.stderr.write(f"compiling {self.other}, at every start: 1 to 3 s\n")
                sys.stderr.flush()
            return
        if not self._depth:
            self._begun = time.monotonic()
        self._depth += 1
        if self._shown:
            return
        self._shown = time.monotonic()
        atexit.register(self._done)
        if self._folder.keeps:
            last = ""
            with suppress(OSError, ValueError):
                seconds = float(files.own_bytes(self._notes, INSTEAD))
                last = f"; the last time it took {seconds:.0f} s"
            text = f"compiling kernels, once for each kind of rig{last}"
        else:
            where = self._folder.root
            why = "cannot be written" if where == self._folder.path.parent else "is ignored"
            text = f"compiling kernels at every start, because {where} {why}; "
            text += "set RIG_KERNELS=/some/folder to store them elsewhere"
        sys.stderr.write(f"{text}\n")
        sys.stderr.flush()

    def on_end(self, _: event.Event) -> None:
        """Called when a kernel has been compiled."""
        if self.other:
            return
        self._depth -= 1
        self._count += 1
        now = time.monotonic()
        if not self._depth:
            self._spent += now - self._begun
        terminal = sys.stderr.isatty()
        if now > self._shown + (_SHOWN_S if terminal else _LINE_S):
            self._shown = now
            whole = self._spent + (now - self._begun if self._depth else 0.0)
            text = f"{self._count} compiled in {whole:.0f} s"
            if self.parts:
                done = sum(map(self._folder.noted, self.parts))
                all_of_them = len(self.parts)
                text = f"{done} of {all_of_them} compiled in {whole:.0f} s"
                if 0 < done < all_of_them:  # those that take longest come first
                    text += f", at most {whole * (all_of_them / done - 1.0):.0f} s left"
            sys.stderr.write(f"\r{text:<60} " if terminal else f"compiling kernels: {text}\n")
            sys.stderr.flush()

    def told(self) -> bool:
        """Say how long it took, if kernels have been compiled; return whether that is so."""
        if self._shown and not self._told:
            self._told = True
            text = f"{self._count} kernels compiled in {self._spent:.0f} s"
            sys.stderr.write(f"\r{text:<60}\n" if sys.stderr.isatty() else f"{text}\n")
        return self._told

    def _done(self) -> None:
        if sys.stderr.isatty():
            self.told()
        if self._spent >= _WORTH_S and not self._depth:  # otherwise it was interrupted
            with suppress(OSError):
                self._notes.write_text(f"{self._spent:.0f}")
