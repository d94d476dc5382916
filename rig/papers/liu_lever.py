"""Liu and Ouyang, Mech. Syst. Signal Process. (2022): the slider on a rotating disc with an L-shaped lever.

The parameter values of its figures are not available; the values of the scenes reproduce its regions. "reference" is an
independent computation with these.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

import rig
from rig.analysis.cycles.cycle_report import Cycle
from rig.analysis.identification.features import stages
from rig.analysis.identification.lever import read
from rig.analysis.recorded.amplitude import index
from rig.papers.entry import Compared, Comparison, Entry, compared, load, quiet, table, thresholds, value
from rig.record.run import Run
from rig.scenes.scene import Scene
from rig.view.palette import AMBER, BLUE, GREEN, GREY, VERMILION

RPM = math.pi / 30.0
PIN = 0.8  # disc radius over the pin's: angular velocity of the cylinder that sticks, over the disc's
COULOMB: dict[str, Any] = {"friction__law": "coulomb", "friction__mu_static": 0.42, "friction__mu_kinetic": 0.3}


def at(N0: float, rpm: float, scene: str = "lever", **changes: Any) -> Scene:
    """Return the rig at a preload [N] and a speed, stuck to the disc and unloaded, without protocol."""
    speed = rpm * RPM
    usual = {"load__force": N0, "drive__speed": speed, "start__angular_velocity": PIN * speed, "clock__frame": "5 ms"}
    return quiet(load(scene, **(usual | changes)))


def half(cycle: Cycle, output: str) -> float:
    """Return half of peak to peak."""
    low, high = cycle.extremes[output]
    return 0.5 * (high - low)


def kinetic(figure: Figure) -> Compared:
    """The kinetic coefficient over speed, as the experiment finds it from noisy instruments."""
    scene = load("lever_kinetic_friction")
    run = rig.simulate(scene)
    identified = read(run)
    axis = figure.subplots()
    means = {}
    for name, section in scene.sensors.items():
        t_ns, v = run.measurements[name]
        seconds = np.asarray(t_ns * 1e-9)
        quantity = np.asarray(v / section.sensitivity)
        means[section.reads] = stages(seconds, quantity, scene.protocol, "mean")[0]
    lever = value(scene, "cylinder.arm") / value(scene, "cylinder.pin")
    slip = value(scene, "disc.radius") * means["disc_speed"]
    mu = lever * means["cell_force"] / means["normal_force"]
    axis.plot(1e3 * slip, mu, "o", color=VERMILION, markersize=4, label="measured, three repeats")
    speeds = np.linspace(0.0, 0.05, 400)
    values = {parameter.key.rsplit(".", 1)[-1]: parameter for parameter in identified.parameters}

    def law(kinetic: float, static: float, decay: float) -> np.ndarray:
        return kinetic + (static - kinetic) * np.exp(-decay * speeds)

    stated = []
    fitted = []
    for name in ("mu_kinetic", "mu_static", "decay"):
        if name in values:
            stated.append(values[name].stated)
            fitted.append(values[name].value)
        else:
            of_scene = value(scene, f"friction.{name}")
            stated.append(of_scene)
            fitted.append(of_scene)
    axis.plot(1e3 * speeds, law(*stated), color=GREY, label="the scene's law")
    axis.plot(1e3 * speeds, law(*fitted), "--", color=BLUE, label="fitted to the measurement")
    axis.set(xlabel="slip speed [mm/s]", ylabel="kinetic friction coefficient")
    axis.legend()
    for p in identified.parameters:
        yield Comparison(f"identified: {p.key}", p.unit, p.value, p.stated, "theory", relative=0.01)


def response(figure: Figure, coulomb: bool = False) -> Compared:
    """Both angles over time, phase portraits, spectra at 20 N and 1 rpm; measured and computed."""
    scene = load("lever", **(COULOMB if coulomb else {}))
    ran = rig.simulate(scene)
    last = ran.time > ran.time[-1] - 1.5
    begin = ran.time[last][0]
    t = ran.time[last] - begin
    axes = figure.subplots(2, 3)
    parts = (
        ("arm_laser", "cylinder.arm", "angle", "angular_velocity", "cylinder angle"),
        ("lever_laser", "lever.leg", "lever_angle", "lever_velocity", "lever angle"),
    )
    for (over, phase, spectrum), (sensor, arm, output, rate, name) in zip(axes, parts):
        milliradians = 1e3 * ran.signals[output][last]
        over.plot(t, milliradians, color=BLUE, lw=1.0, label="computed")
        phase.plot(milliradians, ran.signals[rate][last], color=BLUE, lw=0.8)
        if not coulomb:
            taken = ran.measurements[sensor]
            seconds = taken.t_ns * 1e-9
            angle = taken.v / value(scene, arm)
            seen = seconds > ran.time[-1] - 1.5
            dots: dict[str, Any] = {"color": VERMILION, "markersize": 3, "label": "measured at 100 Hz"}
            over.plot(seconds[seen] - begin, 1e3 * angle[seen], ".", **dots)
        settled = ran.signals[output][ran.time > 5.0]
        windowed = (settled - settled.mean()) * np.hanning(len(settled))
        amplitude = 2.0 * np.abs(np.fft.rfft(windowed)) / len(settled) * 2.0
        frequency = np.fft.rfftfreq(len(settled), ran.time[1] - ran.time[0])
        shown = frequency < 20.0
        spectrum.semilogy(frequency[shown], 1e3 * amplitude[shown], color=BLUE, lw=0.8)
        over.set(xlabel="time [s]", ylabel=f"{name} [mrad]", title=name)
        phase.set(xlabel=f"{name} [mrad]", ylabel="angular speed [rad/s]")
        spectrum.set(xlabel="frequency [Hz]", ylabel="amplitude [mrad]", ylim=(1e-4, None))
        top = 1e3 * np.ptp(settled)
        over.set_ylim(1e3 * settled.min() - 0.08 * top, 1e3 * settled.max() + 0.4 * top)
    if not coulomb:
        axes[0, 0].legend(loc="upper left", fontsize=8)
    cycle = rig.limit_cycle(scene)
    expected = (3.0724522649734, 0.00825004, 0.00799662) if coulomb else (2.8704654619, 0.009245855, 0.008817508)
    quantities = cycle.frequency, half(cycle, "angle"), half(cycle, "lever_angle")
    for what, unit, ours, number in zip(("frequency", "A_phi", "A_theta"), ("Hz", "rad", "rad"), quantities, expected):
        yield Comparison(what, unit, ours, number, "reference", relative=1e-5)
    extremes = (0.012896526, 0.029396652) if coulomb else (0.012046457, 0.030538174)
    rows = zip(("lowest phi", "highest phi"), cycle.extremes["angle"], extremes)
    yield from compared(rows, "rad", "reference", relative=1e-5)


def amplitudes(figure: Figure) -> Compared:
    """Draw amplitude indices and frequency: a rig of exact geometry measured with noise, and both laws computed."""
    bench = load("lever", springs__order=5)
    ran = rig.simulate(bench)
    measured = []
    for sensor, arm in (("arm_laser", "cylinder.arm"), ("lever_laser", "lever.leg")):
        taken = ran.measurements[sensor]
        seconds = taken.t_ns * 1e-9
        settled = seconds > 5.0
        angle = np.asarray(taken.v[settled] / value(bench, arm), dtype=np.float64)
        oscillation = index(np.asarray(seconds[settled], dtype=np.float64), angle)
        measured.append(oscillation.half)
    measured.append(oscillation.frequency)
    phi, theta, frequency = measured
    rows = [("exact geometry, measured", f"{1e3 * phi:.3f}", f"{1e3 * theta:.3f}", f"{frequency:.3f}", "", "")]
    reference: tuple[tuple[str, dict[str, Any], int, tuple[float, ...]], ...] = (
        ("Stribeck", {}, 2, (0.00924585650, 0.00881750876, 0.34837529417)),
        ("Coulomb", COULOMB, 2, (0.00825006102, 0.00799662285, 0.32547258037)),
        ("Stribeck, exact geometry", {}, 5, (0.009364851090, 0.009041176398, 0.351863344938)),
        ("Coulomb, exact geometry", COULOMB, 5, (0.008374996341, 0.008200736086, 0.329006557488)),
    )
    for name, law, order, expected in reference:
        cycle = rig.limit_cycle(load("lever", springs__order=order, **law))
        ours = half(cycle, "angle"), half(cycle, "lever_angle"), cycle.period
        bound = 1e-6 if order == 2 else 2e-5
        for what, unit, computed, number in zip(("A_phi", "A_theta", "period"), ("rad", "rad", "s"), ours, expected):
            yield Comparison(f"{name}: {what}", unit, computed, number, "reference", relative=bound)
        angle_off = 100.0 * (ours[0] / phi - 1.0)
        frequency_off = 100.0 * (cycle.frequency / frequency - 1.0)
        numbers = (f"{1e3 * ours[0]:.3f}", f"{1e3 * ours[1]:.3f}", f"{cycle.frequency:.3f}")
        rows.append((name, *numbers, f"{angle_off:+.1f} %", f"{frequency_off:+.1f} %"))
    stribeck = rig.limit_cycle(load("lever"))
    coulomb = rig.limit_cycle(load("lever", **COULOMB))
    shares = (
        ("A_phi", half(coulomb, "angle") / half(stribeck, "angle")),
        ("A_theta", half(coulomb, "lever_angle") / half(stribeck, "lever_angle")),
        ("frequency", coulomb.frequency / stribeck.frequency),
    )
    for what, share in shares:
        yield Comparison(f"Coulomb over Stribeck: {what}", "", float(share), math.nan, "paper")
    heads = ("20 N, 1 rpm", "A_phi [mrad]", "A_theta [mrad]", "f [Hz]", "A_phi off by", "f off by")
    table(figure.subplots(), rows, heads, 9.5, 1.7, colWidths=[0.3, 0.14, 0.14, 0.12, 0.14, 0.14])


def two_starts(figure: Figure) -> Compared:
    """Draw two starts at one point: from the standing rig, and from near sliding."""
    axes = figure.subplots(2, 2, sharex=True, sharey=True)
    laws: tuple[tuple[str, dict[str, Any]], ...] = (("Stribeck", {}), ("Coulomb", COULOMB))
    for row, (name, law) in zip(axes, laws):
        yield from both_starts(row, name, name, (1.0, 0.0), 20.0, 20.0, 2.5, **law)
    name_axes(axes)


def both_starts(
    row: Iterable[Axes],
    title: str,
    what: str,
    outcomes: tuple[float, float],
    seconds: float,
    N0: float,
    rpm: float,
    scene: str = "lever",
    lw: float = 0.6,
    **changes: Any,
) -> Compared:
    """Draw runs from a standing start and from near sliding; `outcomes`: whether they stick in the end."""
    for axis, near, outcome in zip(row, (False, True), outcomes):
        begin = start_near if near else at
        ran = rig.simulate(begin(N0, rpm, scene, **changes), seconds)
        axis.plot(ran.time, 1e3 * ran.signals["angle"], color=GREEN if near else BLUE, lw=lw)
        start = "near sliding" if near else "standing start"
        axis.set_title(f"{title}, {start}")
        yield Comparison(f"{what}, {start}: sticks (1) or slides (0)", "", sticks(ran, 2.0), outcome, "reference")


def name_axes(axes: NDArray[np.object_]) -> None:
    """Label a grid of plots of the cylinder's angle over time."""
    for axis in axes[:, 0]:
        axis.set_ylabel("cylinder\nangle [mrad]")
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")


