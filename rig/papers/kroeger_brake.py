"""Kroeger, Neubauer, Popp (2008), sections 3c and 4: eigenvalues of the disc brake, its squeal, damping by a stack.

The paper prints 0.64 and 2140 Hz; the axes of its figure 21 end at 10 mm/s, 50 V and 0.83 s. "reference" is an
independent computation with the parameters of the scene.

Figure 17: pressure and temperature of 225 brakings are drawn from the ranges of the paper's tests. The paper does not
state the friction coefficient of a braking; ours scatters, and rises a little with the temperature of the disc
[calibrated]. Each braking is classified by eigenvalues; every fifteenth is also simulated and classified by its sound,
as in the tests. Figure 29: the sound of a brake while its shunt is connected and disconnected.

Section 4d: force and dissipation of a shunted piezo stack; the shunted brake.
The stack alone is that of scene belt_shunt with another capacitance and coupling. Curves come from the transfer
function of the assembled matrices, points from time simulation: the mass is stuck to a vibrating belt and drives the
stack. Therefore the soft rig, which alone would be unstable with a negative capacitance, has no influence.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import SymLogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.optimize import brentq, curve_fit, minimize_scalar

import rig
from rig.analysis.recorded.sound import hear
from rig.analysis.regions import sliding
from rig.papers.entry import TOLD, Compared, Comparison, Entry, compared, load, quiet, value
from rig.record.run import Reals
from rig.scenes.scene import Scene
from rig.stability.linearisation import sliding_key, steady
from rig.view.palette import BLUE, GREEN, GREY, VERMILION

_PAIR = (2050.0, 2200.0)  # hz: the range contains only the two branches that meet
_BRANCHES = {
    0.0: ((-23.3927452, 2079.43220), (-25.7752434, 2182.75749)),
    0.4: ((-23.3027594, 2108.02458), (-25.9081507, 2167.66103)),
    0.6: ((-22.1441998, 2129.13804), (-27.1006275, 2151.98030)),
    0.64: ((0.0163174766, 2140.00176), (-49.2682066, 2142.13293)),
    0.66: ((33.6058101, 2140.88410), (-82.8612502, 2141.75105)),
    0.7: ((70.0682972, 2141.56542), (-119.330872, 2142.05595)),
    1.0: ((195.739688, 2145.19950), (-245.056278, 2145.27820)),
}
"""mu: growth [1/s] and frequency [Hz] of the lower and the upper one."""


def eigenvalues(figure: Figure) -> Compared:
    """Draw two eigenvalues over the friction coefficient: they meet, and one becomes unstable."""
    swept = rig.sweep("brake", "friction.mu", [*np.linspace(0.0, 0.62, 32), *np.linspace(0.622, 0.66, 39)])
    plane, growth, frequency = figure.subplot_mosaic([["plane", "growth"], ["plane", "frequency"]]).values()
    near = (swept.frequency > _PAIR[0]) & (swept.frequency < _PAIR[1])
    mu, g, f = (np.broadcast_to(np.array(swept.axis.values)[:, None], near.shape)[near],
                swept.growth[near], swept.frequency[near])  # fmt: skip
    dots = plane.scatter(g, f, c=mu, s=14, cmap="viridis", zorder=3)
    figure.colorbar(dots, ax=plane, location="bottom", shrink=0.8, label="friction coefficient")
    growth.plot(mu, g, ".", color=BLUE, markersize=3.0)
    frequency.plot(mu, f, ".", color=BLUE, markersize=3.0)
    for coefficient, branches in _BRANCHES.items():
        if coefficient <= swept.axis.values[-1]:
            for rate, hertz in branches:
                for axis, x, y in ((plane, rate, hertz), (growth, coefficient, rate), (frequency, coefficient, hertz)):
                    axis.plot([x], [y], "o", mfc="none", color=VERMILION, markersize=7)
    plane.axvline(0.0, color=GREY, lw=0.7)
    growth.axhline(0.0, color=GREY, lw=0.7)
    plane.set(xlabel="growth [1/s]", ylabel="frequency [Hz]")
    growth.set(ylabel="growth [1/s]")
    frequency.set(ylabel="frequency [Hz]", xlabel="friction coefficient")
    [critical] = swept.critical
    yield Comparison("critical friction coefficient", "", critical.value, 0.64, "paper", absolute=5e-3)
    yield Comparison("frequency there", "Hz", critical.frequency, 2140.0, "paper", absolute=0.5)
    yield Comparison("critical friction coefficient", "", critical.value, 0.639993894, "reference", absolute=1e-6)
    yield Comparison("frequency there", "Hz", critical.frequency, 2140.00096, "reference", absolute=1e-3)
    for coefficient, branches in _BRANCHES.items():
        modes = rig.modes(load("brake", friction__mu=coefficient)).sliding.modes
        pair = sorted((m for m in modes if _PAIR[0] < m.frequency < _PAIR[1]), key=lambda m: m.frequency)
        for what, ours, (rate, hertz) in zip(("lower", "upper"), pair, branches):
            name = f"mu = {coefficient:g}, {what}"
            yield Comparison(f"{name}: growth", "1/s", ours.growth, rate, "reference", absolute=1e-3)
            yield Comparison(f"{name}: frequency", "Hz", ours.frequency, hertz, "reference", absolute=1e-3)


def active(figure: Figure) -> Compared:
    """Draw the velocity of the pad and the voltage of the stack: the squeal decays after the loop is closed."""
    scene = load("brake_active")
    ran = rig.simulate(scene)
    closed = value(scene, "controllers.nb.enable_at")
    t, v, U = ran.time - closed, 1e3 * ran.signals["velocity"], ran.signals["stack_voltage"]
    for axis, shown, label in zip(figure.subplots(2, 1, sharex=True), (v, U), ("velocity [mm/s]", "voltage [V]")):
        axis.plot(1e3 * t, shown, color=BLUE, lw=0.6)
        axis.axvline(0.0, color=GREY, lw=0.7, ls="--")
        axis.set_ylabel(label)
    axis.set(xlabel="time since the loop was closed [ms]", xlim=(-30.0, 60.0))

    def peak(shown: Reals, begin: float, end: float) -> float:
        return float(np.abs(shown[(t >= begin) & (t < end)]).max())

    free = rig.modes(scene).sliding.modes[0]
    yield Comparison("growth, loop open", "1/s", free.growth, 54.0367597, "reference", absolute=1e-3)
    grows = math.log(peak(v, -0.006, -0.001) / peak(v, -0.026, -0.021)) / 0.02
    yield Comparison("growth, loop open, simulated", "1/s", grows, free.growth, "theory", relative=0.05)
    yield Comparison("velocity when the loop is closed (end of the axis: 10)", "mm/s", peak(v, -0.005, 0.0), 10.0,
                     "paper", relative=0.15)  # fmt: skip
    yield Comparison("largest velocity 30 ms later (paper: declines)", "mm/s", peak(v, 0.03, 0.04), 0.0, "paper",
                     absolute=1.0)  # fmt: skip
    yield Comparison("largest voltage: the limit of the amplifier", "V", peak(U, 0.0, 0.09), 50.0, "theory",
                     relative=1e-9)  # fmt: skip


_COUNT, _EVERY, _SEED = 225, 15, 17
_SPEED = 40.0 * 2.0 * math.pi / 60.0  # rad/s
_LONGEST, _FOLDS = 2.0, 8.0
"""A simulated braking lasts for a growth or decay by e^8, at most 2 s."""
_SOUND = 11.0  # Pa for 1 m/s of the pad, at 0.5 m [calibrated]
_SQUEAL = 60.0  # dB
_CRITICAL = {5: (1.16673313, 2118.17724), 8: (0.908164652, 2126.11917), 10: (0.800988812, 2130.59114),
             12: (0.722627539, 2134.61188), 15: (0.639993894, 2140.00096), 18: (0.585154497, 2144.79477),
             20: (0.559415334, 2147.72595), 25: (0.521396430, 2154.31959), 30: (0.509365552, 2160.08765)}  # fmt: skip
"""Pressure [bar]: critical friction coefficient and frequency [Hz]."""


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
        pressure, temperature = draw.uniform(2.0, 30.0), draw.uniform(30.0, 310.0)
        mu = 0.62 + 0.03 * draw.standard_normal() + 0.02 * (temperature - 170.0) / 140.0
        rate = sliding(scene, {"load.pressure": 1e5 * pressure, "friction.mu": mu}).eigenvalues()[0]
        all_brakings.append(Braking(pressure, temperature, mu, rate.real, abs(rate.imag) / (2.0 * math.pi)))
    return all_brakings


def level(braking: Braking) -> float:
    """Return the sound pressure level [dB] at the end of a simulated braking."""
    brake = load("brake", drive__speed=_SPEED, load__pressure=1e5 * braking.pressure, friction__mu=braking.mu)
    scene = replace(quiet(brake), sensors={})
    ran = rig.simulate(scene, min(_FOLDS / abs(braking.growth), _LONGEST))
    last = _SOUND * ran.signals["velocity"][ran.time > ran.time[-1] - 0.04]
    return 20.0 * math.log10(float(np.sqrt(np.mean(last**2))) / 20e-6)


def classified(figure: Figure) -> Compared:
    """Pressure and temperature of the brakings; friction over pressure with the critical coefficient."""
    all_brakings = brakings()
    heard = {number: level(all_brakings[number]) for number in range(0, _COUNT, _EVERY)}
    tests, border = figure.subplots(1, 2)
    for squeals, mark, colour, label in ((False, ".", GREY, "quiet"), (True, "+", VERMILION, "squeals")):
        chosen = [braking for braking in all_brakings if (braking.growth > 0.0) == squeals]
        p = [braking.pressure for braking in chosen]
        tests.plot(p, [braking.temperature for braking in chosen], mark, color=colour, label=label)
        border.plot(p, [braking.mu for braking in chosen], mark, color=colour)
        sampled = [all_brakings[number] for number, loud in heard.items() if (loud > _SQUEAL) == squeals]
        p = [braking.pressure for braking in sampled]
        look: dict[str, Any] = {"color": colour, "mfc": "none", "markersize": 9}
        tests.plot(p, [braking.temperature for braking in sampled], "o", **look, label=f"simulated: {label}")
        border.plot(p, [braking.mu for braking in sampled], "o", **look)
    tests.annotate("", (30.5, 322.0), (15.0, 322.0), arrowprops={"arrowstyle": "-|>", "color": BLUE})
    tests.text(22.5, 326.0, "predicted in the paper", color=BLUE, ha="center")
    tests.set(xlabel="pressure [bar]", ylabel="temperature of the disc [C]", xlim=(0.0, 31.0), ylim=(20.0, 345.0))
    tests.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    scene, critical = load("brake"), {}
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
    rows = [
        (f"{which} frequency of squeal, predicted", of(hertz), 2140.0)
        for which, of in (("lowest", min), ("highest", max))
    ]
    yield from compared(rows, "Hz", "paper", relative=0.015)
    differ = sum(bool(loud > _SQUEAL) != bool(all_brakings[number].growth > 0.0) for number, loud in heard.items())
    yield Comparison(f"of {len(heard)} simulated: differ from the eigenvalues", "", differ, 0.0, "theory")
    for bar, (mu, frequency) in _CRITICAL.items():
        yield Comparison(f"{bar} bar: critical friction", "", critical[bar].value, mu, "reference", absolute=1e-6)
        yield Comparison(f"{bar} bar: frequency", "Hz", critical[bar].frequency, frequency, "reference", absolute=1e-3)


_TOP = 5.0  # kHz: range of the spectrum
_DEVELOPED = 85.0  # dB of a fully developed squeal


def sound(figure: Figure) -> Compared:
    """Sound pressure and short-time spectrum over thirty seconds."""
    scene = load("brake_shunt_sound")
    ran = rig.simulate(scene)
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
    again = [squeal for squeal in heard.squeals if squeal.begin > end]
    yield Comparison("squeals after disconnecting", "", len(again), 1.0, "paper")
    yield Comparison("growth rate after disconnecting", "1/s", again[0].growth, 40.0, "reference", relative=0.05)


def _sine(t: np.ndarray, f: np.ndarray, period: float) -> tuple[float, float, float]:
    """Mean, amplitude and period of a sine fitted to f(t), starting from `period`."""

    def shape(t: np.ndarray, mean: float, a: float, b: float, T: float) -> np.ndarray:
        angle = 2.0 * math.pi * t / T
        return mean + a * np.cos(angle) + b * np.sin(angle)

    mean, a, b, T = curve_fit(shape, t, f, (float(f.mean()), 1.0, 1.0, period))[0]
    return float(mean), math.hypot(a, b), float(T)


_HERTZ, CAPACITANCE, COUPLING, SWING = 3400.0, 3e-8, 1.04, 1e-6  # [paper]; F, N/V, m [calibrated]
"""Natural frequency of the squeal; capacitance and coupling of the stack; amplitude with which it is shaken."""
PIEZO_STIFFNESS = COUPLING**2 / CAPACITANCE
"""What the open electrodes add to the stiffness of the stack [N/m]."""
_LOOKS = {0.0: (BLUE, "-"), -0.5: (VERMILION, "-"), -0.8: (GREEN, "-"), -0.9: ("black", "-")}
_SHAKEN = (2720.0, 3060.0, 3230.0, 3400.0, 3570.0, 3740.0, 4080.0)  # Hz: whole cycles in 0.1 s
_FORCE = {
    0.0: ((0.9, 0.068111018, 174.640007), (0.98, 0.361219967, 157.434673), (1.1, 0.0919924833, 3.96284278)),
    -0.5: ((0.9, 0.150903097, 170.456190), (0.98, 0.621478531, 140.667352), (1.1, 0.166287360, 8.61455342)),
    -0.8: ((0.9, 0.379220536, 158.360911), (0.98, 0.903851512, 115.859842), (1.1, 0.366543194, 21.7952320)),
    -0.9: ((0.9, 0.658945293, 141.961446), (0.98, 0.985504322, 103.251800), (1.1, 0.596700498, 39.0162590)),
}
"""25 ohm: delta, then frequency over resonance, amplitude over that at resonance, phase [deg]."""
_HEAT = {
    0.0: ((0.9, 0.0937582530), (0.98, 0.730147232), (1.1, 0.0920741706), (0.9675, 1.0315)),
    -0.5: ((0.9, 0.299272892), (0.98, 0.928163232), (1.1, 0.282469733), (0.9340, 1.0619)),
    -0.8: ((0.9, 0.774815935), (0.98, 1.00443612), (1.1, 0.670946244), (0.8283, 1.1465)),
    -0.9: ((0.9, 1.00234822), (0.98, 1.01636772), (1.1, 0.834997698), (0.6426, 1.2634)),
}
"""100 ohm: dissipation over that at resonance, and last the band in which it is half of its largest or more."""


def stack(R: float, delta: float, **changes: Any) -> Scene:
    """Return the stack with its shunt tuned to 3400 Hz."""
    coil = (1.0 + delta) / (CAPACITANCE * (2.0 * math.pi * _HERTZ) ** 2)
    given = {"piezo__capacitance": CAPACITANCE, "piezo__coupling": COUPLING, "shunt__resistance": R,
             "shunt__inductance": coil, "shunt__delta": delta, "sensors__vibrometer__rate": 2e4,
             "clock__unstable": "run"}  # fmt: skip
    return quiet(load("belt_shunt", **given, **changes))


def transfer(scene: Scene, hertz: Reals) -> NDArray[np.complex128]:
    """Return G = (F/dx - c33)/kappa at frequencies [n], from the matrices: the motion of its mass drives the
    network.
    """
    system = scene.assemble().system()
    A, count = steady(system, sliding_key(system)).modes.A, len(system.coordinates)
    q, v, net = slice(0, count), slice(count, 2 * count), slice(2 * count, system.one)
    gains = []
    for s in 2j * math.pi * hertz:
        driven = np.linalg.solve(s * np.eye(system.one - 2 * count) - A[net, net], A[net, q] + s * A[net, v])
        gains.append(-(system.coupling[0, q] + system.coupling[0, net] @ driven)[0] / PIEZO_STIFFNESS)
    return np.array(gains)


def shaken(R: float, delta: float, hertz: float) -> tuple[complex, float]:
    """Simulate G and the heat of a cycle [J] with a vibration of 1 um: the last 0.1 s of 0.3 s."""
    speed = SWING * 2.0 * math.pi * hertz
    moved = stack(R, delta, drive__speed=0.0, friction__mu_static=1e9, load__force=1e3, start__velocity=speed,
                  dither__on="belt", dither__amplitude=speed, dither__frequency=hertz,
                  dither__phase=0.5 * math.pi)  # fmt: skip
    ran = rig.simulate(moved, 0.3)
    last = slice(-2000, None)
    x, v = ran.signals["displacement"][last], ran.signals["velocity"][last] / (2.0 * math.pi * hertz)
    force = -COUPLING * ran.signals["stack_voltage"][last]
    G = complex(force @ x, force @ v) / (0.5 * len(x) * SWING**2 * PIEZO_STIFFNESS)
    return G, R * float(np.mean(ran.signals["shunt_current"][last] ** 2)) / hertz


def force(figure: Figure) -> Compared:
    """Amplitude and phase of the stack's electrical force over frequency, 25 ohm."""
    hertz = np.linspace(0.6, 1.4, 801) * _HERTZ
    amplitude, phase = figure.subplots(1, 2)
    peak = abs(transfer(stack(25.0, 0.0), np.array([_HERTZ]))[0])
    for delta, (colour, line) in _LOOKS.items():
        scene = stack(25.0, delta)
        G = transfer(scene, hertz)
        amplitude.semilogy(hertz / _HERTZ, abs(G) / peak, line, color=colour, label=f"{delta:g}")
        phase.plot(hertz / _HERTZ, np.degrees(np.angle(G)), line, color=colour)
        for eta, size, angle in _FORCE[delta]:
            [at] = transfer(scene, np.array([eta * _HERTZ]))
            what = f"delta {delta:g}, {eta:g}"
            yield Comparison(f"{what}: amplitude", "", abs(at) / peak, size, "reference", relative=1e-4)
            yield Comparison(f"{what}: phase", "deg", math.degrees(np.angle(at)), angle, "reference", absolute=0.01)
        for at in _SHAKEN:
            complex_force, _ = shaken(25.0, delta, at)
            for axis, ours in ((amplitude, abs(complex_force) / peak), (phase, math.degrees(np.angle(complex_force)))):
                axis.plot([at / _HERTZ], [ours], "o", mfc="none", color=colour, markersize=6)
            if at in (3060.0, 3400.0, 3740.0):
                [expected] = transfer(scene, np.array([at]))
                yield Comparison(f"delta {delta:g}, {at / _HERTZ:g}: simulated, off the matrices", "",
                                 abs(complex_force / expected - 1.0), 0.0, "theory", absolute=1e-6)  # fmt: skip
    amplitude.set(xlabel="frequency over resonance", ylabel="force over that at resonance")
    amplitude.legend(title="Cp / C [1]")
    phase.set(xlabel="frequency over resonance", ylabel="phase [deg]", yticks=(0, 45, 90, 135, 180))


