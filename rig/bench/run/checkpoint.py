"""Checkpoints of a run: the state of plant and instruments, kept from time to time in its recording.

`rig.bench.again.fork` continues a recording from the nearest one, instead of simulating it from its begin. A
checkpoint holds what only a simulation could give: the state of the motion, of its energy balance, and of the
instruments. Protocol, exchange and controllers follow from the recording (rig.bench.run.runner). The same state, kept
in this process with the last samples, lets a plant runner return to it (`PlantRunner.keep`, `PlantRunner.back`).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.bus.topics import STATE_NS
from rig.errors import LogError
from rig.scenes.scene import Scene

STEPS = 100_000
"""Least number of sample steps between two checkpoints: about a second of computing for a brake. # chosen"""
_KINDS = ("<f8", "<i8", "<c16", "|u1")

Arrays = Mapping[str, NDArray[Any]]


class KeptState(NamedTuple):
    """The state of a plant runner at `tick`: the rig that it ran, its arrays by name, the values of its actuators."""

    scene: Scene
    tick: int
    arrays: Arrays
    values: Mapping[str, float]


def interval(frame_ns: int, step_ns: int) -> int:
    """Ticks between two checkpoints of a run, a whole number of states on the bus."""
    state = max(-(-STATE_NS // frame_ns), 1)
    return -(-STEPS * step_ns // (frame_ns * state)) * state


def packed(arrays: Arrays) -> bytes:
    """The arrays as bytes: a line of JSON with type and shape of each, then their contents."""
    contiguous = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    head = {name: [array.dtype.str, list(array.shape)] for name, array in contiguous.items()}
    return json.dumps(head).encode() + b"\n" + b"".join(array.tobytes() for array in contiguous.values())


def unpacked(content: bytes) -> Arrays:
    """The arrays of `packed`. Raises LogError for bytes of another form."""
    line, _, rest = content.partition(b"\n")
    arrays: dict[str, NDArray[Any]] = {}
    try:
        at = 0
        for name, (kind, shape) in json.loads(line).items():
            if kind not in _KINDS:
                raise ValueError(f"{name} has the unknown type {kind}")
            arrays[name] = np.frombuffer(rest, kind, int(np.prod(shape)), at).reshape(shape)
            at += arrays[name].nbytes
    except (ValueError, TypeError, AttributeError, RecursionError) as fault:
        raise LogError(f"the recording contains a checkpoint that cannot be read: {fault}") from None
    return arrays
