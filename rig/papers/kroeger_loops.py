"""Kroeger, Neubauer, Popp (2008), section 4: control loops, the tuned mass, dither."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rig.papers.entry import Comparison, Entry, law_of, load, quiet, run, value
from rig.view.palette import AMBER, BLUE, GREY, VERMILION

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]


_SHOWN = (2.5, 9.0)
"""Seconds that the figures show: the limit cycle, and its decay after the loop is closed."""


def feedback(figure: Figure) -> Iterator[Comparison]:
    """Draw normal-force feedback switched on at 4 s, gains 0 to 400 N s/m."""
    yield from _loops(
        figure, "belt_normal_force", (0.0, 100.0, 200.0, 300.0, 400.0), "N s/m",
        {100.0: ("L", 0.064), 200.0: ("rate", -1.88), 300.0: ("rate", -4.68), 400.0: ("rate", -7.49)},
    )  # fmt: skip


def belt_feedback(figure: Figure) -> Iterator[Comparison]:
    """Draw belt-velocity feedback switched on at 4 s."""
    yield from _loops(
        figure, "belt_velocity_feedback", (0.0, 0.5, 1.33, 2.66, 4.0, 5.33), "",
        {0.5: ("L", 0.137), 1.33: ("rate", -1.32), 2.66: ("rate", -7.57), 4.0: ("L", 0.0), 5.33: ("L", 0.0)},
        belt=True,
    )  # fmt: skip


def _loops(
    figure: Figure,
    name: str,
    gains: tuple[float, ...],
    unit: str,
    reference: Mapping[float, tuple[str, float]],
    belt: bool = False,
) -> Iterator[Comparison]:
    axes = figure.subplots(len(gains), 1, sharex=True)
    for axis, gain in zip(axes, gains):
        presses = None if belt else axis.twinx()
        scene = load(name)
        key = next(iter(scene.controllers))
        ran = run(load(name, **{f"controllers__{key}__gain": gain}), 20.0)
        v = ran.signals["velocity"]
        axis.plot(ran.time, 1e3 * v, color=BLUE, lw=0.9, label="velocity of the mass")
        if belt:
            axis.plot(
                ran.time, 1e3 * ran.signals["surface_speed"], "--", color=AMBER, lw=0.9, label="speed of the belt"
            )
        if presses is not None:
            presses.plot(ran.time, ran.signals["normal_force"], color=AMBER, lw=0.8)
            presses.spines.right.set_visible(True)
            presses.set(ylabel="normal\nforce [N]", ylim=(-5.0, 65.0))
            presses.yaxis.label.set_color(AMBER)
        axis.set_ylabel("velocity\n[mm/s]")
        axis.set_title(f"gain K = {gain:g} {unit}".strip(), fontsize=9.5)
        axis.axvline(4.0, color=GREY, lw=0.7, ls="--")
        if gain in reference:
            kind, expected = reference[gain]
            if kind == "L":
                tail = v[ran.time > 16.0]
                amplitude = 0.5 * float(tail.max() - tail.min())
                yield Comparison(
                    f"K = {gain:g} {unit}: amplitude", "m/s", amplitude, expected, "reference", absolute=3e-3
                )
            else:
                yield Comparison(
                    f"K = {gain:g} {unit}: decay", "1/s", decay(ran.time, v), expected, "reference", relative=0.05
                )
    if belt:
        axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2)
    axes[-1].set(xlabel="time [s]; the loop is closed at 4 s", xlim=_SHOWN)


def decay(time: Array, v: Array) -> float:
    """Return the slope of ln of the positive maxima of v between 1e-6 and 0.018 m/s after 4 s [1/s]."""
    after = time > 4.0
    t, w = time[after], v[after]
    top = np.flatnonzero((w[1:-1] > w[:-2]) & (w[1:-1] >= w[2:])) + 1
    top = top[(w[top] > 1e-6) & (w[top] < 0.018)]
    return float(np.polyfit(t[top], np.log(w[top]), 1)[0])


CELLS = (
    ("belt_normal_force", ((100.0, 0, 0.064), (150.0, 0, -0.49), (150.0, 20, 0.058), (200.0, 0, -1.88),
                           (200.0, 20, -1.45), (200.0, 50, 0.063), (300.0, 20, -5.02), (300.0, 50, 0.063),
                           (400.0, 10, -9.33), (400.0, 50, 0.063))),
    ("belt_velocity_feedback", ((0.5, 0, 0.137), (1.0, 10, 0.258), (1.33, 0, -1.32), (1.33, 20, 0.260),
                                (2.66, 0, -7.57), (2.66, 5, -7.85), (2.66, 20, 0.085), (4.0, 30, 0.075))),
)  # fmt: skip
"""Scene; gain [its own unit], delay of the loop [ms], remaining amplitude [m/s], or decay if negative [1/s]."""


def loops(figure: Figure) -> Iterator[Comparison]:
    """Draw the remaining vibration 16 s after a loop is closed, over gain and delay."""
    for axis, (name, cells), unit in zip(figure.subplots(1, 2), CELLS, ("N s/m", "")):
        rows = []
        for gain, delay, expected in cells:
            key = next(iter(load(name).controllers))
            changes = {f"controllers__{key}__gain": gain, f"controllers__{key}__delay": f"{delay} ms"}
            ran = run(load(name, **changes), 20.0)
            what = f"{name}, K = {gain:g} {unit}".rstrip() + f", {delay} ms"
            if expected > 0.0:
                tail = ran.signals["velocity"][ran.time > 16.0]
                left = 0.5 * float(np.ptp(tail))
                comparison = Comparison(f"{what}: amplitude", "m/s", left, expected, "reference", absolute=3e-3)
                numbers = f"{1e3 * left:.0f} mm/s", f"{1e3 * expected:.0f} mm/s"
            else:
                rate = decay(ran.time, ran.signals["velocity"])
                comparison = Comparison(
                    f"{what}: decay", "1/s", rate, expected, "reference", relative=0.05, absolute=5e-3
                )
                numbers = f"{rate:.2f} 1/s", f"{expected:.2f} 1/s"
            rows.append((f"{gain:g}", f"{delay}", *numbers))
            yield comparison
        axis.axis("off")
        axis.set_title({"N s/m": "normal force"}.get(unit, "speed of the belt"))
        heads = (f"K [{unit}]" if unit else "K", "delay [ms]", "ours", "expected")
        table = axis.table(rows, colLabels=heads, loc="upper center", cellLoc="center", edges="horizontal")
        table.auto_set_font_size(False)
        table.set_fontsize(9.5)
        table.scale(1.0, 1.45)


def normal_force_energy(figure: Figure) -> Iterator[Comparison]:
    """Draw a harmonic motion of characteristic B, with and without control (equations 4.2 to 4.4)."""
    mu0, fall, speed, force, swing = 0.4, 0.8, 0.06, 20.0, 0.04
    law = law_of(load("belt_b"))
    period = 2.0 * math.pi * math.sqrt(5.0 / 2500.0)

    def histories(K: float, periods: int, samples: int) -> tuple[np.ndarray, ...]:
        t = np.linspace(0.0, periods * period, periods * samples + 1)
        v = swing * np.sin(2.0 * math.pi * t / period)
        friction = np.array([law.mu(speed - velocity) for velocity in v]) * (force - K * v)
        power = friction * v
        return t, v, friction, np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(t))])

    axes = figure.subplots(4, 1, sharex=True)
    for K, colour, line, name in (
        (0.0, GREY, "--", "constant normal force"),
        (100.0, BLUE, "-", "controlled, K = 100 N s/m"),
    ):
        t, v, friction, put_in = histories(K, 2, 400)
        share = t / period
        for axis, shown in zip(axes, (1e3 * v, 1e3 * (speed - v), friction, 1e3 * put_in)):
            axis.plot(share, shown, line, color=colour, label=name)
        axes[3].plot(share[::400], 1e3 * put_in[::400], "o", color=colour, markersize=5)
    labels = ("velocity\n[mm/s]", "relative\nvelocity [mm/s]", "friction\nforce [N]", "energy\ninput [mJ]")
    for letter, axis, label in zip("abcd", axes, labels):
        axis.set(ylabel=label, xlim=(0.0, 2.0))
        axis.set_title(f"({letter})", fontsize=10)
        for at in (1.0, 2.0):
            axis.axvline(at, color=GREY, lw=0.6)
    for axis in (axes[0], axes[3]):
        axis.axhline(0.0, color=GREY, lw=0.6)
    axes[1].axhline(1e3 * speed, color=GREY, lw=0.6)
    axes[3].set_title("(d) points: after each period", fontsize=10)
    axes[2].legend(loc="lower right", ncols=2, bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)
    axes[3].set_xlabel("time over the period, cycle")
    for K in (0.0, 100.0, 400.0):
        energy = float(histories(K, 1, 4000)[3][-1])
        theory = 0.5 * period * swing * (fall * swing * force - (mu0 - fall * speed) * K * swing)
        yield Comparison(f"B, 40 mm/s, K = {K:g} N s/m: equation 4.4", "J", energy, theory, "theory", relative=1e-9)
    mu, gain = 0.25, 200.0
    changes = {"friction__law": "constant", "friction__mu": mu, "start__displacement": mu * 20.0 / 2500.0,
               "start__velocity": swing, "controllers__nf__gain": gain, "controllers__nf__enable_at": 0.0}  # fmt: skip
    ran = run(load("belt_normal_force", **changes), 1.5)
    v = ran.signals["velocity"]
    top = np.flatnonzero((v[1:-1] > v[:-2]) & (v[1:-1] >= v[2:]) & (v[1:-1] > 1e-5)) + 1
    rate = float(np.polyfit(ran.time[top], np.log(v[top]), 1)[0])
    theory = -(2.0 + mu * gain) / (2.0 * 5.0)
    yield Comparison("constant mu, simulated: decay (d + mu K) / 2 m", "1/s", rate, theory, "theory", relative=0.01)
    law = law_of(load("belt"))
    balance = (-law.slope(speed) * force - 2.0) / law.mu(speed)
    yield Comparison("A: gain at which it balances the damper", "N s/m", balance, 132.25, "reference", absolute=0.005)


def tuned_mass(figure: Figure) -> Iterator[Comparison]:
    """Largest growth rate over damping and tilt of the absorber, with the axes of the paper, and two histories."""
    from matplotlib.colors import TwoSlopeNorm

    import rig

    tilts, ratios = np.linspace(-1.2, 1.2, 81), np.linspace(0.03, 0.6, 39)
    growth = np.empty((len(ratios), len(tilts)))
    for i, ratio in enumerate(ratios):
        scene = load("belt_tuned_mass", tuned_mass__damping_ratio=float(ratio))
        growth[i] = rig.sweep(scene, "tuned_mass.angle", tilts).largest
    panels = figure.subplot_mosaic([["map", "up"], ["map", "down"]], width_ratios=(1.4, 1.0))
    axis = panels["map"]
    norm = TwoSlopeNorm(0.0, min(float(growth.min()), -1e-3), max(float(growth.max()), 1e-3))
    mesh = axis.pcolormesh(ratios, tilts, growth.T, cmap="RdBu_r", norm=norm, shading="nearest")
    axis.contour(ratios, tilts, growth.T, levels=[0.0], colors="black", linewidths=1.0)
    figure.colorbar(mesh, ax=axis, label="largest growth rate [1/s]")
    mu = 0.379929
    axis.axhline(-0.5 * math.atan(mu), color=GREY, ls="--", lw=1.0)
    axis.set(ylabel="tilt [rad]", xlabel="damping ratio D2", xlim=(0.0, 0.6), ylim=(-1.5, 1.5))
    for name, tilt, decays in (("up", 0.305, 1.0), ("down", -0.305, 0.0)):
        ran = run(load("belt_tuned_mass", tuned_mass__angle=tilt))
        v = 1e3 * ran.signals["velocity"]
        panels[name].plot(ran.time, v, color=BLUE, lw=0.6)
        panels[name].set(title=f"tilt {tilt:+g} rad, D2 = 0.1", xlabel="time [s]", ylabel="velocity [mm/s]")
        axis.plot([0.1], [tilt], "P" if decays else "o", color="black", mfc="none", markersize=8)
        quarter = len(v) // 4
        left = float(np.ptp(v[-quarter:]) / np.ptp(v[:quarter]))
        yield Comparison(f"tilt {tilt:+g}, simulated: decays (1) or limit cycle (0)", "", float(left < 0.5), decays,
                         "paper")  # fmt: skip
    for tilt, expected in ((0.305, (-0.281, -0.715, -0.063)), (-0.305, (0.546, 0.499, 0.467))):
        for ratio, rate in zip((0.05, 0.1, 0.2), expected):
            scene = load("belt_tuned_mass", tuned_mass__angle=tilt, tuned_mass__damping_ratio=ratio)
            computed = rig.modes(scene).sliding.growth
            yield Comparison(f"tilt {tilt:+g}, D2 {ratio:g}", "1/s", computed, rate, "reference", absolute=6e-4)


def dither(figure: Figure) -> Iterator[Comparison]:
    """Draw the effective friction under dither of the belt, averaged, and simulated at 150 Hz.

    Simulated: the mean force of the spring. The friction force itself jumps, so that samples at a few phases give a
    poor mean.
    """
    from rig.analysis.averaged import mean_friction

    law = law_of(load("belt"))
    amplitudes = np.concatenate([np.linspace(0.005, 0.06, 56), 0.06 + 0.24 * np.linspace(0.0, 1.0, 121)[1:] ** 3])
    mean = [mean_friction(law, 0.06, 1.0, complex(a))[0] for a in amplitudes]
    axis = figure.subplots()
    axis.plot(1e3 * amplitudes, mean, color=BLUE, label="averaged")
    simulated = []
    for amplitude, expected in ((0.08, 0.1123), (0.10, 0.0717), (0.15, 0.0401), (0.20, 0.0303)):
        scene = quiet(load("belt_dither", dither__amplitude=amplitude, dither__enable=True))
        ran = run(scene, 12.0)
        last = ran.time > 8.0
        held = value(scene, "body.stiffness") * float(np.mean(ran.signals["displacement"][last]))
        mu = held / value(scene, "load.force")
        simulated.append((amplitude, mu))
        yield Comparison(f"simulated at {1e3 * amplitude:g} mm/s", "", mu, expected, "reference", relative=0.01)
    axis.plot(
        [1e3 * a for a, _ in simulated], [mu for _, mu in simulated], "o", color=VERMILION, label="simulated, 150 Hz"
    )
    axis.axvline(60.0, color=GREY, lw=0.7, ls="--", label="speed of the belt")
    axis.set(xlabel="amplitude of the dither [mm/s]", ylabel="mean friction coefficient", ylim=(0.0, None))
    axis.legend()


ENTRIES = (
    Entry("kroeger-18", "kroeger", "Figure 18", "energy input under normal-force feedback",
          ("belt_normal_force", "belt_b", "belt"), normal_force_energy, size=(9.6, 7.0)),
    Entry("kroeger-20", "kroeger", "Figure 20", "normal-force feedback", ("belt_normal_force",), feedback,
          "Orange: the normal force, in antiphase with the velocity after the loop is closed.", (9.6, 7.6)),
    Entry("kroeger-22", "kroeger", "Figure 22", "belt-velocity feedback", ("belt_velocity_feedback",), belt_feedback,
          size=(9.6, 8.4)),
    Entry("kroeger-23", "kroeger", "Figure 23", "tuned mass over tilt and damping", ("belt_tuned_mass",), tuned_mass,
          "The map is mirror-symmetric about -atan(mu)/2 (dashed). Marks: the two histories, which start in stick."),
    Entry("kroeger-loops", "kroeger", "Section 4", "remaining vibration over gain and delay of the loops",
          ("belt_normal_force", "belt_velocity_feedback"), loops, "A selection from the tables that the tests compare.",
          (9.6, 4.1)),
    Entry("kroeger-dither", "kroeger", "Section 4", "mean friction under dither", ("belt_dither",), dither),
)  # fmt: skip
