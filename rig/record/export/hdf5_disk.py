"""A file for the HDF5 library, which ends the process if a file cannot be written or closed."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")


class Hdf5Disk(io.RawIOBase):
    """A new file at `path` that never refuses the library anything: `fault` keeps what went wrong first.

    From then on nothing is written. What is read are zeros, which the library does not look at before it has closed
    the file.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.fault: BaseException | None = None
        self._file = path.open("w+b", buffering=0)

    def readable(self) -> bool:
        """See `io.RawIOBase`."""
        return True

    def writable(self) -> bool:
        """See `io.RawIOBase`."""
        return True

    def seekable(self) -> bool:
        """See `io.RawIOBase`."""
        return True

    def tell(self) -> int:
        """See `io.RawIOBase`."""
        return self._file.tell()

    def seek(self, offset: int, whence: int = 0, /) -> int:
        """See `io.RawIOBase`."""
        return self._attempt(lambda: self._file.seek(offset, whence), offset)

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        """See `io.RawIOBase`."""
        found = self._attempt(lambda: self._file.readinto(buffer), -1)
        if found < 0:
            buffer[:] = bytes(len(buffer))
        return len(buffer) if found < 0 else found

    def write(self, content: bytes | memoryview) -> int:  # type: ignore[override]
        """See `io.RawIOBase`."""
        self._attempt(lambda: self._write(memoryview(content).cast("B")), None)
        return memoryview(content).nbytes

    def _write(self, rest: memoryview) -> None:
        while rest:
            rest = rest[self._file.write(rest) :]

    def truncate(self, size: int | None = None) -> int:
        """See `io.RawIOBase`."""
        return self._attempt(lambda: self._file.truncate(size), size or 0)

    def close(self) -> None:
        """See `io.RawIOBase`."""
        self._attempt(self._file.close, None)
        with suppress(OSError):
            self._file.close()
        super().close()

    def _attempt(self, do: Callable[[], T], instead: T) -> T:
        """The result of `do`, or `instead` after a fault."""
        if self.fault is None:
            try:
                return do()
            except BaseException as fault:  # also Ctrl-C, which comes while the library calls
                self.fault = fault
        return instead


@contextmanager
def hdf5_disk(path: Path) -> Iterator[Hdf5Disk]:
    """A new file for the library. At the end the first fault is raised, such as the OSError of a full disk."""
    with Hdf5Disk(path) as disk:
        try:
            yield disk
        finally:
            if disk.fault is not None:
                raise disk.fault
