"""Analyses of recordings of any rig: sensors and plant outputs, evenly sampled, with their gaps reported.

series       one signal of a recording, on an even grid, missing samples as NaN
branches     where a drive speed rises and where it falls
windows      moving RMS and mean
hysteresis   moving RMS of a vibration over the drive speed, up and down
spectrum     power spectral density and spectrogram
orders       the same over the angle of a disc or the travel of a belt
pressure     maps of the pressure of a film at chosen instants
figure       pictures of these
"""

from __future__ import annotations

from rig.analysis.recorded.hysteresis import Hysteresis, hysteresis
from rig.analysis.recorded.orders import Orders, orders
from rig.analysis.recorded.pressure import Pressure, pressure
from rig.analysis.recorded.series import Series, series
from rig.analysis.recorded.spectrum import Spectrum, spectrum

__all__ = [
    "Hysteresis",
    "Orders",
    "Pressure",
    "Series",
    "Spectrum",
    "hysteresis",
    "orders",
    "pressure",
    "series",
    "spectrum",
]
