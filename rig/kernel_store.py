"""Stores compiled kernels in the user's cache, under the hash of their sources, as files with a checksum.

A damaged file, or one that another user can have written, costs the compilation of one kernel, never a run. Every
checkout with the same sources shares the kernels. When all kernels take more than `LIMIT`, those that were unused for
longest are deleted.
"""

from __future__ import annotations

import atexit
import io
import logging
import os
import pickle
import shutil
import sys
import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import IO, Any

import platformdirs
from llvmlite.binding import add_symbol
from numba.core import event
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, UserProvidedCacheLocator
from numba.core.runtime import _nrt_python  # type: ignore[attr-defined]

from rig import file_locks

LIMIT = 1 << 30
"""Largest size of the kernels of all sources in bytes; those of the present sources are never deleted. # chosen"""
INSTEAD = "RIG_KERNELS to another folder"
_SUM = 4
_SHOWN_S, _LINE_S = 0.5, 5.0  # s between two progress messages on a terminal, and elsewhere
_WORTH_S = 2.0  # s: shortest total that is noted for the next start
_USUAL, _FEWEST = 55, 8  # kernels of one kind of rig, counted; those whose time is enough for an estimate
_ASK_S = 0.02  # s between two checks whether another process has finished
_log = logging.getLogger("rig")


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
            if not file_locks.trusted(folder, INSTEAD):
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
            file_locks.own_file(file.fileno())
            file.write(zlib.crc32(whole).to_bytes(_SUM) + whole)


class _Place(UserProvidedCacheLocator):  # type: ignore[misc]
    """A folder that need not exist: numba would try to write to it and then use the folder of the sources."""

    def ensure_cache_path(self) -> None:
        """Do nothing: no test file is written."""


class _Places(CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes: list[type[object]] = [_Place]  # noqa: RUF012 (as numba declares it)

    def reduce(self, data: Any) -> tuple[Any, ...]:
        """The stored form of a kernel, without the environments, empty of constants, of functions linked into it.

        Loading such an environment imports the module of its function, and with it much of numba's compiler.
        """
        *kept, environments = data._reduce()  # noqa: SLF001
        return (*kept, tuple(one for one in environments if one.consts))


class _Kept(FunctionCache):  # type: ignore[misc]
    """The kernels of a folder; stored ones are loaded without importing numba's compiler (0.2 s)."""

    _impl_class = _Places

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The stored kernel for these types; None if there is none."""
        _link_runtime()
        return self._load_overload(sig, target_context)  # type: ignore[no-untyped-call]


class _Found(_Kept):
    """The kernels of a folder that cannot be written."""

    def save_overload(self, sig: Any, data: Any) -> None:
        """Do nothing: the folder cannot be written."""


@cache
def _link_runtime() -> None:
    """Make the functions of numba's runtime that compiled code calls known to the linker by name."""
    for name, address in _nrt_python.c_helpers.items():
        add_symbol(name if name.startswith("_") else f"NRT_{name}", address)


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Hold the write lock of a folder of kernels."""
    file_locks.own_folder(folder)
    with (folder / ".lock").open("wb") as lock:
        file_locks.take(lock, wait=True)
        yield


def _whole(path: str) -> bytes:
    """The content of a file without its checksum. Raises OSError if the file is unreadable or damaged."""
    found = file_locks.own_bytes(Path(path), INSTEAD)
    content = found[_SUM:]
    if len(found) <= _SUM or zlib.crc32(content).to_bytes(_SUM) != found[:_SUM]:
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
        if not all(file_locks.trusted(folder, INSTEAD) for folder in (self.root, self.path)):
            self.path = Path(os.devnull) / key  # where nothing is, and nothing can be written
        try:
            file_locks.own_folder(self.path)
            os.utime(self.path)
            self.keeps = os.access(self.path, os.W_OK)
        except OSError:  # compile in memory at every start; numba would store them beside the sources
            self.keeps = False

    def keep(self, dispatcher: Any, beside_sources: bool) -> None:
        """Store what `dispatcher` compiles.

        `beside_sources`: store it for the present state of its own source file only.
        """
        function = dispatcher.py_func
        cache: Any = (_Kept if self.keeps else _Found)(function)  # type: ignore[no-untyped-call]
        dispatcher._cache = cache  # noqa: SLF001 (numba has no public way)
        if beside_sources:
            cache._cache_file.__class__ = CheckedFile  # noqa: SLF001
            return
        base = f"{function.__qualname__}.py{sys.version_info[0]}{sys.version_info[1]}"
        cache._cache_path = str(self.path / function.__module__)  # noqa: SLF001
        cache._impl.locator.ensure_cache_path = self.prune  # noqa: SLF001 (called before something is kept)
        cache._cache_file = CheckedFile(cache._cache_path, base, "")  # type: ignore[no-untyped-call]  # noqa: SLF001

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
            others = [one for one in self.path.parent.iterdir() if one.is_dir() and one != self.path]
            left = LIMIT - _size(self.path)
            for one in sorted(others, key=lambda one: one.stat().st_mtime, reverse=True):
                left -= _size(one)
                if left < 0:
                    shutil.rmtree(one, ignore_errors=True)


def _taken(lock: IO[bytes]) -> bool:
    try:
        return file_locks.take(lock)
    except OSError:  # a file system without locks
        return True


def _size(folder: Path) -> int:
    return sum(one.stat().st_size for one in folder.rglob("*") if one.is_file())


class CompileProgress(event.Listener):  # type: ignore[misc]
    """Tells the user that kernels are being compiled, and the progress, so that no start is silent."""

    def __init__(self, folder: Folder) -> None:
        self._folder, self._notes = folder, folder.path / "seconds"
        self._depth, self._count, self._spent, self._begun, self._shown = 0, 0, 0.0, 0.0, 0.0
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
                seconds = float(file_locks.own_bytes(self._notes, INSTEAD))
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
            if _FEWEST <= self._count < _USUAL:  # at the speed of this machine so far
                left = whole * (_USUAL / self._count - 1.0)
                text = f"{self._count} of about {_USUAL} compiled in {whole:.0f} s, about {left:.0f} s left"
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
