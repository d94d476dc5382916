"""The samples of a sensor for the loudspeakers of the pages, as they arrive; what is late is dropped.

A message to a page is binary, little endian: the time of its first sample [s] as float64, then the samples as float32
in the unit of the sensor; samples that are not finite are 0. The page answers each message with one text message.
"""

from __future__ import annotations

import asyncio
import struct
from collections import deque
from collections.abc import Iterable
from typing import Any

import numpy as np
from starlette.websockets import WebSocket

from rig.analysis.recorded.sound import LOWEST, REFERENCE
from rig.bus import messages
from rig.bus.run_setup import Setup
from rig.bus.topics import Message

KEPT = 8
"""Messages that wait for a slow page: 0.4 s. Older ones are dropped."""
AHEAD = 4
"""Messages that may be on their way to a page. # chosen"""
SLOWEST = 4.0 * LOWEST
"""Lowest sample rate [Hz] of a sensor that can be heard, as for `rig.analysis.recorded.sound`."""


def audible(setup: Setup) -> dict[str, Any]:
    """The sensors of a run that can be heard, and a sentence that says why there is none.

    `sensors`: name -> `unit`, `rate` [Hz] and `reference`, the value of 0 dB; microphones come first.
    """
    heard = {}
    others = []
    for name, (unit, period_ns) in sorted(setup.sensors.items(), key=lambda sensor: sensor[1][0] != "Pa"):
        rate = 1e9 / period_ns
        if unit in REFERENCE and rate >= SLOWEST:
            heard[name] = {"unit": unit, "rate": rate, "reference": REFERENCE[unit]}
        else:
            others.append(f"{name} ({unit}, {rate:g} Hz)")
    if heard:
        return {"sensors": heard, "why": ""}
    why = (
        f"No sensor of this scene can be heard: it takes sound pressure or a vibration ({', '.join(REFERENCE)}), "
        f"sampled at {SLOWEST:g} Hz or more. Sensors of this scene: {', '.join(others) or 'none'}. "
        "Give the scene a microphone ([sensors.microphone]), or choose one that has it: brake_shunt_listener."
    )
    return {"sensors": {}, "why": why}


def packed(arrived: Iterable[Message], wanted: Iterable[str]) -> dict[str, bytes]:
    """Sensor -> the message to the pages with the samples among `arrived`; without samples there is no entry."""
    blocks: dict[str, list[Any]] = {name: [] for name in wanted}
    for message in arrived:
        kind, _, name = message.topic.partition("/")
        if kind == "meas" and name in blocks and len(message.said.v):
            blocks[name].append(message.said)
    return {name: _packed(members) for name, members in blocks.items() if members}


def _packed(blocks: list[Any]) -> bytes:
    samples = np.concatenate([np.array(block.v, np.float64) for block in blocks])
    begin = messages.times(blocks[0])[0] * 1e-9
    content: bytes = np.where(np.isfinite(samples), samples, 0.0).astype("<f4").tobytes()
    return struct.pack("<d", begin) + content


class Sounds:
    """The pages that listen. `wanted` may be read from any thread; all methods are called in the thread of the loop."""

    def __init__(self) -> None:
        self._listeners: set[Listener] = set()
        self.wanted: frozenset[str] = frozenset()
        """Sensors to which a page listens."""

    def connect(self, socket: WebSocket) -> Listener:
        """A page that listens to the sensor in the path of its web socket; `disconnect` it at the end."""
        listener = Listener(socket.path_params["sensor"])
        self._listeners.add(listener)
        self._look()
        return listener

    def disconnect(self, listener: Listener) -> None:
        """A page listens no longer."""
        self._listeners.discard(listener)
        self._look()

    def offer(self, samples: dict[str, bytes]) -> None:
        """Pass new samples on (`packed`)."""
        for listener in self._listeners:
            if listener.sensor in samples:
                listener.put(samples[listener.sensor])

    def _look(self) -> None:
        self.wanted = frozenset(listener.sensor for listener in self._listeners)


class Listener:
    """One page that listens to `sensor`."""

    def __init__(self, sensor: str) -> None:
        self.sensor = sensor
        self._waiting: deque[bytes] = deque(maxlen=KEPT)
        self._kick = asyncio.Event()
        self._ahead = 0

    def put(self, message: bytes) -> None:
        """A new message; the oldest one that waits is dropped if there are too many."""
        self._waiting.append(message)
        self._kick.set()

    def heard(self, _: str) -> None:
        """The page has received one more message."""
        self._ahead = max(self._ahead - 1, 0)
        self._kick.set()

    async def next(self) -> list[bytes]:
        """The messages that the page shall get now; waits until there are some and the page is ready."""
        while True:
            await self._kick.wait()
            self._kick.clear()
            count = min(AHEAD - self._ahead, len(self._waiting))
            if count:
                self._ahead += count
                return [self._waiting.popleft() for _ in range(count)]
