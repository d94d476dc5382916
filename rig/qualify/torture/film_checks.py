"""Checks of the points of a film: they press, and friction stays within its cone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.model.film import at
from rig.model.system import System
from rig.qualify.torture.outcome import Found

Array = NDArray[np.float64]


def look(system: System, states: Array, found: Found) -> None:
    """Record in `found` how far a point pulls or leaves its cone at `states` [state, n], over the largest force."""
    film = system.film
    assert film is not None
    normal, *others = (
        states[:, [system.names.index(at(kept, point)) for point in range(film.points)]]
        for kept in ("P", "f", "g")[: film.directions]
    )
    friction = np.sqrt(sum(part**2 for part in others))
    found.pulling = max(found.pulling, -float(normal.min()) / max(float(np.abs(normal).max()), 1e-30))
    outside = float((friction - film.mu * np.maximum(normal, 0.0)).max())
    found.outside_cone = max(found.outside_cone, outside / max(float(friction.max()), 1e-30))
