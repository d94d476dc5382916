"""Kroeger, Neubauer, Popp (2008), sections 2 and 3: limit cycles, instability mechanisms, the seal, the tread block.

The paper prints few numbers; "reference" is an independent computation with the parameters of the scenes.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.optimize import minimize_scalar

import rig
from rig.analysis.cycles.cycle_report import Cycle
from rig.papers.entry import Compared, Comparison, Entry, compared, law_of, load, quiet, value
from rig.record.run import Reals
from rig.view.palette import AMBER, BLUE, GREEN, GREY, VERMILION

FINE = "5 us"  # frame of the runs of the tread block, whose cycle lasts 0.4 to 4 ms
_LIMITS = {
    0.0: 6.139,
    10.0: 5.924,
    20.0: 5.730,
    50.0: 5.236,
    100.0: 4.619,
    200.0: 3.797,
    500.0: 2.551,
    1000.0: 1.646,
}
"""Damping of the seal [N s/m]: critical speed [mm/s] of the reference."""


def cycles(figure: Figure) -> Compared:
    """Phase curves and friction characteristics A, B, C."""
    reference = {
        "belt": (0.3216037, 0.1028673, -0.1012989),
        "belt_b": (0.2908261, 0.0471273, -0.0730706),
        "belt_c": (0.2833789, 0.0400000, -0.0657267),
        "belt_c_damped": (0.2824424, 0.0321309, -0.0639330),
    }
    laws, phases = figure.subplots(1, 2)
    looks = {"belt": ("A", BLUE, "-"), "belt_b": ("B", VERMILION, "-"), "belt_c": ("C", GREEN, "-")}
    looks |= {"belt_c_damped": ("C, damped", "black", ":")}  # it has the law of C, which is visible between the dots
    for name, (period, stick, lowest) in reference.items():
        shown, colour, line = looks[name]
        scene = load(name)
        cycle = rig.limit_cycle(scene)
        law = law_of(scene)
        speeds = np.linspace(1e-6, 0.3, 300)
        laws.plot(1e3 * speeds, [law.mu(v) for v in speeds], color=colour, ls=line, label=f"{shown} ({name})")
        if name != "belt_c_damped":
            size = 9 if name == "belt_c" else 4
            laws.plot([0.0], [law.static], "o", color=colour, markersize=size, fillstyle="none")
        ran = rig.simulate(quiet(scene), 12.0)
        last = ran.time > ran.time[-1] - 2.0 * cycle.period
        x = 1e3 * ran.signals["displacement"][last]
        v = 1e3 * ran.signals["velocity"][last]
        phases.plot(x, v, color=colour, ls=line)
        bound: dict[str, Any] = {"source": "reference", "relative": 5e-7, "absolute": 6e-8}
        yield Comparison(f"{name}: period", "s", cycle.period, period, **bound)
        yield Comparison(f"{name}: time in stick", "s", cycle.stick_time["contact"], stick, **bound)
        yield Comparison(f"{name}: lowest velocity", "m/s", cycle.extremes["velocity"][0], lowest, **bound)
    laws.set(title="characteristics", ylim=(0.0, None), xlabel="slip speed [mm/s]", ylabel="friction coefficient")
    laws.legend()
    phases.set(title="limit cycles", xlabel="displacement [mm]", ylabel="velocity [mm/s]")


def onset(figure: Figure) -> Compared:
    """Draw motions from near the equilibrium: A and B spiral outwards, C needs a start outside."""
    axes = figure.subplots(1, 3, sharey=True)
    for name, axis, colour in zip(("belt", "belt_b", "belt_c_damped"), axes, (BLUE, VERMILION, GREEN)):
        modes = rig.modes(quiet(load(name)))
        rest = modes.sliding.equilibrium["displacement"]
        for offset, shade in ((2e-4, 1.0), (4e-3, 0.45)):
            scene = load(name, start__displacement=rest + offset, start__velocity=0.0)
            ran = rig.simulate(quiet(scene), 8.0)
            x = 1e3 * ran.signals["displacement"]
            v = 1e3 * ran.signals["velocity"]
            axis.plot(x, v, color=colour, alpha=shade, lw=0.7)
        axis.set(title=f"{name}, {modes.sliding.growth:+.3f} 1/s", xlabel="displacement [mm]")
    axes[0].set_ylabel("velocity [mm/s]")
    growth = rig.modes("belt").sliding.growth
    damped = rig.modes("belt_c_damped").sliding.growth
    yield Comparison("A: growth rate", "1/s", growth, 3.6553, "reference", absolute=6e-5)
    theory = (-law_of(load("belt")).slope(0.06) * 20.0 - 2.0) / (2.0 * 5.0)
    yield Comparison("A: (dmu F_N - d) / 2 m", "1/s", growth, theory, "theory", relative=1e-9)
    yield Comparison("C with d = 2: -d / 2 m", "1/s", damped, -2.0 / (2.0 * 5.0), "theory", relative=1e-9)


def energy(figure: Figure) -> Compared:
    """A falling law, B: time histories over a period, and energy over the amplitude, T dmu F0 v^2 / 2 if small."""
    scene = load("belt_b")
    law = law_of(scene)
    speed = 0.06
    force = 20.0
    slope = value(scene, "friction.slope")
    period = 2.0 * math.pi * math.sqrt(5.0 / 2500.0)
    phase = np.linspace(0.0, 2.0 * math.pi, 4001)[:-1]
    amplitudes = np.linspace(1e-3, 0.15, 300)

    def put_in(amplitude: float) -> float:
        v = amplitude * np.sin(phase)
        w = speed - v
        mu = np.array([law.mu(abs(slip)) for slip in w]) * np.sign(w)
        return float(np.mean(force * mu * v) * period)

    panels = figure.subplot_mosaic([["a", "energy"], ["b", "energy"], ["c", "energy"], ["d", "energy"]])
    swing = 0.04 * np.sin(phase)
    friction = force * np.array([law.mu(w) for w in speed - swing])
    _period([panels[name] for name in "abcd"], phase / (2.0 * math.pi), swing, speed - swing, friction)
    axis = panels["energy"]
    from_friction = np.array([put_in(amplitude) for amplitude in amplitudes])
    to_damper = 0.5 * 2.0 * amplitudes**2 * period
    small = 0.5 * slope * force * amplitudes**2 * period
    axis.plot(1e3 * amplitudes, 1e3 * from_friction, "-", color=BLUE, label="from friction")
    axis.plot(1e3 * amplitudes, 1e3 * to_damper, "-", color=VERMILION, label="to the damper")
    axis.plot(1e3 * amplitudes, 1e3 * small, "--", color=GREY, label="small amplitudes")
    axis.set(xlabel="amplitude of velocity [mm/s]", ylabel="energy in a period [mJ]", ylim=(-2.0, 12.0))
    axis.legend(loc="upper left")
    power = friction * swing
    what = "40 mm/s: largest power over the largest that is returned"
    yield Comparison(what, "", power.max() / -power.min(), 1.0, "paper", floor=True)
    theory = period * slope * force * 0.01**2 / 2.0
    yield Comparison("E at 10 mm/s: T dmu F0 v^2 / 2", "J", put_in(0.01), theory, "theory", relative=1e-9)


def _period(axes: list[Axes], time: Reals, velocity: Reals, slip: Reals, friction: Reals) -> None:
    """Draw velocity, slip speed and friction force, and the power of friction, over periods."""
    curves = (1e3 * velocity, 1e3 * slip, friction, friction * velocity)
    labels = (
        "(a) velocity\n[mm/s]",
        "(b) slip speed\n[mm/s]",
        "(c) friction\nforce [N]",
        "(d) power of\nfriction [W]",
    )
    for axis, shown, label in zip(axes, curves, labels):
        axis.plot(time, shown, color=BLUE)
        axis.axhline(float(np.mean(shown)), color=GREY, lw=0.7, ls="--")
        axis.set_ylabel(label)
        axis.label_outer()
    axes[3].fill_between(time, 0.0, friction * velocity, color=BLUE, alpha=0.2, lw=0)
    axes[3].set_xlabel("time over the period [1]; dashed: means")


def fluctuating(figure: Figure) -> Compared:
    """A fluctuating load, constant friction: E = mu Fh vh T cos(phase) / 2, until the damper dissipates as much."""
    scene = load("belt_fluctuating_load")
    ran = rig.simulate(scene)
    period = 1.0 / value(scene, "dither.frequency")
    mu = value(scene, "friction.mu")
    swing = value(scene, "dither.amplitude")
    last = ran.time > ran.time[-1] - period
    panels = figure.subplot_mosaic([["a", "grows"], ["b", "grows"], ["c", "phase"], ["d", "phase"]])
    t = ran.time[last]
    v = ran.signals["velocity"][last]
    w = ran.signals["slip_speed"][last]
    T = ran.signals["friction_force"][last]
    _period([panels[name] for name in "abcd"], (t - t[0]) / period, v, w, T)
    panels["grows"].plot(ran.time, 1e3 * ran.signals["velocity"], color=BLUE, lw=0.6)
    panels["grows"].set(xlabel="time [s]", ylabel="velocity [mm/s]")
    top = float(v.max())
    phases = np.linspace(-math.pi, math.pi, 73)
    turn = np.linspace(0.0, 2.0 * math.pi, 721)[:-1]

    def put_in(phase: float) -> float:
        normal = value(scene, "load.force") + swing * np.sin(turn - phase)
        return float(np.mean(mu * normal * top * np.sin(turn)) * period)

    panels["phase"].plot(np.degrees(phases), [1e3 * put_in(angle) for angle in phases], color=BLUE)
    panels["phase"].axhline(0.0, color=GREY, lw=0.7)
    panels["phase"].set(xlabel="phase of the load behind the velocity [degrees]", ylabel="energy in a period [mJ]")
    theory = mu * swing / value(scene, "body.damping")
    yield Comparison("amplitude: mu Fh / d", "m/s", top, theory, "theory", relative=0.03)
    simulated = float(np.mean(T * v)) * period
    theory = mu * swing * top * period / 2.0
    yield Comparison("energy in a period, simulated: mu Fh vh T / 2", "J", simulated, theory, "theory", relative=0.02)
    for phase, expected in ((0.0, 1.0), (0.5 * math.pi, 0.0), (math.pi, -1.0)):
        share = put_in(phase) / put_in(0.0)
        what = f"phase {math.degrees(phase):g} degrees: energy over that in phase"
        yield Comparison(what, "", share, expected, "theory", absolute=1e-9)


def pin(figure: Figure) -> Compared:
    """Eigenvalues of the tilted pin over the friction coefficient."""
    swept = rig.sweep("pin", "friction.mu", np.linspace(0.3, 0.95, 200))
    growth, frequency = figure.subplots(1, 2)
    growth.plot(swept.axis.values, swept.growth, color=BLUE)
    growth.axhline(0.0, color=GREY, lw=0.7)
    frequency.plot(swept.axis.values, swept.frequency, color=BLUE)
    growth.set(xlabel="friction coefficient", ylabel="growth [1/s]")
    frequency.set(xlabel="friction coefficient", ylabel="frequency [Hz]")
    limit = swept.critical[0].value
    growth.axvline(limit, color=VERMILION, ls="--", lw=1.0)
    yield Comparison("mu at the damping limit", "", limit, 0.727389, "reference", absolute=6e-7)
    gamma = math.radians(25.0)
    theory = math.tan(gamma) + 2.0 * 2.0 / (20.0 * math.sin(2.0 * gamma))
    critical = rig.sweep("pin", "friction.mu", np.linspace(0.6, 0.9, 13)).critical[0].value
    yield Comparison("tan g + 2 d2 / (d1 sin 2 g)", "", critical, theory, "theory", relative=1e-9)


def north(figure: Figure) -> Compared:
    """North's model: flutter limit of one body, divergence limit of another."""
    cases = (("north", 0.0, 0.6, 0.252695), ("north_divergence", 0.6, 1.4, 1.086806))
    for axis, (name, low, high, expected) in zip(figure.subplots(1, 2), cases):
        swept = rig.sweep(name, "friction.mu", np.linspace(low, high, 61))
        axis.plot(swept.axis.values, swept.growth, ".", markersize=2.5, color=BLUE)
        axis.axhline(0.0, color=GREY, lw=0.7)
        first = swept.critical[0]
        axis.axvline(first.value, color=VERMILION, ls="--", lw=1.0)
        title = f"{name}: {first.kind} at {first.value:.6f}"
        axis.set(title=title, xlabel="friction coefficient", ylabel="growth [1/s]")
        yield Comparison(f"{name}: {first.kind}", "", first.value, expected, "reference", absolute=6e-7)
    s = 0.012
    h = 0.012
    c2 = 8e7
    c1 = 2e7
    c_phi = 200.0
    theory = s / h + c_phi / (h * s * c2) + c_phi / (h * s * c1)
    yield Comparison("equation 2.5", "", swept.critical[0].value, theory, "theory", relative=1e-9)


