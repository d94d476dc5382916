"""Publishers, which number the messages of one topic. `rig.bus.session` transports them."""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

from rig.bus.batch import EVERY, Batch
from rig.bus.topics import HEADER


class Publisher(ABC):
    """Sends messages on one topic; never waits for a reader."""

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self.sent = 0

    def put(self, payload: bytes, t_ns: int) -> None:
        """Send `payload` with the simulated time `t_ns`."""
        self.send(payload, HEADER.pack(self.sent, t_ns))
        self.sent += 1

    def put_later(self, t_ns: int, encode: Callable[..., bytes], *given: Any) -> None:
        """Send `encode(*given)`; a publisher that waits before it sends calls it as late, in another thread."""
        self.put(encode(*given), t_ns)

    def put_each(self, times: Sequence[int], payloads: Sequence[bytes]) -> None:
        """Send many messages with their simulated times [ns]."""
        for t_ns, payload in zip(times, payloads):
            self.put(payload, t_ns)

    @abstractmethod
    def send(self, payload: bytes, header: bytes) -> None:
        """Send `payload` with `header`, its packed number and time."""


class Batched(Publisher):
    """Sends messages as part of the plant's batches."""

    def __init__(self, topic: str, batch: Batch) -> None:
        super().__init__(topic)
        self._batch = batch

    def send(self, payload: bytes, header: bytes) -> None:
        """See `Publisher.send`."""
        self._batch.add("plant", self.topic, header, payload)

    def put_later(self, t_ns: int, encode: Callable[..., bytes], *given: Any) -> None:
        """See `Publisher.put_later`."""
        rows = self._batch.rows
        rows.append(("plant", self.topic, (self.sent, t_ns), encode, given))
        self.sent += 1
        if not len(rows) % EVERY:
            self._batch.flush_if_due()

    def put_each(self, times: Sequence[int], payloads: Sequence[bytes]) -> None:
        """See `Publisher.put_each`."""
        rows = zip(itertools.count(self.sent), times, payloads)
        # they wait for the next batch, however many there are
        self._batch.rows.extend([("plant", self.topic, (n, t_ns), bytes, (payload,)) for n, t_ns, payload in rows])
        self.sent += len(payloads)


class Copied(Publisher):
    """Sends messages at once, and copies of them in the plant's batches."""

    def __init__(self, at_once: Publisher, batch: Batch) -> None:
        super().__init__(at_once.topic)
        self._at_once = at_once
        self._batch = batch

    def send(self, payload: bytes, header: bytes) -> None:
        """See `Publisher.send`."""
        self._at_once.send(payload, header)
        self._batch.add("plant", self.topic, header, payload)


class InOrder(Publisher):
    """Sends messages alone, after flushing the batch of earlier ones. Messages of higher priority may overtake."""

    def __init__(self, alone: Publisher, batch: Batch, post: Callable[[Callable[[], None]], None]) -> None:
        super().__init__(alone.topic)
        self._alone = alone
        self._batch = batch
        self._post = post

    def send(self, payload: bytes, header: bytes) -> None:
        """See `Publisher.send`."""
        self._batch.flush()
        self._post(lambda: self._alone.send(payload, header))
