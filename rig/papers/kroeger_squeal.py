"""Kroeger, Neubauer, Popp (2008), figures 17 and 29: which brakings squeal, and the sound of a squeal.

Figure 17: pressure and temperature of 225 brakings are drawn from the ranges of the paper's tests. The paper does not
state the friction coefficient of a braking; ours scatters, and rises a little with the temperature of the disc
[calibrated]. Each braking is classified by eigenvalues; every fifteenth is also simulated and classified by its sound,
as in the tests. Figure 29: the sound of a brake while its shunt is connected and disconnected.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.optimize import curve_fit

import rig
from rig.analysis.linear.regions import sliding
from rig.analysis.recorded.sound import hear
from rig.papers.entry import TOLD, Compared, Comparison, Entry, load, quiet, value
from rig.view.palette import BLUE, GREEN, GREY, VERMILION

_COUNT = 225
_EVERY = 15
_SEED = 17
_SPEED = 40.0 * 2.0 * math.pi / 60.0  # rad/s
_LONGEST = 2.0
_FOLDS = 8.0
"""A simulated braking lasts for a growth or decay by e^8, at most 2 s."""
_SOUND = 11.0  # Pa for 1 m/s of the pad, at 0.5 m [calibrated]
_SQUEAL = 60.0  # dB
_CRITICAL = {
    5: (1.16673313, 2118.17724),
    8: (0.908164652, 2126.11917),
    10: (0.800988812, 2130.59114),
    12: (0.722627539, 2134.61188),
    15: (0.639993894, 2140.00096),
    18: (0.585154497, 2144.79477),
    20: (0.559415334, 2147.72595),
    25: (0.521396430, 2154.31959),
    30: (0.509365552, 2160.08765),
}
"""Pressure [bar]: critical friction coefficient and frequency [Hz]."""
_TOP = 5.0  # kHz: range of the spectrum
_DEVELOPED = 85.0  # dB of a fully developed squeal


class Braking(NamedTuple):
    """Pressure [bar], temperature [C], friction; growth [1/s] and frequency [Hz] of the least stable mode."""

    pressure: float
    temperature: float
    mu: float
    growth: float
    frequency: float


def brakings() -> list[Braking]:
    """Return all brakings, classified by eigenvalues."""
    scene = load("brake", drive__speed=_SPEED)
    draw = np.random.default_rng(_SEED)
    all_brakings = []
    for _ in range(_COUNT):
        pressure = draw.uniform(2.0, 30.0)
        temperature = draw.uniform(30.0, 310.0)
        mu = 0.62 + 0.03 * draw.standard_normal() + 0.02 * (temperature - 170.0) / 140.0
        rate = sliding(scene, {"load.pressure": 1e5 * pressure, "friction.mu": mu}).eigenvalues()[0]
        frequency = abs(rate.imag) / (2.0 * math.pi)
        all_brakings.append(Braking(pressure, temperature, mu, rate.real, frequency))
    return all_brakings


def level(braking: Braking) -> float:
    """Return the sound pressure level [dB] at the end of a simulated braking."""
    brake = load("brake", drive__speed=_SPEED, load__pressure=1e5 * braking.pressure, friction__mu=braking.mu)
    scene = replace(quiet(brake), sensors={})
    ran = rig.simulate(scene, min(_FOLDS / abs(braking.growth), _LONGEST))
    last = _SOUND * ran.signals["velocity"][ran.time > ran.time[-1] - 0.04]
    rms = float(np.sqrt(np.mean(last**2)))
    return 20.0 * math.log10(rms / 20e-6)


def classified(figure: Figure) -> Compared:
    """Pressure and temperature of the brakings; friction over pressure with the critical coefficient."""
    all_brakings = brakings()
    heard = {number: level(all_brakings[number]) for number in range(0, _COUNT, _EVERY)}
    tests, border = figure.subplots(1, 2)
    for squeals, mark, colour, label in ((False, ".", GREY, "quiet"), (True, "+", VERMILION, "squeals")):
        chosen = [braking for braking in all_brakings if (braking.growth > 0.0) == squeals]
        _draw(tests, border, chosen, mark, {"color": colour}, label)
        simulated = [all_brakings[number] for number, loud in heard.items() if (loud > _SQUEAL) == squeals]
        circle = {"color": colour, "mfc": "none", "markersize": 9}
        _draw(tests, border, simulated, "o", circle, f"simulated: {label}")
    tests.annotate("", (30.5, 322.0), (15.0, 322.0), arrowprops={"arrowstyle": "-|>", "color": BLUE})
    tests.text(22.5, 326.0, "predicted in the paper", color=BLUE, ha="center")
    tests.set(xlabel="pressure [bar]", ylabel="temperature of the disc [C]", xlim=(0.0, 31.0), ylim=(20.0, 345.0))
    tests.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    scene = load("brake")
    critical = {}
    for bar in _CRITICAL:
        at = replace(scene, parameters=load("brake", load__pressure=1e5 * bar).parameters)
        critical[bar] = rig.sweep(at, "friction.mu", np.linspace(0.45, 1.25, 9)).critical[0]
    border.plot(list(critical), [crossing.value for crossing in critical.values()], color=BLUE, label="critical")
    border.set(xlabel="pressure [bar]", ylabel="friction coefficient", xlim=(0.0, 31.0), ylim=(0.48, 0.8))
    border.legend()
    loud = [braking for braking in all_brakings if braking.growth > 0.0]
    lowest = min(braking.pressure for braking in loud)
    what = "lowest pressure with squeal (predicted 15, measured 12)"
    yield Comparison(what, "bar", lowest, 15.0, "paper", absolute=3.0)
    hertz = [braking.frequency for braking in loud]
    for which, extreme in (("lowest", min(hertz)), ("highest", max(hertz))):
        what = f"{which} frequency of squeal, predicted"
        yield Comparison(what, "Hz", float(extreme), 2140.0, "paper", relative=0.015)
    differ = 0
    for number, decibels in heard.items():
        differ += bool(decibels > _SQUEAL) != bool(all_brakings[number].growth > 0.0)
    yield Comparison(f"of {len(heard)} simulated: differ from the eigenvalues", "", differ, 0.0, "theory")
    for bar, (mu, frequency) in _CRITICAL.items():
        yield Comparison(f"{bar} bar: critical friction", "", critical[bar].value, mu, "reference", absolute=1e-6)
        yield Comparison(f"{bar} bar: frequency", "Hz", critical[bar].frequency, frequency, "reference", absolute=1e-3)


def _draw(tests: Axes, border: Axes, brakings: list[Braking], mark: str, look: dict[str, Any], label: str) -> None:
    """Draw brakings as marks: their temperature and their friction over the pressure."""
    pressures = [braking.pressure for braking in brakings]
    tests.plot(pressures, [braking.temperature for braking in brakings], mark, **look, label=label)
    border.plot(pressures, [braking.mu for braking in brakings], mark, **look)


def sound(figure: Figure) -> Compared:
    """Sound pressure and short-time spectrum over thirty seconds."""
    scene = load("brake_shunt_sound")
    ran = rig.simulate(scene)
    heard = hear(ran)
    turn = 2.0 * math.pi / value(scene, "drive.speed")
    begin = value(scene, "controllers.clock.begin")
    end = begin + value(scene, "controllers.clock.connected_for")
    pressure, spectrum, swing = figure.subplots(3, 1, sharex=True, height_ratios=(1.0, 1.3, 1.0))
    t = heard.t(np.arange(heard.v.size))
    edges = np.arange(0, t.size, 500)
    lowest = np.minimum.reduceat(heard.v, edges)
    highest = np.maximum.reduceat(heard.v, edges)
    pressure.fill_between(t[edges], lowest, highest, color=BLUE, lw=0.4)
    pressure.axvspan(begin, end, color=GREEN, alpha=0.12, lw=0)
    pressure.text(0.5 * (begin + end), 1.5, "shunt connected", ha="center", color=GREEN)
    pressure.set(ylabel="sound pressure [Pa]")
    shown = heard.frequencies <= 1e3 * _TOP
    khz = 1e-3 * heard.frequencies[shown]
    levels = heard.spectrum[::4, shown].T
    look: dict[str, Any] = {"vmin": 30.0, "vmax": 100.0, "cmap": "magma", "shading": "nearest", "rasterized": True}
    mesh = spectrum.pcolormesh(heard.times[::4], khz, levels, **look)
    figure.colorbar(mesh, ax=spectrum, label=f"level [{heard.reference}]", pad=0.01)
    spectrum.set(ylabel="frequency [kHz]")
    full = heard.tone > _DEVELOPED
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
    what = "largest pressure, without the echoes (label of the axis: 2)"
    yield Comparison(what, "Pa", direct, 2.0, "paper", relative=0.1)
    with_echoes = float(np.abs(heard.v).max())
    what = "largest pressure, with the echoes (label of the axis: 2)"
    yield Comparison(what, "Pa", with_echoes, 2.0, "paper", relative=0.1, missed=True)

    def envelope(at: float) -> float:
        inside = (ran.time >= at) & (ran.time < at + 0.01)
        return float(np.abs(v[inside]).max())

    before, late, later = (envelope(begin + after) for after in (-0.02, 0.03, 0.09))
    drop = 20.0 * math.log10(before / late)
    yield Comparison("level drop 30 ms after connecting (paper: immediately)", "dB", drop, math.nan, "paper")
    stops = heard.squeals[0].end - begin
    what = "time from connecting to the end of the squeal (paper: immediately)"
    yield Comparison(what, "s", stops, 0.0, "paper", absolute=0.2)
    rate = math.log(late / later) / 0.06
    yield Comparison("decay rate while connected", "1/s", rate, 22.85443, "reference", relative=0.05)
    silent = (t > begin + 1.0) & (t < end)
    left = float(np.sqrt(np.mean(heard.v[silent] ** 2)))
    noise = float(scene.sensors["microphone"].background)  # type: ignore[attr-defined]
    what = "remaining pressure while connected: the noise of the room"
    yield Comparison(what, "Pa", left, noise, "theory", relative=0.02)
    again = [squeal for squeal in heard.squeals if squeal.begin > end]
    yield Comparison("squeals after disconnecting", "", len(again), 1.0, "paper")
    yield Comparison("growth rate after disconnecting", "1/s", again[0].growth, 40.0, "reference", relative=0.05)


def _sine(t: np.ndarray, f: np.ndarray, period: float) -> tuple[float, float, float]:
    """Mean, amplitude and period of a sine fitted to f(t), starting from `period`."""

    def shape(t: np.ndarray, mean: float, a: float, b: float, T: float) -> np.ndarray:
        angle = 2.0 * math.pi * t / T
        return mean + a * np.cos(angle) + b * np.sin(angle)

    start = (float(f.mean()), 1.0, 1.0, period)
    mean, a, b, T = curve_fit(shape, t, f, start)[0]
    return float(mean), math.hypot(a, b), float(T)


ENTRIES = (
    Entry(
        "kroeger-17",
        "kroeger",
        "Figure 17",
        "225 brakings and which of them squeal",
        ("brake",),
        classified,
        "Classified by eigenvalues; every fifteenth one also by the sound of its simulation (above 60 dB). The "
        "paper states no friction of these tests. Here it is drawn for each braking, with a mean of 0.62, a "
        "standard deviation of 0.03 and a slope of 0.02 in 140 degrees of the disc (calibrated); the mean decides "
        "the lowest pressure. The tests measured 2350 Hz, the paper's model predicts 2140 Hz. The paper draws "
        "frequency over pressure; its temperatures are not printed.",
    ),
    Entry(
        "kroeger-29",
        "kroeger",
        "Figure 29",
        "sound of a brake whose shunt is connected and disconnected",
        ("brake_shunt_sound",),
        sound,
        "To listen: rig simulate brake_shunt_sound --out run.mcap, then rig analyse sound run.mcap --out "
        "squeal.wav. T: a turn of the disc. The paper connects its optimal shunt and states that the squeal stops "
        "immediately. Here the coil gives the fastest decay. With a coil tuned to the squeal of the open stack 20 "
        "dB take longer. The paper writes of a small variation of the frequency and of the sound of motor and "
        "environment, without "
        f"numbers: both are calibrated. {TOLD}",
        size=(10.4, 7.6),
    ),
)
