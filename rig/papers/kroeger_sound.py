"""Kroeger, Neubauer, Popp (2008), figure 29: the sound of a brake while its shunt is connected and disconnected."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from rig.papers.common import load, run, value
from rig.papers.entry import Comparison, Entry
from rig.view.palette import BLUE, GREEN, VERMILION

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TOP = 5.0  # kHz: range of the spectrum
_LOUD = 85.0  # dB of a fully developed squeal


def sound(figure: Figure) -> Iterator[Comparison]:
    """Sound pressure and short-time spectrum over thirty seconds."""
    from rig.analysis.sound import hear

    scene = load("brake_shunt_sound")
    ran = run(scene)
    heard = hear(ran)
    turn = 2.0 * math.pi / value(scene, "drive.speed")
    begin = value(scene, "controllers.clock.begin")
    end = begin + value(scene, "controllers.clock.connected_for")
    pressure, spectrum, swing = figure.subplots(3, 1, sharex=True, height_ratios=(1.0, 1.3, 1.0))
    t = heard.start + np.arange(heard.v.size) / heard.rate
    edges = np.arange(0, t.size, 500)
    pressure.fill_between(t[edges], np.minimum.reduceat(heard.v, edges), np.maximum.reduceat(heard.v, edges),
                          color=BLUE, lw=0.4)  # fmt: skip
    pressure.axvspan(begin, end, color=GREEN, alpha=0.12, lw=0)
    pressure.text(0.5 * (begin + end), 1.5, "shunt connected", ha="center", color=GREEN)
    pressure.set(ylabel="sound pressure [Pa]")
    shown = heard.frequencies <= 1e3 * _TOP
    levels = heard.spectrum[::4, shown].T
    mesh = spectrum.pcolormesh(heard.times[::4], 1e-3 * heard.frequencies[shown], levels, vmin=30.0, vmax=100.0,
                               cmap="magma", shading="nearest", rasterized=True)  # fmt: skip
    figure.colorbar(mesh, ax=spectrum, label=f"level [{heard.reference}]", pad=0.01)
    spectrum.set(ylabel="frequency [kHz]")
    full = heard.tone > _LOUD
    swing.plot(heard.times[full], heard.frequency[full], ".", color=VERMILION, markersize=2.0)
    swing.annotate("", (1.0, 3423.0), (1.0 + turn, 3423.0), arrowprops={"arrowstyle": "<->"})
    swing.text(1.0, 3426.0, "one turn of the disc")
    swing.set(ylabel="frequency of the\nsqueal [Hz]", xlabel="time [s]", ylim=(3375.0, 3435.0))

    first = full & (heard.times > 0.3) & (heard.times < begin - 0.05)
    mean, amplitude, period = _sine(heard.times[first], heard.frequency[first], turn)
    yield Comparison("squeal, mean of a turn", "Hz", mean, 3400.0, "paper", relative=2e-3)
    swing = value(scene, "inhomogeneity.depth") * mean
    yield Comparison("amplitude of the frequency variation", "Hz", amplitude, swing, "theory", relative=0.01)
    yield Comparison("period of the variation", "s", period, 2.6, "paper", absolute=0.05)
    yield Comparison("period of the variation: one turn", "s", period, turn, "theory", relative=0.01)
    v = ran.signals["velocity"]
    direct = value(scene, "sensors.microphone.radiation") * float(np.abs(v[ran.time < begin]).max())
    yield Comparison("largest pressure, without the echoes (label of the axis: 2)", "Pa", direct, 2.0, "paper",
                     relative=0.1)  # fmt: skip

    yield Comparison("largest pressure, with the echoes (label of the axis: 2)", "Pa",
                     float(np.abs(heard.v).max()), 2.0, "paper", relative=0.1, missed=True)  # fmt: skip

    def envelope(at: float) -> float:
        return float(np.abs(v[(ran.time >= at) & (ran.time < at + 0.01)]).max())

    before, late, later = (envelope(begin + after) for after in (-0.02, 0.03, 0.09))
    drop = 20.0 * math.log10(before / late)
    yield Comparison("level drop 30 ms after connecting (paper: immediately)", "dB", drop, math.nan, "paper")
    stops = heard.squeals[0].end - begin
    yield Comparison("time from connecting to the end of the squeal (paper: immediately)", "s", stops, 0.0, "paper",
                     absolute=0.2)  # fmt: skip
    rate = math.log(late / later) / 0.06
    yield Comparison("decay rate while connected", "1/s", rate, 22.85443, "reference", relative=0.05)
    silent = (t > begin + 1.0) & (t < end)
    left = float(np.sqrt(np.mean(heard.v[silent] ** 2)))
    noise = float(scene.sensors["microphone"].background)  # type: ignore[attr-defined]
    yield Comparison("remaining pressure while connected: the noise of the room", "Pa", left, noise, "theory",
                     relative=0.02)  # fmt: skip
    again = [one for one in heard.squeals if one.begin > end]
    yield Comparison("squeals after disconnecting", "", len(again), 1.0, "paper")
    yield Comparison("growth rate after disconnecting", "1/s", again[0].growth, 40.0, "reference", relative=0.05)


def _sine(t: np.ndarray, f: np.ndarray, period: float) -> tuple[float, float, float]:
    """Mean, amplitude and period of a sine fitted to f(t), starting from `period`."""
    from scipy.optimize import curve_fit

    def shape(t: np.ndarray, mean: float, a: float, b: float, T: float) -> np.ndarray:
        angle = 2.0 * math.pi * t / T
        return mean + a * np.cos(angle) + b * np.sin(angle)

    mean, a, b, T = curve_fit(shape, t, f, (float(f.mean()), 1.0, 1.0, period))[0]
    return float(mean), math.hypot(a, b), float(T)


ENTRIES = (
    Entry("kroeger-29", "kroeger", "Figure 29", "sound of a brake whose shunt is connected and disconnected",
          ("brake_shunt_sound",), sound,
          "To listen: rig simulate brake_shunt_sound --out run.mcap, then rig sound run.mcap --out squeal.wav. T: a "
          "turn of the disc. The paper connects its optimal shunt and states that the squeal stops immediately. Here "
          "the coil gives the fastest decay. With a coil tuned to the squeal of the open stack 20 dB take longer. The "
          "paper writes of a small variation of the frequency and of the sound of motor and environment, without "
          "numbers: both are calibrated.", size=(10.4, 7.6)),
)  # fmt: skip
