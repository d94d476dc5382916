"""Liu and Ouyang, Meccanica (2020), sections 2 and 4.1: tangential dither of a mass on a belt.

The values of the nine constants are missing in the paper's text; those of the scenes reproduce its critical friction.
"reference" is an independent computation with these.
"""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import rig
from rig.papers.entry import (
    Compared,
    Comparison,
    Entry,
    compared,
    dither_boundary,
    load,
    numbered,
    quiet,
)
from rig.view.palette import BLUE, GREEN, GREY, VERMILION

_APART = 5  # smallest ratio of frequencies that separates fast and slow motion; below it the start matters
TWO_DOF_RATE = 10.0  # rad/s, sqrt(k1 / m): unit of frequency ratios
_START = {0.4: (0.00016934650120935363, -0.008972106695331914), 0.5: (0.0006617601154591857, -0.008891000543938779)}


def eigenvalues(figure: Figure) -> Compared:
    """Growth rates and frequencies over the friction coefficient."""
    swept = rig.sweep("two_dof", "friction.mu", np.linspace(0.0, 1.0, 101))
    growth, turning = figure.subplots(1, 2)
    growth.plot(swept.axis.values, swept.growth, ".", color=BLUE, markersize=3)
    growth.axhline(0.0, color=GREY, lw=0.7)
    turning.plot(swept.axis.values, 2.0 * math.pi * swept.frequency, ".", color=BLUE, markersize=3)
    [limit] = [crossing.value for crossing in swept.critical]
    for axis in (growth, turning):
        axis.axvline(limit, color=VERMILION, ls="--", lw=1.0)
        axis.set_xlabel("friction coefficient")
    growth.set(title=f"critical: {limit:.4f}", ylabel="real part [1/s]")
    turning.set(title="frequencies", ylabel="imaginary part [rad/s]")
    yield Comparison("critical friction coefficient", "", limit, 0.37, "paper", absolute=0.005)
    yield Comparison("critical friction coefficient", "", limit, 0.369726, "reference", absolute=1e-6)
    rates = {0.0: -0.093292, 0.35: -0.083183, 0.4: 0.179970, 0.5: 0.453379, 0.8: 0.891916}
    slides = {mu: rig.modes(load("two_dof", friction__mu=mu)).sliding for mu in rates}
    rows = ((f"mu = {mu:g}: largest real part", slides[mu].growth, rate) for mu, rate in rates.items())
    yield from compared(rows, "1/s", "reference", absolute=6e-7)
    free = sorted(2.0 * math.pi * mode.frequency for mode in slides[0.0].modes)
    yield from numbered("mu = 0: frequency {}", free, (9.038414, 10.875867), "rad/s", "reference", absolute=6e-7)


def histories(figure: Figure) -> Compared:
    """Draw the growth up to the lift-off, at which the paper ends its time histories."""
    axes = figure.subplots(2, 2, sharex="row")
    figure.supxlabel("time [s]; dashed: first lift-off, where the paper ends; grey: after it", fontsize=10.5)
    for (along, across), mu, lifts in zip(axes, (0.4, 0.5), (16.295828024162887, 6.846114495624962)):
        x, y = _START[mu]
        scene = load("two_dof", friction__mu=mu, start__displacement=x, start__height=y)
        ran = rig.simulate(quiet(scene), lifts + 2.0)
        first = next(event["t_ns"] * 1e-9 for event in ran.events if event["text"] == "load opens")
        before = ran.time < first
        for axis, name, title in ((along, "displacement", "tangential"), (across, "height", "normal")):
            motion = 1e3 * ran.signals[name]
            axis.plot(ran.time, motion, color=GREY, lw=0.7)
            axis.plot(ran.time[before], motion[before], color=BLUE, lw=0.8)
            axis.axvline(first, color=VERMILION, ls="--", lw=1.0)
            axis.set(title=f"{title}, mu = {mu:g}", ylabel=f"{name} [mm]")
        yield Comparison(f"mu = {mu:g}: lift-off", "s", first, lifts, "reference", relative=1e-6)


def suppressed(figure: Figure) -> Compared:
    """Draw dither of 78 N at twenty times the rig's frequency, from 10 s on."""
    axes = figure.subplots(2, 2, sharex=True)
    for (along, across), mu in zip(axes, (0.4, 0.5)):
        x, y = _START[mu]
        scene = load("two_dof_dither", friction__mu=mu, start__displacement=x, start__height=y)
        ran = rig.simulate(scene)
        for axis, name, title in ((along, "displacement", "tangential"), (across, "height", "normal")):
            axis.plot(ran.time, 1e3 * ran.signals[name], color=BLUE, lw=0.5)
            axis.axvline(10.0, color=VERMILION, ls="--", lw=1.0)
            axis.set(title=f"{title}, mu = {mu:g}", ylabel=f"{name} [mm]")
        last = ran.time > ran.time[-1] - 2.0 * math.pi
        height = ran.signals["height"][last]
        ripple = 0.5 * float(np.ptp(ran.signals["displacement"][last]))
        left = 0.5 * float(np.ptp(height))
        yield Comparison(f"mu = {mu:g}: tangential ripple A / (m omega^2)", "mm", 1e3 * ripple, 1.95, "theory", 0.005)
        yield Comparison(f"mu = {mu:g}: normal motion left", "mm", 1e3 * left, 0.0, "theory", absolute=2e-3)
        if mu == 0.5:
            mean = float(height.mean())
            yield Comparison("mu = 0.5: tangential ripple", "mm", 1e3 * ripple, 1.95485, "reference", relative=1e-3)
            yield Comparison("mu = 0.5: mean height", "mm", 1e3 * mean, -10.0808172, "reference", absolute=1e-3)
    for axis in axes[-1]:
        axis.set_xlabel("time [s]; dither from 10 s on")


