"""Publishers, which number the messages of one topic. `rig.bus.session` transports them."""

from __future__ import annotations

from abc import ABC, abstractmethod

from rig.bus.arrivals import HEADER
from rig.bus.batch import Batch


class Publisher(ABC):
    """Sends messages on one topic; never waits for a reader."""

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self.sent = 0

    def put(self, payload: bytes, t_ns: int) -> None:
        """Send `payload` with the simulated time `t_ns`."""
        self.send(payload, HEADER.pack(self.sent, t_ns))
        self.sent += 1

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


class Copied(Batched):
    """Sends messages at once, and copies of them in the plant's batches."""

    def __init__(self, at_once: Publisher, batch: Batch) -> None:
        super().__init__(at_once.topic, batch)
        self._at_once = at_once

    def send(self, payload: bytes, header: bytes) -> None:
        """See `Publisher.send`."""
        self._at_once.send(payload, header)
        super().send(payload, header)


class InOrder(Copied):
    """Sends messages at once, after flushing the batch of earlier ones. Messages of higher priority may overtake."""

    def send(self, payload: bytes, header: bytes) -> None:
        """See `Publisher.send`."""
        self._batch.flush()
        self._at_once.send(payload, header)