def dissipation(figure: Figure) -> Compared:
    """Draw the energy that the shunt dissipates in a cycle over frequency, 100 ohm."""
    hertz = np.linspace(0.6, 1.4, 801) * _HERTZ
    axis = figure.subplots()
    whole = transfer(stack(100.0, 0.0), np.array([_HERTZ]))[0].imag
    unit = math.pi * SWING**2 * PIEZO_STIFFNESS
    for delta, (colour, line) in _LOOKS.items():
        scene = stack(100.0, delta)

        def heat(eta: float, scene: Scene = scene) -> float:
            return float(transfer(scene, np.array([eta * _HERTZ]))[0].imag / whole)

        axis.plot(hertz / _HERTZ, transfer(scene, hertz).imag / whole, line, color=colour, label=f"{delta:g}")
        *points, band = _HEAT[delta]
        rows = ((f"delta {delta:g}, {eta:g}: of that at resonance", heat(eta), expected) for eta, expected in points)
        yield from compared(rows, "", "reference", relative=1e-4)
        most = -minimize_scalar(lambda eta, heat=heat: -heat(eta), bounds=(0.8, 1.2), method="bounded").fun
        for end, expected in zip((0.5, 1.6), band):
            half = brentq(lambda eta, heat=heat, most=most: heat(eta) - 0.5 * most, *sorted((end, 1.0)))
            yield Comparison(f"delta {delta:g}: half of the largest at", "", half, expected, "reference", absolute=6e-4)
        for at in _SHAKEN:
            _, dissipated = shaken(100.0, delta, at)
            axis.plot([at / _HERTZ], [dissipated / (unit * whole)], "o", mfc="none", color=colour, markersize=6)
            if at in (3060.0, 3400.0, 3740.0):
                expected = unit * heat(at / _HERTZ) * whole
                yield Comparison(f"delta {delta:g}, {at / _HERTZ:g}: simulated, 1 um", "J", dissipated, expected,
                                 "theory", relative=1e-6)  # fmt: skip
    axis.set(xlabel="frequency over resonance", ylabel="energy of a cycle over that at resonance")
    axis.legend(title="Cp / C [1]")