def seal(figure: Figure) -> Compared:
    """Friction force of the seal over speed."""
    scene = load("seal_p")
    law = law_of(scene)
    force_per_mu = value(scene, "friction.load")

    def force_at(speed: float) -> float:
        return force_per_mu * law.mu(speed)

    speeds = np.linspace(0.0, 0.04, 400)
    force = np.array([force_at(v) for v in speeds])
    axis = figure.subplots()
    axis.plot(1e3 * speeds, force, color=BLUE, label="scene seal_p")
    axis.set(xlabel="speed [mm/s]", ylabel="friction force [N]", ylim=(0.0, 12.0))
    printed = {0: 9.820, 1: 6.912, 2: 5.743, 5: 4.842, 7: 4.821, 10: 5.009, 20: 6.015, 40: 7.925}
    axis.plot(list(printed), list(printed.values()), "o", color=VERMILION, markersize=4, label="equation 3.1")
    axis.legend()
    rows = ((f"force at {v} mm/s", force_at(v * 1e-3), expected) for v, expected in printed.items())
    yield from compared(rows, "N", "theory", absolute=6e-4)
    close = {"xatol": 1e-9}
    lowest = minimize_scalar(lambda v: force_at(v * 1e-3), bounds=(3.0, 10.0), method="bounded", options=close)
    yield Comparison("speed of the minimum", "mm/s", float(lowest.x), 6.139, "theory", absolute=6e-4)


