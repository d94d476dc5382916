"""The thread in which the plant sends what has no deadline.

To encode a batch and to hand it to Zenoh takes 100 us or more: with the blocks of many sensors up to half of a frame.
The plant only puts it into a queue, and the sender works while the plant waits for its next frame.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable

from rig.errors import BusError

_MOST = 64
"""Number of waiting functions beyond which the plant waits too: one without a pace could outrun the sender."""
_CLOSING_S = 1.0
"""Longest time for sending what still waits when the session closes."""


class Sender:
    """Calls functions one after another in a thread of its own."""

    def __init__(self) -> None:
        self._queue: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._fault: BusError | None = None
        self._thread: threading.Thread | None = None

    def post(self, send: Callable[[], None]) -> None:
        """Have `send` called soon. Raises BusError if a former one has failed."""
        if self._fault is not None:
            raise self._fault
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name="sender", daemon=True)
            self._thread.start()
        while self._queue.qsize() > _MOST:
            time.sleep(0.001)
        self._queue.put(send)

    def _work(self) -> None:
        while (send := self._queue.get()) is not None:
            try:
                send()
            except BusError as fault:
                self._fault = fault
            except Exception as fault:  # of a function that encodes: it must neither be lost nor end this thread
                self._fault = BusError(f"a message could not be encoded: {fault!r}")

    def close(self) -> None:
        """Wait until everything is sent, and end the thread."""
        if self._thread is not None:
            self._queue.put(None)
            self._thread.join(_CLOSING_S)