_TRIED = (1.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 50.0, 60.0, 80.0, 100.0)  # ohm
_OPEN = (40.000063, 3402.10342821258)  # 1/s, Hz
_STABLE = {
    0.0: {25.0: (0.905, 1.070), 50.0: (0.905, 1.065), 100.0: (0.920, 1.050)},
    -0.25: {25.0: (0.870, 1.095), 50.0: (0.870, 1.090), 100.0: (0.890, 1.070)},
    -0.5: {25.0: (0.800, 1.145), 50.0: (0.800, 1.140), 100.0: (0.830, 1.105)},
    -0.8: {25.0: (0.675, 1.370), 50.0: (0.695, 1.360), 100.0: (0.620, 1.270)},
}
"""delta, R [ohm]: L over L_LRC from and to which the brake is stable, found in steps of 0.005."""
# delta: largest growth [1/s] at 50 ohm and L = L_LRC.
_LEAST = {0.0: -2.28792443, -0.25: -2.31879615, -0.5: -2.41197922, -0.8: -3.51318496}


# Modes within 3 % of the frequency of the squeal belong to it: the pair that flutters with the stack open.
_NEAR = 0.03


def growth(brake: Scene, delta: float, R: float, tuning: float) -> float:
    """Return the largest growth rate [1/s] of the brake with a shunt of L = `tuning` L_LRC."""
    return growths(brake, delta, R, tuning)[0]