def start_near(N0: float, rpm: float, scene: str = "lever", **changes: Any) -> Scene:
    """Return the rig displaced slightly from steady sliding."""
    still = rig.modes(at(N0, rpm, scene, **changes)).sliding.equilibrium
    start = {
        "start__angle": still["angle"],
        "start__lever_angle": still["lever_angle"],
        "start__angular_velocity": 0.02 * PIN * rpm * RPM,
    }
    return at(N0, rpm, scene, **(changes | start))


def sticks(ran: Run, last: float) -> float:
    """Return 1.0 if the contact sticks in the last seconds, else 0.0."""
    ends = [event["t_ns"] * 1e-9 for event in ran.events if event["text"] == "contact slip ends"]
    return float(bool(ends) and ends[-1] > ran.time[-1] - last)


def three_stages(figure: Figure, sector: bool = False) -> Compared:
    """Draw accelerate, hold, decelerate: stick-slip ends at a higher speed than it begins again."""
    ran = rig.simulate(load("lever_sector_three_stage" if sector else "lever_three_stage"))
    speeds = thresholds(ran)
    up = speeds.up / RPM
    down = speeds.down / RPM
    angle, speed = figure.subplots(2, 1, sharex=True)
    angle.plot(ran.time, 1e3 * ran.signals["angle"], color=BLUE, lw=0.3)
    angle.set_ylabel("cylinder\nangle [mrad]")
    speed.plot(ran.time, ran.signals["disc_speed"] / RPM, color=AMBER)
    for threshold, name, place in ((up, "last stick", 0.02), (down, "first stick", 0.7)):
        speed.axhline(threshold, color=GREY, ls="--", lw=0.8)
        speed.text(place, threshold + 0.15, f"{name}: {threshold:.2f} rpm", transform=speed.get_yaxis_transform())
    speed.set(xlabel="time [s]", ylabel="disc speed [rpm]")
    swept = rig.sweep("lever", "drive.speed", np.linspace(1.5 * RPM, 3.0 * RPM, 7))
    hopf = swept.critical[0].value / RPM
    beyond = "up beyond the speed at which sliding loses its stability (1: yes)"
    yield Comparison(beyond, "", float(up > hopf), 1.0, "reference")
    yield Comparison("down to below that speed, without noise (1: yes)", "", float(down < hopf), 1.0, "reference")
    if sector:
        yield Comparison("last stick at rising speed", "rpm", up, math.nan, "paper")
        yield Comparison("first stick at falling speed", "rpm", down, math.nan, "paper")
        uniform = thresholds(rig.simulate(load("lever_three_stage"))).up / RPM
        yield Comparison("up not as far as on the uniform disc (1: yes)", "", float(up < uniform), 1.0, "reference")
    else:
        yield Comparison("speed at which sliding loses its stability", "rpm", hopf, 2.03444, "reference", absolute=1e-4)


