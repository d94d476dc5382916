"""Elements of the moving pictures: colours, rotations, arrows, springs, text."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.view import contact

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]
Colour = tuple[int, int, int]
"""Red, green and blue, 0 to 255."""

STEEL, DISC, MARK, SPRING = (150, 158, 170), (74, 80, 92), (214, 219, 226), (196, 200, 208)


LYING = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
"""Quaternion that turns a cylinder to the y axis."""


class Columns(NamedTuple):
    """Rows of one entity: its path, the times [ns] and rerun's component columns."""

    path: str
    t_ns: Integers
    columns: Any


def coloured(modes: Integers) -> list[tuple[int, int, int]]:
    """The colours of contact modes."""
    return [contact.rgb(contact.COLOURS[mode]) for mode in modes]


def about(axis: int, angles: Reals) -> Reals:
    """Quaternions (x, y, z, w) of rotations by `angles` [rad] about an axis (0, 1, 2)."""
    turns = np.zeros((angles.size, 4))
    turns[:, axis], turns[:, 3] = np.sin(angles / 2), np.cos(angles / 2)
    return turns


def along(axis: int, lengths: Reals) -> Reals:
    """Vectors of the given lengths along an axis (0, 1, 2)."""
    vectors = np.zeros((lengths.size, 3))
    vectors[:, axis] = lengths
    return vectors


def zigzag(begin: Reals, end: Reals, flat: bool) -> Reals:
    """Springs [frame, point, xyz] between points [frame, xyz], drawn in the horizontal plane (`flat`) or upright."""
    share = np.array([0.0, 0.1, *np.linspace(0.15, 0.85, 11), 0.9, 1.0])
    side = np.array([0.0, 0.0, *np.where(np.arange(11) % 2, 0.05, -0.05), 0.0, 0.0])
    span = end - begin
    across = np.cross([0.0, 0.0, 1.0] if flat else [0.0, 1.0, 0.0], span)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    points: Reals = begin[:, None] + share[:, None] * span[:, None] + side[:, None] * across[:, None]
    return points


def load(t_ns: Integers, heads: Reals, lengths: Reals, colour: Colour) -> Columns:
    """Arrows of the normal force, which end at the points `heads`."""
    import rerun as rr

    down = along(2, -np.maximum(lengths, 0.0))
    count = len(heads)
    return Columns(
        "rig/load", t_ns,
        rr.Arrows3D.columns(vectors=down, origins=heads - down, colors=[colour] * count, radii=[0.016] * count),
    )  # fmt: skip


def spring(t_ns: Integers, strips: Reals, radius: float = 0.009) -> Columns:
    """A spring, given by its points [frame, point, xyz]."""
    import rerun as rr

    count = len(strips)
    columns = rr.LineStrips3D.columns(strips=list(strips), colors=[SPRING] * count, radii=[radius] * count)
    return Columns("rig/spring", t_ns, columns)


def word(t_ns: Integers, place: tuple[float, float, float], texts: list[str], colours: Any) -> Columns:
    """Text at a position, one for each frame."""
    import rerun as rr

    count = len(texts)
    columns = rr.Points3D.columns(
        positions=[place] * count, labels=texts, colors=colours, radii=[0.001] * count, show_labels=[True] * count
    )
    return Columns("rig/word", t_ns, columns)