def seal_limits(figure: Figure) -> Compared:
    """Stability of the seal over speed and damping, with the axes of the paper."""
    axis = figure.subplots()
    limits = []
    for damping in _LIMITS:
        swept = rig.sweep(load("seal_p", body__damping=damping), "drive.speed", np.linspace(5e-4, 0.012, 40))
        limits += [1e3 * crossing.value for crossing in swept.critical]
    for (damping, expected), limit in zip(_LIMITS.items(), limits, strict=True):
        what = f"d = {damping / 1e3:g} N s/mm"
        yield Comparison(what, "mm/s", float(limit), expected, "reference", absolute=6e-4)
    what = "highest critical speed of equation 3.1, without damping"
    yield Comparison(what, "mm/s", max(limits), 7.0, "paper", relative=0.05, missed=True)
    law = law_of(load("seal_p"))
    force_per_mu = value(load("seal_p"), "friction.load")
    speeds = np.linspace(1.6e-3, 6.139e-3, 200)
    balanced = [-1e-3 * force_per_mu * law.slope(v) for v in speeds]  # damping balances the falling friction
    axis.fill_betweenx(balanced, 0.0, 1e3 * speeds, color=VERMILION, alpha=0.15, lw=0)
    axis.plot(1e3 * speeds, balanced, color=GREY, lw=0.9, label="damping = fall of the friction force")
    axis.plot(limits, [damping / 1e3 for damping in _LIMITS], "o", color=BLUE, label="eigenvalues")
    axis.text(1.0, 0.15, "unstable")
    axis.text(12.0, 0.5, "stable")
    axis.axvline(7.0, color=GREY, ls="--", lw=0.8, label="the paper's critical speed, 7 mm/s")
    axis.legend(loc="upper right")
    axis.set(xlabel="speed [mm/s]", ylabel="coefficient of damping [N s/mm]", ylim=(0.0, 1.05), xlim=(0.0, 25.0))