def growths(brake: Scene, delta: float, R: float, tuning: float) -> tuple[float, float]:
    """Return the largest growth rate [1/s] of all modes, and that of the modes of the squeal."""
    coil = tuning * (1.0 + delta) / (CAPACITANCE * (2.0 * math.pi * _OPEN[1]) ** 2)
    values = {"shunt.delta": delta, "shunt.resistance": R, "shunt.inductance": coil}
    rates = sliding(brake, values).eigenvalues()
    squeal = np.abs(rates.imag / (2.0 * math.pi * _OPEN[1]) - 1.0) < _NEAR
    return float(rates[0].real), float(rates.real[squeal].max())


def _edges(rate: Callable[[float], float]) -> list[float]:
    """Return the lowest and the highest tuning around 1 at which the growth rate is zero."""
    edges = []
    for step in (-0.02, 0.02):
        edge = 1.0
        while rate(edge + step) < 0.0:
            edge += step
        edges.append(float(brentq(rate, *sorted((edge, edge + step)), xtol=1e-4)))
    return edges


def _band(brake: Scene, delta: float, R: float) -> float:
    """Return the width of the band of tunings in which the squeal decays."""
    low, high = _edges(lambda tuning: growths(brake, delta, R, tuning)[1])
    return high - low


def _map(axis: Axes, tunings: Reals, y: Reals, rates: Reals) -> QuadMesh:
    """Draw the growth rate of the squeal, and where that of all modes [y, tuning, 2] is zero."""
    norm = SymLogNorm(linthresh=2.0, vmin=-50.0, vmax=50.0)
    mesh = axis.pcolormesh(tunings, y, rates[..., 1], shading="nearest", norm=norm, cmap="RdBu_r")
    axis.contour(tunings, y, rates[..., 0], levels=[0.0], colors="black", linewidths=1.0)
    axis.set_xlabel("inductance over that in tune [1]")
    return mesh


