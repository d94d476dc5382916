"""Kroeger, Neubauer, Popp (2008), section 4: control loops, the tuned mass, dither."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure

import rig
from rig.analysis.cycles.averaged import mean_friction
from rig.papers.entry import (
    TOLD,
    Compared,
    Comparison,
    Entry,
    compared,
    law_of,
    load,
    log_slope,
    quiet,
    table,
    tops,
    value,
)
from rig.record.run import Reals, Run
from rig.view.palette import AMBER, BLUE, GREY, VERMILION

_SHOWN = (2.5, 9.0)  # seconds that the figures show: the limit cycle, and its decay after the loop is closed
FORCE_GAINS = {0.0: None, 100.0: 0.064, 200.0: -1.88, 300.0: -4.68, 400.0: -7.49}
"""Gain [N s/m]: remaining amplitude [m/s], or decay if negative [1/s]."""
BELT_GAINS = {0.0: None, 0.5: 0.137, 1.33: -1.32, 2.66: -7.57, 4.0: 0.0, 5.33: 0.0}
"""The same over the gain of the belt's speed."""
CELLS = (
    (
        "belt_normal_force",
        (
            (100.0, 0, 0.064),
            (150.0, 0, -0.49),
            (150.0, 20, 0.058),
            (200.0, 0, -1.88),
            (200.0, 20, -1.45),
            (200.0, 50, 0.063),
            (300.0, 20, -5.02),
            (300.0, 50, 0.063),
            (400.0, 10, -9.33),
            (400.0, 50, 0.063),
        ),
    ),
    (
        "belt_velocity_feedback",
        (
            (0.5, 0, 0.137),
            (1.0, 10, 0.258),
            (1.33, 0, -1.32),
            (1.33, 20, 0.260),
            (2.66, 0, -7.57),
            (2.66, 5, -7.85),
            (2.66, 20, 0.085),
            (4.0, 30, 0.075),
        ),
    ),
)
"""Scene; gain [its own unit], delay of the loop [ms], remaining amplitude [m/s], or decay if negative [1/s]."""


def _run(name: str, **changes: Any) -> Run:
    """Run a scene for 20 s with changes of its controller."""
    controller = next(iter(load(name).controllers))
    settings = {f"controllers__{controller}__{field}": setting for field, setting in changes.items()}
    return rig.simulate(load(name, **settings), 20.0)


def _remaining(what: str, ran: Run, expected: float, **slack: Any) -> Comparison:
    """Compare the amplitude after 16 s [m/s] or, if `expected` is negative, the decay [1/s]."""
    v = ran.signals["velocity"]
    if expected < 0.0:
        return Comparison(f"{what}: decay", "1/s", decay(ran.time, v), expected, "reference", relative=0.05, **slack)
    left = 0.5 * float(np.ptp(v[ran.time > 16.0]))
    return Comparison(f"{what}: amplitude", "m/s", left, expected, "reference", absolute=3e-3)


def decay(time: Reals, v: Reals) -> float:
    """Return the slope of ln of the positive maxima of v between 1e-6 and 0.018 m/s after 4 s [1/s]."""
    after = time > 4.0
    t = time[after]
    w = v[after]
    top = tops(w)
    top = top[(w[top] > 1e-6) & (w[top] < 0.018)]
    return log_slope(t[top], w[top])


def feedback(figure: Figure) -> Compared:
    """Draw normal-force feedback switched on at 4 s, gains 0 to 400 N s/m."""
    yield from _loops(figure, "belt_normal_force", FORCE_GAINS, "N s/m", _normal_force)


def _normal_force(axis: Axes, ran: Run) -> None:
    presses = axis.twinx()
    presses.plot(ran.time, ran.signals["normal_force"], color=AMBER, lw=0.8)
    presses.spines.right.set_visible(True)
    presses.set(ylabel="normal\nforce [N]", ylim=(-5.0, 65.0))
    presses.yaxis.label.set_color(AMBER)


def belt_feedback(figure: Figure) -> Compared:
    """Draw belt-velocity feedback switched on at 4 s."""
    yield from _loops(figure, "belt_velocity_feedback", BELT_GAINS, "", _belt_speed)
    figure.axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2)


