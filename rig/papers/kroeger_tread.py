"""Kroeger, Neubauer, Popp (2008), section 3b: a tread block on glass, with a rounded edge and with a rough surface."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

import rig
from rig.analysis.cycle_report import Cycle
from rig.papers.entry import Compared, Comparison, Entry, law_of, load, quiet, value
from rig.view.palette import AMBER, BLUE, VERMILION

FINE = "5 us"


def edge(figure: Figure) -> Compared:
    """Draw the rounded edge: flutter, stick, lift-off."""
    cycle = _panels(figure, "tread", 0.3)
    x, v, N = (cycle.extremes[name] for name in ("displacement", "velocity", "normal_force"))
    opening, closing = (next(t for t, what in cycle.events if what == f"load {word}") for word in ("opens", "closes"))
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
    c_x, c_z, coupling = (value(scene, f"tip.{key}") for key in
                          ("tangential_stiffness", "normal_stiffness", "coupling"))  # fmt: skip
    weakest = float(np.linalg.eigvalsh([[c_x, -coupling], [-coupling, c_z]])[0])
    yield Comparison("smallest stiffness of the block without the plate: passive", "N/m", weakest, 0.0, "theory",
                     floor=True)  # fmt: skip
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
    x, v, T, N = (ran.signals[key][last] for key in ("displacement", "velocity", "friction_force", "normal_force"))
    (place, speed), (phase, force) = figure.subplots(2, 2)
    place.plot(t, 1e6 * x, color=BLUE)
    place.set(title="(a) displacement", xlabel="time [ms]", ylabel="displacement [um]")
    speed.plot(t, v, color=BLUE)
    speed.set(title="(b) velocity", xlabel="time [ms]", ylabel="velocity [m/s]")
    phase.plot(1e6 * x, v, color=BLUE)
    phase.set(title="(c) limit cycle", xlabel="displacement [um]", ylabel="velocity [m/s]")
    force.plot(t, N, color=AMBER, label="normal force")
    force.plot(t, T, "--", color=VERMILION, label="friction force")
    force.set(title="(d) forces", xlabel="time [ms]", ylabel="force [N]", ylim=(None, 1.35 * max(N.max(), T.max())))
    force.legend(ncols=2, loc="upper right")
    return cycle


ENTRIES = (
    Entry("kroeger-13", "kroeger", "Figure 13", "tread block with a rounded edge on glass", ("tread",), edge,
          "The paper gives no parameters: the block is calibrated to the labels of the axes. It is passive, and "
          "friction is constant, so that only the coupling of the motions makes it vibrate. With the range of the "
          "displacement of the paper its speed and normal force are lower; the page on plants says what cannot be had "
          "together. The reference is an integration by scipy with events.", (9.6, 6.6)),
    Entry("kroeger-14", "kroeger", "Figure 14", "tread block with a rough surface on glass", ("tread_rough",), rough,
          "The reference smooths friction over 0.2 mm/s; its numbers are valid to 2 %. The paper gives no parameters.",
          (9.6, 6.6)),
)  # fmt: skip
