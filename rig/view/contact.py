"""Contact modes as words and colours: the contact state of the first friction patch of a rig, or of all its contacts.

open    every normal force of the patch has lifted off
stick   no slip                slip+   w > 0, the surface is faster         slip-   w < 0
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rig.errors import SceneError
from rig.model.assembly import Assembly
from rig.model.system import System
from rig.scenes.scene import Scene
from rig.solve.records import OPEN, SLIP_MINUS, SLIP_PLUS, STICK

NAMES = ("stick", "slip+", "slip-", "open")
COLOURS = ("#3b6fb6", "#e08b3c", "#b4508a", "#9a9a9a")
_OF_PATCH = {STICK: 0, SLIP_PLUS: 1, SLIP_MINUS: 2}
_LIFTED = 3
_MOST_KNOWN = 1 << 16  # mode sets that are kept: a rig of many contacts may visit more


def read(scene: str) -> tuple[Scene, Assembly] | None:
    """The scene in a JSON text and its rig; None if the text is no valid scene, e.g. in a foreign recording."""
    try:
        parsed = Scene.from_json(scene)
        assembly = parsed.assemble()
    except SceneError:
        return None
    assert isinstance(assembly, Assembly)
    return parsed, assembly


def system_of(scene: str) -> System | None:
    """The system matrices of the rig in a scene (JSON text); None if the text is no valid scene."""
    scene_and_rig = read(scene)
    return scene_and_rig[1].system() if scene_and_rig else None


class Modes:
    """Converts numbers of mode sets to indices of `NAMES`: the state of the first patch; open without one."""

    def __init__(self, system: System | None) -> None:
        loads = [k for k, normal in enumerate(system.normals) if normal.patch == 0] if system else []
        self._states = _States(system, [(0, loads)] if system and system.patches else [])

    def indices(self, keys: NDArray[np.int64]) -> NDArray[np.int64]:
        """Indices in `NAMES` of an array of mode sets."""
        lanes = self._states.indices(keys)
        return lanes[0] if len(lanes) else np.full(keys.size, _LIFTED)


class Contacts:
    """The contact state of every contact of a rig over mode sets: of each patch or, where several normal forces of a
    patch may open, of each of these.

    `names` is empty for a rig without friction, and for a film of points, whose mode sets do not contain the open ones.
    """

    def __init__(self, system: System | None) -> None:
        lanes = [] if system is None or system.film is not None else list(_lanes(system))
        self.names = [name for name, *_ in lanes]
        self.indices = _States(system, [(patch, members) for _, patch, members in lanes]).indices


class _States:
    """The states of contacts over mode sets: of each its patch and its normal forces."""

    def __init__(self, system: System | None, lanes: list[tuple[int, list[int]]]) -> None:
        self._system = system
        self._lanes = lanes
        self._of = lru_cache(_MOST_KNOWN)(self._look_up)

    def indices(self, keys: NDArray[np.int64]) -> NDArray[np.int64]:
        """Indices in `NAMES` [contact, row] of an array of mode sets."""
        unique, inverse = np.unique(keys, return_inverse=True)
        states = np.array([self._of(int(key)) for key in unique], np.int64)
        return states.reshape(len(unique), len(self._lanes))[inverse.ravel()].T

    def _look_up(self, key: int) -> list[int]:
        system = self._system
        if system is None or not 0 <= key < system.keys:
            return [_LIFTED] * len(self._lanes)
        patches, normals, *_ = system.modes(key)
        states = []
        for patch, members in self._lanes:
            lifted = members and all(normals[k] == OPEN for k in members)
            states.append(_LIFTED if lifted else _OF_PATCH[patches[patch]])
        return states


def _lanes(system: System) -> Iterator[tuple[str, int, list[int]]]:
    """Name, patch and normal forces of each contact."""
    for p, patch in enumerate(system.patches):
        members = [k for k, normal in enumerate(system.normals) if normal.patch == p]
        opening = [k for k in members if system.normals[k].opens]
        if len(opening) > 1:
            yield from ((system.normals[k].name, p, [k]) for k in opening)
        else:
            yield patch.name, p, members


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue (0 to 255) of a colour "#rrggbb"."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)