def _belt_speed(axis: Axes, ran: Run) -> None:
    speed = 1e3 * ran.signals["surface_speed"]
    axis.plot(ran.time, speed, ls="--", color=AMBER, lw=0.9, label="speed of the belt")


def _loops(
    figure: Figure, name: str, gains: Mapping[float, float | None], unit: str, beside: Callable[[Axes, Run], object]
) -> Compared:
    """Draw the velocity for each gain; `beside`: what else is drawn into its panel."""
    axes = figure.subplots(len(gains), 1, sharex=True)
    for axis, (gain, expected) in zip(axes, gains.items()):
        ran = _run(name, gain=gain)
        axis.plot(ran.time, 1e3 * ran.signals["velocity"], color=BLUE, lw=0.9, label="velocity of the mass")
        beside(axis, ran)
        axis.set_ylabel("velocity\n[mm/s]")
        axis.set_title(f"gain K = {gain:g} {unit}".strip(), fontsize=9.5)
        axis.axvline(4.0, color=GREY, lw=0.7, ls="--")
        if expected is not None:
            yield _remaining(f"K = {gain:g} {unit}", ran, expected)
    axes[-1].set(xlabel="time [s]; the loop is closed at 4 s", xlim=_SHOWN)


def loops(figure: Figure) -> Compared:
    """Draw the remaining vibration 16 s after a loop is closed, over gain and delay."""
    for axis, (name, cells), unit in zip(figure.subplots(1, 2), CELLS, ("N s/m", "")):
        rows = []
        for gain, delay, expected in cells:
            what = f"{name}, K = {gain:g} {unit}".rstrip() + f", {delay} ms"
            ran = _run(name, gain=gain, delay=f"{delay} ms")
            comparison = _remaining(what, ran, expected, absolute=5e-3)
            remains = expected > 0.0
            ours, printed = (f"{1e3 * v:.0f} mm/s" if remains else f"{v:.2f} 1/s" for v in (comparison.ours, expected))
            rows.append((f"{gain:g}", f"{delay}", ours, printed))
            yield comparison
        axis.set_title({"N s/m": "normal force"}.get(unit, "speed of the belt"))
        heads = (f"K [{unit}]" if unit else "K", "delay [ms]", "ours", "expected")
        table(axis, rows, heads, 9.5, 1.45)


