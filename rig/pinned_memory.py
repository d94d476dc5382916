"""Locks the memory of a paced process, so that the system does not swap it out during a run."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

_CURRENT, _FUTURE, _ON_FAULT = 1, 2, 4  # MCL_* of <asm-generic/mman.h>


@contextmanager
def locked() -> Iterator[str]:
    """Lock all pages that this process uses, now and later; yields "" or the reason why it is not possible.

    Unused pages are not loaded: most of them would be thread stacks and reserved address space. Locking needs root or a
    limit `memlock` of "unlimited": with a finite one the system would refuse memory requested later.
    """
    why = _lock()
    try:
        yield why
    finally:
        if not why:
            ctypes.CDLL(None).munlockall()


def _lock() -> str:
    if sys.platform != "linux":
        return "memory is not locked: only supported on Linux"
    import resource

    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    if os.geteuid() != 0 and limit != resource.RLIM_INFINITY:
        return f"memory is not locked: the limit memlock is {limit >> 10} kB; it must be unlimited"
    library = ctypes.CDLL(None, use_errno=True)
    if library.mlockall(_CURRENT | _FUTURE | _ON_FAULT) == 0:
        return ""
    return f"memory is not locked: {os.strerror(ctypes.get_errno())}"