def edge(figure: Figure) -> Compared:
    """Draw the rounded edge: flutter, stick, lift-off."""
    cycle = _panels(figure, "tread", 0.3)
    x, v, N = (cycle.extremes[name] for name in ("displacement", "velocity", "normal_force"))
    opening = next(t for t, what in cycle.events if what == "load opens")
    closing = next(t for t, what in cycle.events if what == "load closes")
    bound: dict[str, Any] = {"source": "reference", "relative": 1e-6}
    yield Comparison("period", "ms", 1e3 * cycle.period, 3.862965856, **bound)
    for what, unit, ours, expected in (
        ("highest displacement", "m", x[1], 1.5715499e-4),
        ("lowest velocity", "m/s", v[0], -0.32798549),
        ("highest velocity", "m/s", v[1], 0.10521328),
        ("highest normal force", "N", N[1], 58.8837256),
        ("share of time off the plate", "", (closing - opening) % cycle.period / cycle.period, 0.27741896),
    ):
        yield Comparison(what, unit, float(ours), expected, **bound)
    for what, unit, ours, printed, missed in (
        ("range of the displacement", "mm", 1e3 * (x[1] - x[0]), 0.15, False),
        ("lowest velocity", "m/s", v[0], -0.5, True),
        ("highest velocity", "m/s", v[1], 0.1, False),
        ("highest normal force", "N", N[1], 80.0, True),
    ):
        yield Comparison(f"{what} (label of the axis)", unit, ours, printed, "paper", relative=0.15, missed=missed)
    scene = load("tread")
    c_x = value(scene, "tip.tangential_stiffness")
    c_z = value(scene, "tip.normal_stiffness")
    coupling = value(scene, "tip.coupling")
    weakest = float(np.linalg.eigvalsh([[c_x, -coupling], [-coupling, c_z]])[0])
    what = "smallest stiffness of the block without the plate: passive"
    yield Comparison(what, "N/m", weakest, 0.0, "theory", floor=True)
    [flutter, _] = rig.modes(scene).sliding.modes
    yield Comparison("growth of the flutter", "1/s", flutter.growth, 42.68696938, **bound)
    yield Comparison("its frequency", "Hz", flutter.frequency, 294.0978372, **bound)