def normal_force_energy(figure: Figure) -> Compared:
    """Draw a harmonic motion of characteristic B, with and without control (equations 4.2 to 4.4)."""
    mu0 = 0.4
    fall = 0.8
    speed = 0.06
    force = 20.0
    swing = 0.04
    law = law_of(load("belt_b"))
    period = 2.0 * math.pi * math.sqrt(5.0 / 2500.0)

    def histories(K: float, periods: int, samples: int) -> tuple[np.ndarray, ...]:
        t = np.linspace(0.0, periods * period, periods * samples + 1)
        v = swing * np.sin(2.0 * math.pi * t / period)
        friction = np.array([law.mu(speed - velocity) for velocity in v]) * (force - K * v)
        power = friction * v
        steps = 0.5 * (power[1:] + power[:-1]) * np.diff(t)
        return t, v, friction, np.concatenate([[0.0], np.cumsum(steps)])

    axes = figure.subplots(4, 1, sharex=True)
    for K, colour, line, name in (
        (0.0, GREY, "--", "constant normal force"),
        (100.0, BLUE, "-", "controlled, K = 100 N s/m"),
    ):
        t, v, friction, put_in = histories(K, 2, 400)
        share = t / period
        curves = (1e3 * v, 1e3 * (speed - v), friction, 1e3 * put_in)
        for axis, shown in zip(axes, curves):
            axis.plot(share, shown, line, color=colour, label=name)
        axes[3].plot(share[::400], 1e3 * put_in[::400], "o", color=colour, markersize=5)
    labels = ("velocity\n[mm/s]", "relative\nvelocity [mm/s]", "friction\nforce [N]", "energy\ninput [mJ]")
    titles = ("(a)", "(b)", "(c)", "(d) points: after each period")
    for title, axis, label in zip(titles, axes, labels):
        axis.set(ylabel=label, xlim=(0.0, 2.0))
        axis.set_title(title, fontsize=10)
        for at in (1.0, 2.0):
            axis.axvline(at, color=GREY, lw=0.6)
    for axis in (axes[0], axes[3]):
        axis.axhline(0.0, color=GREY, lw=0.6)
    axes[1].axhline(1e3 * speed, color=GREY, lw=0.6)
    axes[2].legend(loc="lower right", ncols=2, bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)
    axes[3].set_xlabel("time over the period, cycle")
    for K in (0.0, 100.0, 400.0):
        *_, put_in = histories(K, 1, 4000)
        energy = float(put_in[-1])
        theory = 0.5 * period * swing * (fall * swing * force - (mu0 - fall * speed) * K * swing)
        yield Comparison(f"B, 40 mm/s, K = {K:g} N s/m: equation 4.4", "J", energy, theory, "theory", relative=1e-9)
    mu = 0.25
    gain = 200.0
    changes = {
        "friction__law": "constant",
        "friction__mu": mu,
        "start__displacement": mu * 20.0 / 2500.0,
        "start__velocity": swing,
        "controllers__nf__gain": gain,
        "controllers__nf__enable_at": 0.0,
    }
    ran = rig.simulate(load("belt_normal_force", **changes), 1.5)
    v = ran.signals["velocity"]
    top = tops(v)
    top = top[v[top] > 1e-5]
    rate = log_slope(ran.time[top], v[top])
    theory = -(2.0 + mu * gain) / (2.0 * 5.0)
    yield Comparison("constant mu, simulated: decay (d + mu K) / 2 m", "1/s", rate, theory, "theory", relative=0.01)
    law = law_of(load("belt"))
    balance = (-law.slope(speed) * force - 2.0) / law.mu(speed)
    yield Comparison("A: gain at which it balances the damper", "N s/m", balance, 132.25, "reference", absolute=0.005)


def tuned_mass(figure: Figure) -> Compared:
    """Largest growth rate over damping and tilt of the absorber, with the axes of the paper, and two histories."""
    tilts = np.linspace(-1.2, 1.2, 81)
    ratios = np.linspace(0.03, 0.6, 39)
    growth = np.empty((len(ratios), len(tilts)))
    for i, ratio in enumerate(ratios):
        scene = load("belt_tuned_mass", tuned_mass__damping_ratio=float(ratio))
        growth[i] = rig.sweep(scene, "tuned_mass.angle", tilts).largest
    panels = figure.subplot_mosaic([["map", "up"], ["map", "down"]], width_ratios=(1.4, 1.0))
    axis = panels["map"]
    least = min(float(growth.min()), -1e-3)
    most = max(float(growth.max()), 1e-3)
    norm = TwoSlopeNorm(0.0, least, most)
    mesh = axis.pcolormesh(ratios, tilts, growth.T, cmap="RdBu_r", norm=norm, shading="nearest")
    axis.contour(ratios, tilts, growth.T, levels=[0.0], colors="black", linewidths=1.0)
    figure.colorbar(mesh, ax=axis, label="largest growth rate [1/s]")
    axis.axhline(-0.5 * math.atan(0.379929), color=GREY, ls="--", lw=1.0)
    axis.set(ylabel="tilt [rad]", xlabel="damping ratio D2", xlim=(0.0, 0.6), ylim=(-1.5, 1.5))
    for name, tilt, decays in (("up", 0.305, 1.0), ("down", -0.305, 0.0)):
        ran = rig.simulate(load("belt_tuned_mass", tuned_mass__angle=tilt))
        v = 1e3 * ran.signals["velocity"]
        panels[name].plot(ran.time, v, color=BLUE, lw=0.6)
        panels[name].set(title=f"tilt {tilt:+g} rad, D2 = 0.1", xlabel="time [s]", ylabel="velocity [mm/s]")
        axis.plot([0.1], [tilt], "P" if decays else "o", color="black", mfc="none", markersize=8)
        quarter = len(v) // 4
        left = np.ptp(v[-quarter:]) / np.ptp(v[:quarter])
        ours = float(left < 0.5)
        yield Comparison(f"tilt {tilt:+g}, simulated: decays (1) or limit cycle (0)", "", ours, decays, "paper")
    for tilt, expected in ((0.305, (-0.281, -0.715, -0.063)), (-0.305, (0.546, 0.499, 0.467))):
        for ratio, rate in zip((0.05, 0.1, 0.2), expected):
            scene = load("belt_tuned_mass", tuned_mass__angle=tilt, tuned_mass__damping_ratio=ratio)
            growth_there = rig.modes(scene).sliding.growth
            yield Comparison(f"tilt {tilt:+g}, D2 {ratio:g}", "1/s", growth_there, rate, "reference", absolute=6e-4)