ENTRIES = (
    Entry(
        "liu003-4",
        "liu003",
        "Figure 4",
        "kinetic friction over speed, measured and fitted",
        ("lever_kinetic_friction",),
        kinetic,
        "The identified values beside the values that the scene states.",
    ),
    Entry(
        "liu003-5",
        "liu003",
        "Figure 5",
        "stick-slip at 20 N and 1 rpm, exponential law",
        ("lever",),
        response,
        size=(9.6, 5.8),
    ),
    Entry(
        "liu003-6",
        "liu003",
        "Figure 6",
        "the same with Coulomb's law",
        ("lever",),
        partial(response, coulomb=True),
        size=(9.6, 5.8),
    ),
    Entry(
        "liu003-table-1",
        "liu003",
        "Table 1",
        "amplitudes and frequency, measured and computed",
        ("lever",),
        amplitudes,
        "The measured virtual rig has the exact geometry of its springs (to order 5). The text of the "
        "paper lost all its numbers: it says that both laws agree well with the measurement, and nothing can be "
        "compared in value.",
        (9.6, 2.9),
    ),
    Entry("liu003-8", "liu003", "Figure 8", "two starts at 20 N and 2.5 rpm", ("lever",), two_starts),
    Entry(
        "liu003-9",
        "liu003",
        "Figure 9",
        "accelerate, hold, decelerate",
        ("lever_three_stage",),
        three_stages,
        "Without noise steady sliding ends late as the speed falls; only the order of the thresholds is compared.",
    ),
)
