"""Kroeger, Neubauer, Popp (2008), sections 3c and 4: eigenvalues of the disc brake, its squeal damped by a stack.

The paper prints 0.64 and 2140 Hz; the axes of its figure 21 end at 10 mm/s, 50 V and 0.83 s. "reference" is an
independent computation with the parameters of the scene.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import rig
from rig.papers.entry import TOLD, Compared, Comparison, Entry, load, value
from rig.record.run import Reals
from rig.view.palette import BLUE, GREY, VERMILION

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
    coefficients = np.array(swept.axis.values)
    mu = np.broadcast_to(coefficients[:, None], near.shape)[near]
    g = swept.growth[near]
    f = swept.frequency[near]
    dots = plane.scatter(g, f, c=mu, s=14, cmap="viridis", zorder=3)
    figure.colorbar(dots, ax=plane, location="bottom", shrink=0.8, label="friction coefficient")
    growth.plot(mu, g, ".", color=BLUE, markersize=3.0)
    frequency.plot(mu, f, ".", color=BLUE, markersize=3.0)
    circle: dict[str, Any] = {"mfc": "none", "color": VERMILION, "markersize": 7}
    for coefficient, branches in _BRANCHES.items():
        if coefficient > swept.axis.values[-1]:
            continue
        for rate, hertz in branches:
            plane.plot([rate], [hertz], "o", **circle)
            growth.plot([coefficient], [rate], "o", **circle)
            frequency.plot([coefficient], [hertz], "o", **circle)
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
    t = ran.time - closed
    v = 1e3 * ran.signals["velocity"]
    U = ran.signals["stack_voltage"]
    for axis, shown, label in zip(figure.subplots(2, 1, sharex=True), (v, U), ("velocity [mm/s]", "voltage [V]")):
        axis.plot(1e3 * t, shown, color=BLUE, lw=0.6)
        axis.axvline(0.0, color=GREY, lw=0.7, ls="--")
        axis.set_ylabel(label)
    axis.set(xlabel="time since the loop was closed [ms]", xlim=(-30.0, 60.0))

    def peak(shown: Reals, begin: float, end: float) -> float:
        inside = (t >= begin) & (t < end)
        return float(np.abs(shown[inside]).max())

    free = rig.modes(scene).sliding.modes[0]
    yield Comparison("growth, loop open", "1/s", free.growth, 54.0367597, "reference", absolute=1e-3)
    grows = math.log(peak(v, -0.006, -0.001) / peak(v, -0.026, -0.021)) / 0.02
    yield Comparison("growth, loop open, simulated", "1/s", grows, free.growth, "theory", relative=0.05)
    squeals = peak(v, -0.005, 0.0)
    what = "velocity when the loop is closed (end of the axis: 10)"
    yield Comparison(what, "mm/s", squeals, 10.0, "paper", relative=0.15)
    left = peak(v, 0.03, 0.04)
    yield Comparison("largest velocity 30 ms later (paper: declines)", "mm/s", left, 0.0, "paper", absolute=1.0)
    voltage = peak(U, 0.0, 0.09)
    yield Comparison("largest voltage: the limit of the amplifier", "V", voltage, 50.0, "theory", relative=1e-9)


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
)