def boundaries(figure: Figure) -> Compared:
    """Amplitude above which dither stabilises, over the ratio of frequencies, for friction coefficients."""
    cases = (
        (0.5, 0.3, 1.0562895154708665, {3: 0.94453125, 5: 1.01640625, 10: 1.04609375, 20: 1.05347899}),
        (0.6, 0.3, 1.1789416427279622, {3: 1.05546875, 5: 1.13359375, 10: 1.16796875, 20: 1.17578125}),
        (0.8, 0.3, 1.4635918708335020, {3: 1.31015625, 5: 1.40859375, 10: 1.44921875, 20: 1.46015625}),
    )
    yield from _boundaries(figure.subplots(), cases, "mu = {mu:g}")


def faster(figure: Figure) -> Compared:
    """The same for speeds of the belt."""
    cases = (
        (0.6, 0.2, 1.1606817170235504, {3: 1.04609375, 5: 1.11953125, 20: 1.15809080}),
        (0.6, 0.3, 1.1789416427279622, {3: 1.05546875, 5: 1.13359375, 20: 1.17578125}),
        (0.6, 0.4, 1.1877710394906720, {3: 1.06015625, 5: 1.14140625, 20: 1.185}),
    )
    yield from _boundaries(figure.subplots(), cases, "belt at {V:g} m/s")


def _boundaries(axis: Axes, cases: tuple[tuple[float, float, float, dict[int, float]], ...], label: str) -> Compared:
    """`cases`: friction, speed [m/s], critical a / V by averaging, and by simulation at each ratio of frequencies."""
    for (mu, V, by_average, simulated), colour, mark in zip(cases, (BLUE, VERMILION, GREEN), "osD"):
        parameters = label.format(mu=mu, V=V)
        top = 22.0 * by_average * V * TWO_DOF_RATE
        axis.plot([0.0, 22.0], [0.0, top], color=colour, label=f"{parameters}: averaged")
        for ratio, expected in simulated.items():
            scene = load("two_dof_dither", friction__mu=mu, drive__speed=V)
            leading, _, critical = dither_boundary(scene, ratio * TWO_DOF_RATE, V, np.linspace(0.85, 1.65, 9))
            force = critical * V * TWO_DOF_RATE * ratio
            first = ratio == min(simulated)
            named = f"{parameters}: simulated" if first else ""
            axis.plot([ratio], [force], mark, color=colour, label=named)
            if first:
                yield Comparison(f"{parameters}: averaged, a / V", "", leading, by_average, "reference", relative=1e-6)
            if ratio >= _APART:
                what = f"{parameters}: simulated at ratio {ratio}, a / V"
                yield Comparison(what, "", critical, expected, "reference", absolute=0.005)
    axis.set(xlabel="frequency of the dither over sqrt(k1 / m) [1]", ylabel="amplitude of the dither [N]")
    axis.set(xlim=(0.0, 22.0), ylim=(0.0, None))
    axis.legend(loc="upper left")


ENTRIES = (
    Entry("liu000-3", "liu000", "Figure 3", "eigenvalues over the friction coefficient", ("two_dof",), eigenvalues),
    Entry(
        "liu000-4",
        "liu000",
        "Figure 4",
        "growth above the critical friction",
        ("two_dof",),
        histories,
        "The paper ends at the lift-off (dashed); the motion after it is grey.",
        (9.6, 6.4),
    ),
    Entry(
        "liu000-5",
        "liu000",
        "Figure 5",
        "the same under tangential dither",
        ("two_dof_dither",),
        suppressed,
        size=(9.6, 6.4),
    ),
    Entry(
        "liu000-6",
        "liu000",
        "Figure 6",
        "stabilising dither over frequency and friction",
        ("two_dof_dither",),
        boundaries,
        "Stable above each line. The simulated boundary approaches the averaged one with the square of the "
        "frequency. At a ratio of 3 it depends on the start; it is drawn, but not compared.",
    ),
    Entry(
        "liu000-7",
        "liu000",
        "Figure 7",
        "stabilising dither over frequency and speed",
        ("two_dof_dither",),
        faster,
        "Stable above each line. At a ratio of 3 the boundary depends on the start; it is drawn, but not compared.",
    ),
)
