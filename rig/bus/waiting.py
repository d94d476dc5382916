"""A bounded queue, and a wait with a timeout that signals cannot make endless."""

from __future__ import annotations

import _signal
import queue
import signal
import threading
import time
from contextlib import suppress
from typing import Any, Generic, TypeVar

_SLICE_S = 0.1
"""Longest delay of a signal [s]. # chosen"""
_MASK: Any = getattr(_signal, "pthread_sigmask", None)
"""The function of the operating system: that of the module signal turns numbers into enums, which takes 10 us."""
_MAIN = threading.main_thread().ident
_SIGNALS = tuple(int(getattr(signal, s)) for s in ("SIGINT", "SIGTERM", "SIGHUP", "SIGXCPU") if hasattr(signal, s))
_BLOCK, _RESTORE = (int(getattr(signal, name, 0)) for name in ("SIG_BLOCK", "SIG_SETMASK"))

T = TypeVar("T")


def patiently(waiting: queue.SimpleQueue[T], timeout: float) -> T:
    """The next item of a queue; wait for it at most `timeout` seconds. Raises queue.Empty.

    In the main thread signals are blocked for slices of at most 0.1 s: a signal handler that lasts longer than the
    timeout would make `SimpleQueue.get` wait for ever (CPython 3.11: the remaining time becomes negative).
    """
    if waiting.qsize():
        return waiting.get_nowait()
    if _MASK is None or threading.get_ident() != _MAIN:
        return waiting.get(True, timeout)
    deadline, left = time.monotonic() + timeout, timeout
    while True:
        before = _MASK(_BLOCK, _SIGNALS)
        try:
            return waiting.get(True, left if left < _SLICE_S else _SLICE_S)
        except queue.Empty:
            if left <= _SLICE_S:
                raise
        finally:
            _MASK(_RESTORE, before)
        left = max(deadline - time.monotonic(), 0.0)


class Inbox(Generic[T]):
    """A queue of at most `depth` items that drops the oldest when it is full. Any thread may fill and empty it."""

    def __init__(self, depth: int) -> None:
        self._queue: queue.SimpleQueue[T] = queue.SimpleQueue()
        self._depth = depth
        self.qsize = self._queue.qsize
        """The number of items in the queue."""

    def put(self, one: T) -> None:
        """Add an item; drop the oldest one if there are more than `depth`."""
        self._queue.put(one)
        if self._queue.qsize() > self._depth:
            with suppress(queue.Empty):
                self._queue.get_nowait()

    def take(self, timeout: float) -> T | None:
        """The oldest item; wait for it at most `timeout` seconds. None if there is none."""
        if timeout <= 0.0 and not self._queue.qsize():  # the usual case; an exception would take longer
            return None
        try:
            return patiently(self._queue, timeout) if timeout > 0.0 else self._queue.get_nowait()
        except queue.Empty:
            return None
