"""The moving picture of a rig in plain data: the shapes that `rig view` draws, computed here and drawn by the page.

    still   {"eye", "target": [x, y, z], "shapes": [[path, kind, fields]]}, once (rig.view.base.Shape)
    frame   {path: fields}: what has moved. Of a path without motion there is no entry.

Paths form a tree: a body moves with those above it (`rig/mass/body` with `rig/mass`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.model.assembly import Assembly
from rig.model.system import System
from rig.scenes.scene import Scene
from rig.view.base import Columns, Picture, Shape
from rig.view.picture import picture_of

_ROOT = "rig"
"""First part of the paths of the picture; the plate has others, of a second view."""
_DECIMALS = 4
"""Decimals of a number for the page: a thousandth of a pixel."""


class MovingPicture:
    """The picture of a rig, `colours` (output -> "#rrggbb") of whose arrows are those of the plots."""

    def __init__(self, picture: Picture, colours: Mapping[str, str]) -> None:
        picture.paint(colours)
        self._picture = picture

    @classmethod
    def of(cls, scene: Scene, assembly: Assembly, system: System, colours: Mapping[str, str]) -> MovingPicture | None:
        """The picture that the plant of a scene declares; None if it declares none that this rig can move."""
        declared = picture_of(scene, assembly, system)
        return cls(declared, colours) if declared is not None else None

    @property
    def still(self) -> dict[str, Any]:
        """Camera and everything that never changes."""
        shapes: list[Any] = []

        def draw(path: str, shape: Shape) -> None:
            if _drawn(path):
                shapes.append([path, shape.kind, _plain(shape.fields)])

        self._picture.static(draw)
        return {"eye": list(self._picture.eye), "target": list(self._picture.target), "shapes": shapes}

    def frame(
        self, t_ns: NDArray[np.int64], signals: Mapping[str, NDArray[np.float64]], modes: NDArray[np.int64]
    ) -> dict[str, Any]:
        """What has moved at the last row of `signals`; the surface has moved on over all rows."""
        fields: dict[str, Any] = {}
        for moved in self._picture.frames(t_ns, signals, modes, np.array([len(t_ns) - 1])):
            if _drawn(moved.path):
                fields.setdefault(moved.path, {}).update(_last(moved))
        return fields

    def at_rest(self, assembly: Assembly, system: System) -> dict[str, Any]:
        """The frame at the start of a run: its state, no friction, the surface where it is."""
        known = dict(zip(system.names, system.start))
        known["one"] = 1.0
        for normal in system.normals:
            known[f"N:{normal.name}"] = float(normal.row @ system.start)
        values: dict[str, NDArray[np.float64]] = {}
        for name, output in assembly.outputs.items():
            value = sum(factor * known.get(part, 0.0) for part, factor in output.row.items())
            values[name] = np.array([value])
        t_ns = np.zeros(1, np.int64)
        modes = np.zeros(1, np.int64)
        return self.frame(t_ns, values, modes)


def _drawn(path: str) -> bool:
    return path.partition("/")[0] == _ROOT


def _last(rows: Columns) -> dict[str, Any]:
    """The fields of the last frame; a transform has one value for each, other shapes a list."""
    count = len(rows.t_ns)
    last: dict[str, Any] = {}
    for name, values in rows.columns.fields.items():
        members = len(values) // count
        last[name] = values[-members:]
    if rows.columns.kind == "Transform3D":
        last = {name: values[0] for name, values in last.items()}
    return _plain(last)


def _plain(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Fields as lists, numbers with `_DECIMALS` decimals."""
    return {name: _rounded(values) for name, values in fields.items()}


def _rounded(values: Any) -> Any:
    if isinstance(values, np.ndarray):
        if values.dtype.kind == "f":
            values = np.round(values.astype(np.float64), _DECIMALS)
        return values.tolist()
    if isinstance(values, list | tuple):
        return [_rounded(value) for value in values]
    if isinstance(values, float):
        return round(float(values), _DECIMALS)
    return values
