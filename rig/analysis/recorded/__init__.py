"""Analyses of recordings of any rig: sensors, plant outputs and commands, evenly sampled, with their gaps reported.

series           one channel of a recording, on an even grid, missing samples as NaN
common_grid      channels of different rates on one grid
amplitude        amplitude and frequency of every sensor in each stage of a run
events           vibration events: begin, end, frequency, level, growth rate, conditions; beside eigenvalues of a scene
growth           growth rate of a tone that rises out of noise, with its interval
hysteresis       moving RMS of a vibration over the drive speed, up and down
moving_windows   moving windows over samples with gaps
speed_branches   where a speed rises and where it falls
spectrum         power spectral density and spectrogram
orders           the same over the angle of a disc or the travel of a belt
density          what both compute: averaged density, its course, its lines
pressure         maps of the pressure of a film at chosen instants
response         frequency response and coherence between two channels, averaged or from pulses; its resonances
averages         power and cross spectra of two channels over windows
pulses           pulses of an input, and the force window
resonances       natural frequency and damping from the peaks of a response
portrait         phase portrait and Poincare section
sound            level, spectrum and squeals of a microphone
stick_slip       times of stick and motion, forces at their ends, friction over slip speed
comparison       two recordings side by side: scenes, channels, physical measures
figures          pictures of one channel
channel_figures  pictures of channels that are related to each other
comparison_figures   pictures of two recordings
"""

from __future__ import annotations

from rig.analysis.recorded.amplitude import Amplitudes, amplitudes
from rig.analysis.recorded.comparison import Compared, compare
from rig.analysis.recorded.events import Event, Events, events
from rig.analysis.recorded.hysteresis import Hysteresis, hysteresis
from rig.analysis.recorded.orders import Orders, orders
from rig.analysis.recorded.portrait import Portrait, Section, portrait
from rig.analysis.recorded.pressure import Pressure, pressure
from rig.analysis.recorded.resonances import Resonance
from rig.analysis.recorded.response import Response, response
from rig.analysis.recorded.series import Series, series
from rig.analysis.recorded.spectrum import Spectrum, spectrum
from rig.analysis.recorded.stick_slip import StickSlip, stick_slip

__all__ = [
    "Amplitudes",
    "Compared",
    "Event",
    "Events",
    "Hysteresis",
    "Orders",
    "Portrait",
    "Pressure",
    "Resonance",
    "Response",
    "Section",
    "Series",
    "Spectrum",
    "StickSlip",
    "amplitudes",
    "compare",
    "events",
    "hysteresis",
    "orders",
    "portrait",
    "pressure",
    "response",
    "series",
    "spectrum",
    "stick_slip",
]
