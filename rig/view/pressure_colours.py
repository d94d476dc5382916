"""Colours of pressure: dark violet at zero to yellow at the upper end of the scale; white for open points.

A point that just touches is dark and an open point is bright, so that they cannot be confused.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.view.contact import rgb

OPEN = "#f4f4f4"
_STOPS = ("#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30", "#fde725")
"""viridis (matplotlib, public domain) at even steps."""
COUNT = 256


def table() -> NDArray[np.uint8]:
    """The colours of the scale from its lower to its upper end: uint8 [COUNT, rgb]."""
    stops = np.array([rgb(stop) for stop in _STOPS], np.float64)
    at = np.linspace(0.0, 1.0, len(stops))
    share = np.linspace(0.0, 1.0, COUNT)
    return np.stack([np.interp(share, at, stops[:, i]) for i in range(3)], axis=1).round().astype(np.uint8)


def colours(pressures: NDArray[np.float64], scale: float) -> NDArray[np.uint8]:
    """The colours [..., rgb] of `pressures` on a scale from 0 to `scale`; larger ones have its last colour."""
    share = np.clip(np.nan_to_num(pressures) / scale, 0.0, 1.0)
    found: NDArray[np.uint8] = table()[np.rint(share * (COUNT - 1)).astype(np.int64)]
    found[~(pressures > 0.0)] = rgb(OPEN)
    return found