def rough(figure: Figure) -> Compared:
    """Draw the rough surface: constant normal force, stick-slip by falling friction."""
    cycle = _panels(figure, "tread_rough", 0.12)
    x, v, N = (cycle.extremes[name] for name in ("displacement", "velocity", "normal_force"))
    scene = load("tread_rough")
    yield Comparison("period", "ms", 1e3 * cycle.period, 0.391612, "reference", relative=0.02)
    for what, unit, ours, expected, span in (
        ("lowest displacement", "m", x[0], 8.21242e-6, x[1] - x[0]),
        ("highest displacement", "m", x[1], 2.20078e-5, x[1] - x[0]),
        ("lowest velocity", "m/s", v[0], -0.216754, v[1] - v[0]),
        ("highest velocity", "m/s", v[1], 0.0497355, v[1] - v[0]),
    ):
        yield Comparison(what, unit, ours, expected, "reference", absolute=0.02 * span)
    load_force = value(scene, "load.force")
    for which, ours in zip(("lowest", "highest"), N):
        yield Comparison(f"{which} normal force: the load", "N", ours, load_force, "theory", relative=1e-9)
    highest = law_of(scene).static * load_force
    largest = cycle.extremes["friction_force"][1]
    yield Comparison("highest friction force: mu_s P", "N", largest, highest, "theory", relative=1e-9)