def dither(figure: Figure) -> Compared:
    """Draw the effective friction under dither of the belt, averaged, and simulated at 150 Hz.

    Simulated: the mean force of the spring. The friction force itself jumps, so that samples at a few phases give a
    poor mean.
    """
    law = law_of(load("belt"))
    below = np.linspace(0.005, 0.06, 56)
    above = 0.06 + 0.24 * np.linspace(0.0, 1.0, 121)[1:] ** 3
    amplitudes = np.concatenate([below, above])
    mean = [mean_friction(law, 0.06, 1.0, complex(amplitude))[0] for amplitude in amplitudes]
    axis = figure.subplots()
    axis.plot(1e3 * amplitudes, mean, color=BLUE, label="averaged")
    expected = {0.08: 0.1123, 0.10: 0.0717, 0.15: 0.0401, 0.20: 0.0303}
    simulated = []
    for amplitude in expected:
        scene = quiet(load("belt_dither", dither__amplitude=amplitude, dither__enable=True))
        ran = rig.simulate(scene, 12.0)
        last = ran.time > 8.0
        held = value(scene, "body.stiffness") * float(np.mean(ran.signals["displacement"][last]))
        simulated.append(held / value(scene, "load.force"))
    rows = ((f"simulated at {1e3 * a:g} mm/s", mu, expected[a]) for a, mu in zip(expected, simulated))
    yield from compared(rows, "", "reference", relative=0.01)
    axis.plot([1e3 * a for a in expected], simulated, "o", color=VERMILION, label="simulated, 150 Hz")
    axis.axvline(60.0, color=GREY, lw=0.7, ls="--", label="speed of the belt")
    axis.set(xlabel="amplitude of the dither [mm/s]", ylabel="mean friction coefficient", ylim=(0.0, None))
    axis.legend()


ENTRIES = (
    Entry(
        "kroeger-18",
        "kroeger",
        "Figure 18",
        "energy input under normal-force feedback",
        ("belt_normal_force", "belt_b", "belt"),
        normal_force_energy,
        size=(9.6, 7.0),
    ),
    Entry(
        "kroeger-20",
        "kroeger",
        "Figure 20",
        "normal-force feedback",
        ("belt_normal_force",),
        feedback,
        f"Orange: the normal force, in antiphase with the velocity after the loop is closed. {TOLD}",
        (9.6, 7.6),
    ),
    Entry(
        "kroeger-22",
        "kroeger",
        "Figure 22",
        "belt-velocity feedback",
        ("belt_velocity_feedback",),
        belt_feedback,
        TOLD,
        (9.6, 8.4),
    ),
    Entry(
        "kroeger-23",
        "kroeger",
        "Figure 23",
        "tuned mass over tilt and damping",
        ("belt_tuned_mass",),
        tuned_mass,
        "The map is mirror-symmetric about -atan(mu)/2 (dashed). Marks: the two histories, which start in stick.",
    ),
    Entry(
        "kroeger-loops",
        "kroeger",
        "Section 4",
        "remaining vibration over gain and delay of the loops",
        ("belt_normal_force", "belt_velocity_feedback"),
        loops,
        f"A selection from the tables that the tests compare. {TOLD}",
        (9.6, 4.1),
    ),
    Entry("kroeger-dither", "kroeger", "Section 4", "mean friction under dither", ("belt_dither",), dither),
)
