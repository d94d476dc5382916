"""Memory that stays where it is: what a paced process has touched is not given up while time counts."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

_CURRENT, _FUTURE, _ON_FAULT = 1, 2, 4  # MCL_* of <asm-generic/mman.h>


@contextmanager
def locked() -> Iterator[str]:
    """Keep the pages of this process in memory, those it has touched and those it will; yields "" or why not.

    Pages that nobody has touched are not fetched: thread stacks and reserved address space would be most of them. It
    needs root or a limit `memlock` that is unlimited: with a finite one, memory asked for later would be refused.
    """
    why = _lock()
    try:
        yield why
    finally:
        if not why:
            ctypes.CDLL(None).munlockall()


def _lock() -> str:
    if sys.platform != "linux":
        return "memory is not locked: this system has no way that is known here"
    import resource

    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    if os.geteuid() != 0 and limit != resource.RLIM_INFINITY:
        return f"memory is not locked: the limit memlock is {limit >> 10} kB; unlimited is needed"
    library = ctypes.CDLL(None, use_errno=True)
    if library.mlockall(_CURRENT | _FUTURE | _ON_FAULT) == 0:
        return ""
    return f"memory is not locked: {os.strerror(ctypes.get_errno())}"