def _panels(figure: Figure, name: str, seconds: float) -> Cycle:
    """Displacement, velocity, limit cycle and forces as in the paper: the last two cycles of a run of `seconds`."""
    cycle = rig.limit_cycle(load(name))
    ran = rig.simulate(quiet(load(name, clock__frame=FINE)), seconds)
    last = ran.time >= ran.time[-1] - 2.0 * cycle.period
    t = 1e3 * (ran.time[last] - ran.time[last][0])
    x = ran.signals["displacement"][last]
    v = ran.signals["velocity"][last]
    T = ran.signals["friction_force"][last]
    N = ran.signals["normal_force"][last]
    (place, speed), (phase, force) = figure.subplots(2, 2)
    place.plot(t, 1e6 * x, color=BLUE)
    place.set(title="(a) displacement", xlabel="time [ms]", ylabel="displacement [um]")
    speed.plot(t, v, color=BLUE)
    speed.set(title="(b) velocity", xlabel="time [ms]", ylabel="velocity [m/s]")
    phase.plot(1e6 * x, v, color=BLUE)
    phase.set(title="(c) limit cycle", xlabel="displacement [um]", ylabel="velocity [m/s]")
    force.plot(t, N, color=AMBER, label="normal force")
    force.plot(t, T, "--", color=VERMILION, label="friction force")
    top = 1.35 * max(N.max(), T.max())
    force.set(title="(d) forces", xlabel="time [ms]", ylabel="force [N]", ylim=(None, top))
    force.legend(ncols=2, loc="upper right")
    return cycle


ENTRIES = (
    Entry(
        "kroeger-3",
        "kroeger",
        "Figure 3",
        "friction characteristics and their limit cycles",
        ("belt", "belt_b", "belt_c", "belt_c_damped"),
        cycles,
    ),
    Entry(
        "kroeger-4",
        "kroeger",
        "Figure 4",
        "unstable sliding, and stick-slip that needs a start outside",
        ("belt", "belt_b", "belt_c_damped"),
        onset,
        "Dark: start 0.2 mm from the equilibrium; pale: start 4 mm from it.",
    ),
    Entry(
        "kroeger-5",
        "kroeger",
        "Figure 5",
        "energy input by a falling friction characteristic",
        ("belt_b",),
        energy,
        size=(9.6, 6.6),
    ),
    Entry(
        "kroeger-fluctuating",
        "kroeger",
        "Equation 2.2",
        "energy input by a fluctuating normal force",
        ("belt_fluctuating_load",),
        fluctuating,
        "The paper has no figure of it; the panels are those of its figure 5. The mass oscillates in the frequency "
        "of the load.",
        (9.6, 6.6),
    ),
    Entry("kroeger-6", "kroeger", "Figure 6", "tilted pin: growth over the friction coefficient", ("pin",), pin),
    Entry(
        "kroeger-7",
        "kroeger",
        "Figure 7",
        "non-conservative restoring forces: flutter and divergence",
        ("north", "north_divergence"),
        north,
        "Equation 2.5 is the divergence limit (the determinant of the stiffness vanishes). If flutter occurs, it "
        "occurs at a lower friction coefficient.",
    ),
    Entry("kroeger-9", "kroeger", "Figure 9", "friction force of an axial seal", ("seal_p",), seal),
    Entry("kroeger-10", "kroeger", "Figure 10", "stable sliding of the seal over damping", ("seal_p",), seal_limits),
    Entry(
        "kroeger-13",
        "kroeger",
        "Figure 13",
        "tread block with a rounded edge on glass",
        ("tread",),
        edge,
        "The paper gives no parameters: the block is calibrated to the labels of the axes. It is passive, and "
        "friction is constant, so that only the coupling of the motions makes it vibrate. With the range of the "
        "displacement of the paper its speed and normal force are lower; the page on plants says what cannot be had "
        "together. The reference is an integration by scipy with events.",
        (9.6, 6.6),
    ),
    Entry(
        "kroeger-14",
        "kroeger",
        "Figure 14",
        "tread block with a rough surface on glass",
        ("tread_rough",),
        rough,
        "The reference smooths friction over 0.2 mm/s; its numbers are valid to 2 %. The paper gives no parameters.",
        (9.6, 6.6),
    ),
)