def stability(figure: Figure) -> Compared:
    """The growth rate of the squeal over inductance, resistance and capacitance of the shunt, and where all decays."""
    brake = quiet(load("brake_shunt", shunt__connected=True))
    damped = "resistance [ohm]"
    tunings, resistances = np.linspace(0.5, 1.5, 41), np.linspace(1.0, 201.0, 21)
    axes = figure.subplots(2, 3).ravel()
    for axis, delta in zip(axes, (*_STABLE, -0.9)):
        rates = np.array([[growths(brake, delta, R, tuning) for tuning in tunings] for R in resistances])
        mesh = _map(axis, tunings, resistances, rates)
        axis.set(title=f"capacitance ratio {delta:g}", ylabel=damped)
    deltas = np.linspace(-0.95, 0.0, 20)
    rates = np.array([[growths(brake, float(delta), 50.0, tuning) for tuning in tunings] for delta in deltas])
    _map(axes[-1], tunings, deltas, rates)
    axes[-1].set(title="50 ohm", ylabel="capacitance ratio Cp / C [1]")
    figure.colorbar(mesh, ax=axes, label="growth rate of the squeal [1/s]", aspect=40, extend="both")
    figure.supxlabel("black line: limit of stability of all modes; blue beyond it: another mode grows", fontsize=10)
    flutter = rig.modes("brake_shunt").sliding.modes[0]  # in the initial state of the scene
    yield Comparison("open: growth", "1/s", flutter.growth, _OPEN[0], "reference", absolute=1e-3)
    yield Comparison("open: frequency", "Hz", flutter.frequency, _OPEN[1], "reference", absolute=1e-3)
    for delta, bands in _STABLE.items():
        at = growth(brake, delta, 50.0, 1.0)
        yield Comparison(f"delta {delta:g}, 50 ohm, in tune: growth", "1/s", at, _LEAST[delta], "reference",
                         absolute=1e-3)  # fmt: skip
        for R, ends in bands.items():
            for which, expected, edge in zip(("from", "to"), ends, _edges(partial(growth, brake, delta, R))):
                yield Comparison(f"delta {delta:g}, {R:g} ohm: stable {which} L / L_LRC", "", edge, expected,
                                 "reference", absolute=5e-3)  # fmt: skip
    for delta in (0.0, -0.5):
        widths = [_band(brake, delta, R) for R in _TRIED]
        yield Comparison(f"delta {delta:g}: resistance of the widest band", "ohm", _TRIED[int(np.argmax(widths))], 50.0,
                         "paper", relative=0.1, missed=True)  # fmt: skip
        rows = (
            (f"delta {delta:g}, {R:g} ohm: width of the band over that of the widest", width / max(widths), math.nan)
            for R, width in zip(_TRIED, widths)
            if R in (1.0, 15.0, 50.0, 100.0)
        )
        yield from compared(rows, "", "paper")
    limit = brentq(lambda R: growth(brake, 0.0, R, 0.985), 100.0, 200.0, xtol=1e-3)
    yield Comparison("delta 0: resistance above which no tuning stabilises", "ohm", limit, 150.0, "paper", absolute=1.0)


