"""Compiled kernels as files that are checked when they are read: damage costs compiling one kernel again, no run."""

from __future__ import annotations

import io
import logging
import pickle
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from numba.core.caching import IndexDataCacheFile

from rig import locks

_SUM = 4
_log = logging.getLogger("rig")


class CheckedFile(IndexDataCacheFile):  # type: ignore[misc]
    """The files of one kernel: an index and one file for each set of argument types.

    Each file begins with the CRC-32 of the rest. numba would unpickle and link what a full disk or a crash left behind.
    A file that is damaged or cannot be read counts as absent, so the kernel is compiled and the file written anew.
    """

    told = False
    """Whether this process has said that it cannot keep what it compiles."""

    def save(self, key: Any, data: Any) -> None:
        """Keep a compiled kernel; without room for it the process goes on with what it has in memory.

        One process at a time: two that read the index, add to it and write it back would lose what one of them added,
        and give two kernels the same file.
        """
        try:
            with _alone(Path(self._cache_path)):
                super().save(key, data)  # type: ignore[no-untyped-call]
        except OSError as fault:
            if not CheckedFile.told:
                CheckedFile.told = True
                _log.warning(
                    "compiled kernels cannot be kept in %s (%s): the next start compiles them again; "
                    "make room, or set RIG_KERNELS to another folder",
                    Path(self._cache_path).parent,
                    fault.strerror,
                )

    def _load_index(self) -> dict[Any, str]:
        try:
            content = io.BytesIO(_whole(self._index_path))
        except OSError:
            return {}
        if pickle.load(content) != self._version:
            return {}
        stamp, overloads = pickle.load(content)
        return overloads if stamp == self._source_stamp else {}

    def _load_data(self, name: str) -> Any:
        return pickle.loads(_whole(self._data_path(name)))  # type: ignore[no-untyped-call]

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[io.BytesIO]:
        content = io.BytesIO()
        yield content
        whole = content.getvalue()
        with super()._open_for_write(filepath) as file:  # a draft beside it, then renamed
            file.write(zlib.crc32(whole).to_bytes(_SUM) + whole)


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """While nobody else writes into a folder of kernels."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / ".lock").open("wb") as lock:
        locks.take(lock, wait=True)
        yield


def _whole(path: str) -> bytes:
    """What was written to a file. Raises OSError where it cannot be read or is not what was written."""
    found = Path(path).read_bytes()
    content = found[_SUM:]
    if len(found) <= _SUM or zlib.crc32(content).to_bytes(_SUM) != found[:_SUM]:
        raise OSError(f"{path} is damaged")
    return content
