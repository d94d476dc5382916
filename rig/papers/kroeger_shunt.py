"""Kroeger, Neubauer, Popp (2008), section 4d: force and dissipation of a shunted piezo stack; the shunted brake.

The stack alone is that of scene belt_shunt with another capacitance and coupling. Curves come from the transfer
function of the assembled matrices, points from time simulation: the mass is stuck to a vibrating belt and drives the
stack. Therefore the soft rig, which alone would be unstable with a negative capacitance, has no influence.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import SymLogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

import rig
from rig.analysis.linear.regions import sliding
from rig.papers.entry import Compared, Comparison, Entry, load, quiet
from rig.record.run import Reals
from rig.scenes.scene import Scene
from rig.stability.linearisation import sliding_key, steady
from rig.view.palette import BLUE, GREEN, VERMILION

_HERTZ = 3400.0  # natural frequency of the squeal [paper]
CAPACITANCE = 3e-8  # of the stack, F [calibrated]
COUPLING = 1.04  # of the stack, N/V [calibrated]
SWING = 1e-6  # amplitude with which the stack is shaken, m [calibrated]
PIEZO_STIFFNESS = COUPLING**2 / CAPACITANCE
"""What the open electrodes add to the stiffness of the stack [N/m]."""
_LOOKS = {0.0: (BLUE, "-"), -0.5: (VERMILION, "-"), -0.8: (GREEN, "-"), -0.9: ("black", "-")}
_SHAKEN = (2720.0, 3060.0, 3230.0, 3400.0, 3570.0, 3740.0, 4080.0)  # Hz: whole cycles in 0.1 s
_COMPARED = (3060.0, 3400.0, 3740.0)  # Hz: those whose simulation is compared with the matrices
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


def stack(R: float, delta: float, **changes: Any) -> Scene:
    """Return the stack with its shunt tuned to 3400 Hz."""
    coil = (1.0 + delta) / (CAPACITANCE * (2.0 * math.pi * _HERTZ) ** 2)
    shunted = {
        "piezo__capacitance": CAPACITANCE,
        "piezo__coupling": COUPLING,
        "shunt__resistance": R,
        "shunt__inductance": coil,
        "shunt__delta": delta,
        "sensors__vibrometer__rate": 2e4,
        "clock__unstable": "run",
    }
    return quiet(load("belt_shunt", **shunted, **changes))


def transfer(scene: Scene, hertz: Reals) -> NDArray[np.complex128]:
    """Return G = (F/dx - c33)/kappa at frequencies [n], from the matrices: the motion of its mass drives the
    network.
    """
    system = scene.assemble().system()
    A = steady(system, sliding_key(system)).modes.A
    count = len(system.coordinates)
    q = slice(0, count)
    v = slice(count, 2 * count)
    net = slice(2 * count, system.one)
    identity = np.eye(system.one - 2 * count)
    gains = []
    for s in 2j * math.pi * hertz:
        driven = np.linalg.solve(s * identity - A[net, net], A[net, q] + s * A[net, v])
        coupled = -(system.coupling[0, q] + system.coupling[0, net] @ driven)[0]
        gains.append(coupled / PIEZO_STIFFNESS)
    return np.array(gains)


def shaken(R: float, delta: float, hertz: float) -> tuple[complex, float]:
    """Simulate G and the heat of a cycle [J] with a vibration of 1 um: the last 0.1 s of 0.3 s."""
    speed = SWING * 2.0 * math.pi * hertz
    stuck = {"drive__speed": 0.0, "friction__mu_static": 1e9, "load__force": 1e3, "start__velocity": speed}
    vibrating = {
        "dither__on": "belt",
        "dither__amplitude": speed,
        "dither__frequency": hertz,
        "dither__phase": 0.5 * math.pi,
    }
    ran = rig.simulate(stack(R, delta, **stuck, **vibrating), 0.3)
    last = slice(-2000, None)
    x = ran.signals["displacement"][last]
    v = ran.signals["velocity"][last] / (2.0 * math.pi * hertz)
    force = -COUPLING * ran.signals["stack_voltage"][last]
    G = complex(force @ x, force @ v) / (0.5 * len(x) * SWING**2 * PIEZO_STIFFNESS)
    heat = R * float(np.mean(ran.signals["shunt_current"][last] ** 2)) / hertz
    return G, heat


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
        circle: dict[str, Any] = {"mfc": "none", "color": colour, "markersize": 6}
        for at in _SHAKEN:
            complex_force, _ = shaken(25.0, delta, at)
            amplitude.plot([at / _HERTZ], [abs(complex_force) / peak], "o", **circle)
            phase.plot([at / _HERTZ], [math.degrees(np.angle(complex_force))], "o", **circle)
            if at in _COMPARED:
                [expected] = transfer(scene, np.array([at]))
                off = abs(complex_force / expected - 1.0)
                what = f"delta {delta:g}, {at / _HERTZ:g}: simulated, off the matrices"
                yield Comparison(what, "", off, 0.0, "theory", absolute=1e-6)
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
        for eta, expected in points:
            what = f"delta {delta:g}, {eta:g}: of that at resonance"
            yield Comparison(what, "", heat(eta), expected, "reference", relative=1e-4)
        most = -minimize_scalar(lambda eta, heat=heat: -heat(eta), bounds=(0.8, 1.2), method="bounded").fun
        for end, expected in zip((0.5, 1.6), band):
            half = brentq(lambda eta, heat=heat, most=most: heat(eta) - 0.5 * most, *sorted((end, 1.0)))
            yield Comparison(f"delta {delta:g}: half of the largest at", "", half, expected, "reference", absolute=6e-4)
        for at in _SHAKEN:
            _, dissipated = shaken(100.0, delta, at)
            axis.plot([at / _HERTZ], [dissipated / (unit * whole)], "o", mfc="none", color=colour, markersize=6)
            if at in _COMPARED:
                expected = unit * heat(at / _HERTZ) * whole
                what = f"delta {delta:g}, {at / _HERTZ:g}: simulated, 1 um"
                yield Comparison(what, "J", dissipated, expected, "theory", relative=1e-6)
    axis.set(xlabel="frequency over resonance", ylabel="energy of a cycle over that at resonance")
    axis.legend(title="Cp / C [1]")


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
    tunings = np.linspace(0.5, 1.5, 41)
    resistances = np.linspace(1.0, 201.0, 21)

    def over_tunings(delta: float, R: float) -> list[tuple[float, float]]:
        return [growths(brake, delta, R, tuning) for tuning in tunings]

    axes = figure.subplots(2, 3).ravel()
    for axis, delta in zip(axes, (*_STABLE, -0.9)):
        rates = np.array([over_tunings(delta, R) for R in resistances])
        mesh = _map(axis, tunings, resistances, rates)
        axis.set(title=f"capacitance ratio {delta:g}", ylabel=damped)
    deltas = np.linspace(-0.95, 0.0, 20)
    rates = np.array([over_tunings(float(delta), 50.0) for delta in deltas])
    _map(axes[-1], tunings, deltas, rates)
    axes[-1].set(title="50 ohm", ylabel="capacitance ratio Cp / C [1]")
    figure.colorbar(mesh, ax=axes, label="growth rate of the squeal [1/s]", aspect=40, extend="both")
    figure.supxlabel("black line: limit of stability of all modes; blue beyond it: another mode grows", fontsize=10)
    flutter = rig.modes("brake_shunt").sliding.modes[0]  # in the initial state of the scene
    yield Comparison("open: growth", "1/s", flutter.growth, _OPEN[0], "reference", absolute=1e-3)
    yield Comparison("open: frequency", "Hz", flutter.frequency, _OPEN[1], "reference", absolute=1e-3)
    for delta, bands in _STABLE.items():
        at = growth(brake, delta, 50.0, 1.0)
        what = f"delta {delta:g}, 50 ohm, in tune: growth"
        yield Comparison(what, "1/s", at, _LEAST[delta], "reference", absolute=1e-3)
        for R, ends in bands.items():
            edges = _edges(partial(growth, brake, delta, R))
            for which, expected, edge in zip(("from", "to"), ends, edges):
                what = f"delta {delta:g}, {R:g} ohm: stable {which} L / L_LRC"
                yield Comparison(what, "", edge, expected, "reference", absolute=5e-3)
    for delta in (0.0, -0.5):
        widths = [_band(brake, delta, R) for R in _TRIED]
        widest = _TRIED[int(np.argmax(widths))]
        what = f"delta {delta:g}: resistance of the widest band"
        yield Comparison(what, "ohm", widest, 50.0, "paper", relative=0.1, missed=True)
        for R, width in zip(_TRIED, widths):
            if R in (1.0, 15.0, 50.0, 100.0):
                what = f"delta {delta:g}, {R:g} ohm: width of the band over that of the widest"
                yield Comparison(what, "", width / max(widths), math.nan, "paper")
    limit = brentq(lambda R: growth(brake, 0.0, R, 0.985), 100.0, 200.0, xtol=1e-3)
    yield Comparison("delta 0: resistance above which no tuning stabilises", "ohm", limit, 150.0, "paper", absolute=1.0)


ENTRIES = (
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
