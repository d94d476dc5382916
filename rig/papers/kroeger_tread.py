"""Kroeger, Neubauer, Popp (2008), section 3b: a tread block on glass, with a rounded edge and with a rough surface."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from rig.papers.common import law_of, load, quiet, run, value
from rig.papers.entry import Comparison, Entry
from rig.view.palette import AMBER, BLUE, VERMILION

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rig.analysis.cycle_report import Cycle

FINE = "5 us"


def edge(figure: Figure) -> Iterator[Comparison]:
    """Draw the rounded edge: flutter, stick, lift-off."""
    import rig

    cycle = _panels(figure, "tread", rounds=2)
    pressed = -34.0 / (300e3 + 80e3)  # the start of the reference, which evaluates 60 to 120 ms
    ran = run(quiet(load("tread", start__height=pressed, clock__frame=FINE)), 0.12)
    late = ran.time > 0.06
    x, v, N = (ran.signals[name][late] for name in ("displacement", "velocity", "normal_force"))
    bound: dict[str, Any] = {"source": "reference", "relative": 0.02}
    yield Comparison("period of a round", "ms", 500.0 * cycle.period, 0.770701, **bound)
    for what, unit, ours, expected, span in (
        ("lowest displacement", "m", x.min(), 9.69489e-7, np.ptp(x)),
        ("highest displacement", "m", x.max(), 3.95268e-5, np.ptp(x)),
        ("lowest velocity", "m/s", v.min(), -0.141399, np.ptp(v)),
        ("highest velocity", "m/s", v.max(), 0.0498907, np.ptp(v)),
    ):
        yield Comparison(what, unit, float(ours), expected, "reference", absolute=0.02 * float(span))
    yield Comparison("highest normal force", "N", float(N.max()), 64.1489, **bound)
    yield Comparison("mean normal force", "N", float(N.mean()), 25.2072, **bound)
    yield Comparison("share of time off the plate", "", float(np.mean(N == 0.0)), 0.318333, **bound)
    for what, unit, ours, printed in (("range of the displacement", "mm", 1e3 * float(np.ptp(x)), 0.15),
                                      ("lowest velocity", "m/s", float(v.min()), -0.5),
                                      ("highest normal force", "N", float(N.max()), 80.0)):  # fmt: skip
        yield Comparison(f"{what} (label of the axis)", unit, ours, printed, "paper", relative=0.15, missed=True)
    scene = load("tread")
    c_x, c_z, coupling = (value(scene, f"tip.{key}") for key in
                          ("tangential_stiffness", "normal_stiffness", "coupling"))  # fmt: skip
    weakest = float(np.linalg.eigvalsh([[c_x, -coupling], [-coupling, c_z]])[0])
    yield Comparison("smallest stiffness of the block without the plate", "N/m", weakest, math.nan, "paper")
    sliding = rig.modes("tread").sliding
    mu = sliding.coefficient["contact"]
    constant = load("tread", friction__law="constant", friction__mu=mu)
    growth = rig.modes(constant).sliding.growth
    yield Comparison("constant friction: growth of the flutter", "1/s", growth, 1817.1650912590162, "reference", 1e-6)


def rough(figure: Figure) -> Iterator[Comparison]:
    """Draw the rough surface: constant normal force, stick-slip by falling friction."""
    cycle = _panels(figure, "tread_rough", rounds=1)
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
    found = cycle.extremes["friction_force"][1]
    yield Comparison("highest friction force: mu_s P", "N", found, highest, "theory", relative=1e-9)


def _panels(figure: Figure, name: str, rounds: int) -> Cycle:
    """Displacement, velocity, limit cycle and forces as in the paper; two cycles of `rounds` rounds each."""
    import rig

    cycle = rig.limit_cycle(load(name))
    ran = run(quiet(load(name, clock__frame=FINE)), 0.12)
    last = ran.time >= ran.time[-1] - 2.0 * cycle.period
    t = 1e3 * (ran.time[last] - ran.time[last][0])
    x, v, T, N = (ran.signals[key][last] for key in ("displacement", "velocity", "friction_force", "normal_force"))
    (place, speed), (phase, force) = figure.subplots(2, 2)
    place.plot(t, 1e6 * x, color=BLUE)
    place.set(title="(a) displacement", xlabel="time [ms]", ylabel="displacement [um]")
    speed.plot(t, v, color=BLUE)
    speed.set(title="(b) velocity", xlabel="time [ms]", ylabel="velocity [m/s]")
    phase.plot(1e6 * x, v, color=BLUE)
    phase.set(title="(c) limit cycle" + (f", {rounds} rounds" if rounds > 1 else ""),
              xlabel="displacement [um]", ylabel="velocity [m/s]")  # fmt: skip
    force.plot(t, N, color=AMBER, label="normal force")
    force.plot(t, T, "--", color=VERMILION, label="friction force")
    force.set(title="(d) forces", xlabel="time [ms]", ylabel="force [N]", ylim=(None, 1.35 * max(N.max(), T.max())))
    force.legend(ncols=2, loc="upper right")
    return cycle


_SMOOTHED = "The reference smooths friction over 0.2 mm/s; its numbers are valid to 2 %. The paper gives no parameters."
ENTRIES = (
    Entry("kroeger-13", "kroeger", "Figure 13", "tread block with a rounded edge on glass", ("tread",), edge,
          _SMOOTHED + " The block is not passive: without the plate its stiffness is negative. Its motion is smaller "
          "than in the paper. The page on plants has a passive block that flutters with a larger motion.", (9.6, 6.6)),
    Entry("kroeger-14", "kroeger", "Figure 14", "tread block with a rough surface on glass", ("tread_rough",), rough,
          _SMOOTHED, (9.6, 6.6)),
)  # fmt: skip
