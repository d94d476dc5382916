"""Elements of the moving pictures: colours, rotations, arrows, springs, text."""

from __future__ import annotations

import math
from collections.abc import Callable
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


class Shape:
    """A solid, a line, an arrow or a motion in plain data, so that rerun and the page of `rig web` can draw it.

    `kind` and the names in `fields` are those of rerun's archetypes: `Boxes3D`, `Cylinders3D`, `LineStrips3D`,
    `Arrows3D`, `Points3D`, `Mesh3D`, `Transform3D`. Of a shape that moves, each field has its rows frame by frame.
    """

    def __init__(self, kind: str, **fields: Any) -> None:
        self.kind, self.fields = kind, fields


Log = Callable[[str, Shape], object]
"""Takes a shape that never changes, with the path of its entity."""


class Columns(NamedTuple):
    """Rows of one entity: its path, the times [ns], and a shape, or component columns of rerun."""

    path: str
    t_ns: Integers
    columns: Any


def coloured(modes: Integers) -> list[tuple[int, int, int]]:
    """The colours of contact states."""
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


def load(t_ns: Integers, heads: Reals, lengths: Reals, colour: Colour, radius: float = 0.016) -> Columns:
    """Arrows of the normal force, which end at the points `heads`."""
    down = along(2, -np.maximum(lengths, 0.0))
    count = len(heads)
    arrows = Shape("Arrows3D", vectors=down, origins=heads - down, colors=[colour] * count, radii=[radius] * count)
    return Columns("rig/load", t_ns, arrows)


def spring(t_ns: Integers, *springs: Reals, radius: float = 0.009) -> Columns:
    """Springs, each given by its points [frame, point, xyz]."""
    strips = [strip for frame in zip(*springs) for strip in frame]
    lines = Shape("LineStrips3D", strips=strips, colors=[SPRING] * len(strips), radii=[radius] * len(strips))
    return Columns("rig/spring", t_ns, lines)


def word(t_ns: Integers, place: tuple[float, float, float], texts: list[str], colours: Any) -> Columns:
    """Text at a position, one for each frame."""
    count = len(texts)
    points = Shape(
        "Points3D",
        positions=[place] * count,
        labels=texts,
        colors=colours,
        radii=[0.001] * count,
        show_labels=[True] * count,
    )
    return Columns("rig/word", t_ns, points)