ENTRIES = (
    Entry(
        "kroeger-16",
        "kroeger",
        "Figure 16",
        "eigenvalues of the disc brake over the friction coefficient",
        ("brake",),
        eigenvalues,
        "Circles: reference. The unit of the paper's axis is not legible; its -0.8 to 0.2 are these growth rates in "
        "100 1/s.",
    ),
    Entry(
        "kroeger-21",
        "kroeger",
        "Figure 21",
        "squeal damped actively by a piezo stack",
        ("brake_active",),
        active,
        "An observer of the modes near 2140 Hz feeds the pad's velocity back to the stack, at 20 kHz. The text of "
        "the paper states no numbers; the axes of its figure end at 10 mm/s and 50 V. The amplifier of the scene "
        f"is limited to the latter. {TOLD}",
    ),
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
        "To listen: rig simulate brake_shunt_sound --out run.mcap, then rig analyse sound run.mcap --out squeal.wav. T: a "
        "turn of the disc. The paper connects its optimal shunt and states that the squeal stops immediately. Here "
        "the coil gives the fastest decay. With a coil tuned to the squeal of the open stack 20 dB take longer. The "
        "paper writes of a small variation of the frequency and of the sound of motor and environment, without "
        f"numbers: both are calibrated. {TOLD}",
        size=(10.4, 7.6),
    ),
    Entry(
        "kroeger-25",
        "kroeger",
        "Figure 25",
        "force of a shunted piezo stack over frequency",
        ("belt_shunt",),
        force,
        "Lines: transfer function of the matrices; circles: simulated. The mechanical part of the force is subtracted.",
    ),
    Entry(
        "kroeger-26",
        "kroeger",
        "Figure 26",
        "energy dissipated by a shunt in a cycle",
        ("belt_shunt",),
        dissipation,
        "Lines: transfer function of the matrices; circles: simulated heat of the resistor.",
    ),
    Entry(
        "kroeger-28",
        "kroeger",
        "Figure 28",
        "growth rate of the squeal over the tuning of the shunt",
        ("brake_shunt",),
        stability,
        "Colour: the less stable one of the modes within 3 % of the squeal's frequency. Black line: the largest "
        "growth rate of all modes is zero; outside of it another mode may grow while the squeal decays. The axis of "
        "the paper ends at 0.4, without a unit that is legible: the scene is calibrated as if this were 40 1/s. The "
        "band of inductances is widest at 30 ohm, and nearly as wide from 15 to 50 ohm; in the paper it is widest at "
        "about 50 ohm.",
        size=(12.0, 7.0),
    ),
)
