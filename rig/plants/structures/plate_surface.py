"""The structure of a plate at its top face: frequencies, mode shapes and static compliance.

x runs along the plate from its rear edge, y across it from its middle, z upwards.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_MAGIC = b"rig plate model 1\n"
_SUM = hashlib.sha256().digest_size


@dataclass(frozen=True)
class Surface:
    """The structure at the plate's top face.

    `frequencies` [mode] Hz, ascending. `x`, `y`: positions of the nodes [m], two per element and one more. `shapes`
    [mode, 3 (x, y, z), y, x] kg^-0.5, for unit modal mass. `compliance` [m/Pa]: mean deflection of the slider's
    footprint at mid-travel under uniform pressure on it; `residual` [m/Pa]: the part of it that the modes lack.
    """

    frequencies: Array
    x: Array
    y: Array
    shapes: Array
    compliance: float
    residual: float

    def at(self, x: Array, y: Array) -> Array:
        """Shapes [mode, 3, y, x] kg^-0.5 at all pairs of the positions `x` [m] and `y` [m].

        Raises ValueError for positions beside the plate.
        """
        for name, places, nodes in (("x", x, self.x), ("y", y, self.y)):
            beyond = places[(places < nodes[0]) | (places > nodes[-1])]
            if len(beyond):
                raise ValueError(f"{name} is {beyond[0]:g} m; the plate reaches from {nodes[0]:g} to {nodes[-1]:g} m")
        return self.continued(x, y)

    def continued(self, x: Array, y: Array) -> Array:
        """Shapes as `at`; positions beside the plate use the polynomial of the element at its edge."""
        along = _interpolated(self.shapes, self.x, x)
        return _interpolated(along.swapaxes(2, 3), self.y, y).swapaxes(2, 3)

    def to_bytes(self) -> bytes:
        """The structure as bytes with a checksum; equal structures give equal bytes."""
        sizes = {"modes": len(self.frequencies), "x": len(self.x), "y": len(self.y)}
        arrays = (self.frequencies, self.x, self.y, self.shapes)
        body = b"".join(array.astype("<f8").tobytes() for array in arrays)
        return framed(sizes | {"compliance": self.compliance, "residual": self.residual}, body)

    @classmethod
    def from_bytes(cls, content: bytes) -> Self:
        """Read what `to_bytes` wrote. Raises ValueError for other content."""
        head, body = unframed(content)
        try:
            modes, x, y = (int(head[name]) for name in ("modes", "x", "y"))
            lengths = (modes, x, y, modes * 3 * y * x)
            if min(lengths) < 1 or len(body) != 8 * sum(lengths):
                raise ValueError
            ends = np.cumsum(lengths)[:-1]
            frequencies, xs, ys, shapes = np.split(np.frombuffer(body, dtype="<f8").astype(np.float64), ends)
            yields = float(head["compliance"]), float(head["residual"])
            return cls(frequencies, xs, ys, shapes.reshape(modes, 3, y, x), *yields)
        except (KeyError, TypeError, ValueError, OverflowError):
            raise ValueError("is not a surface of a plate") from None


def framed(head: dict[str, Any], body: bytes) -> bytes:
    """Bytes of a model: a line with the format, `head` as a line of JSON, `body`, a checksum."""
    whole = _MAGIC + json.dumps(head, sort_keys=True).encode() + b"\n" + body
    return whole + hashlib.sha256(whole).digest()


def unframed(content: bytes) -> tuple[dict[str, Any], bytes]:
    """The head and the body that `framed` was called with. Raises ValueError for other content."""
    whole, stated = content[:-_SUM], content[-_SUM:]
    if not whole.startswith(_MAGIC):
        raise ValueError("is not a plate model of this version")
    if hashlib.sha256(whole).digest() != stated:
        raise ValueError("is damaged: its checksum does not agree")
    line, _, body = whole[len(_MAGIC) :].partition(b"\n")
    try:
        head = json.loads(line)
    except ValueError:
        head = None
    if not isinstance(head, dict):
        raise ValueError("is not a plate model of this version")
    return head, body


def element_at(nodes: Array, places: Array) -> tuple[NDArray[np.int64], Array]:
    """First node of the element at each place; weights [3, place] of its three nodes."""
    ends = nodes[::2]
    element = np.clip(np.searchsorted(ends, places, side="right") - 1, 0, len(ends) - 2)
    t = (places - ends[element]) / (ends[element + 1] - ends[element])
    return 2 * element, np.stack([(2.0 * t - 1.0) * (t - 1.0), 4.0 * t * (1.0 - t), t * (2.0 * t - 1.0)])


def _interpolated(values: Array, nodes: Array, places: Array) -> Array:
    """`values` [..., node] at each position; without a library's matrix product, for the same bits on every machine."""
    first, weights = element_at(nodes, places)
    return weights[0] * values[..., first] + weights[1] * values[..., first + 1] + weights[2] * values[..., first + 2]  # type: ignore[no-any-return]
