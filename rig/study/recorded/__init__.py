"""Analyses of what a recording holds, of any rig: sensors and plant outputs, evenly sampled, gaps told.

series       one signal of a recording, on an even grid, missing samples as NaN
branches     where a drive speed rises and where it falls
windows      moving RMS and mean
hysteresis   moving RMS of a vibration over the drive speed, up and down
"""

from __future__ import annotations

from rig.study.recorded.hysteresis import Hysteresis, hysteresis
from rig.study.recorded.series import Series, series

__all__ = ["Hysteresis", "Series", "hysteresis", "series"]
