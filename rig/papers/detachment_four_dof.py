"""A new mechanism for friction-induced vibration and noise, section 3.1: mode coupling with four degrees of freedom.

The paper prints the matrices, and the eigenvalues as curves; its only number is the coalescence at 1. "reference" is an
independent computation of the printed matrices, "theory" the closed form h^2 = 5000 (1 - mu) of rig.plants.four_dof.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

import rig
from rig.analysis.linear.modes_report import Mode
from rig.papers.entry import Compared, Comparison, Entry, load, numbered, quiet, tops
from rig.record.run import Run
from rig.view.palette import AMBER, BLUE, GREY, VERMILION

_MEETS = (10.0, 17.320508075688775)  # rad/s
_BELOW = {
    0.0: (7.653668647, 11.370546244, 16.453287760, 18.477590650),
    0.5: (8.480705122, 11.041845831, 16.675660126, 18.112913643),
    0.9: (9.391304549, 10.514622242, 17.013016167, 17.657955682),
}  # rad/s
_ABOVE = {1.01: (0.1766938980, 0.1020709363), 1.5: (1.2218069077, 0.7248964932)}  # 1/s
_GROWS = (4.0, 9.0)  # s: range of the fit
_LIFTS = 9.257839536912664  # s


def _critical(**changes: object) -> list[float]:
    """Friction coefficients up to 3 at which sliding becomes unstable."""
    swept = rig.sweep(load("four_dof", **changes), "friction.mu", np.linspace(0.0, 3.0, 61))
    return [crossing.value for crossing in swept.critical if crossing.becomes == "unstable"]


def _four_dof_modes(mu: float) -> Sequence[Mode]:
    return rig.modes(load("four_dof", friction__mu=mu)).sliding.modes


def _frequencies(mu: float) -> list[float]:
    """Frequencies at a friction coefficient [rad/s]."""
    return sorted(2.0 * math.pi * mode.frequency for mode in _four_dof_modes(mu))


def four_dof_eigenvalues(figure: Figure) -> Compared:
    """Draw frequencies and growth rates over the friction coefficient, as in figure 6."""
    swept = rig.sweep("four_dof", "friction.mu", np.linspace(0.0, 2.0, 201))
    turning, growth = figure.subplots(1, 2)
    turning.plot(swept.axis.values, 2.0 * math.pi * swept.frequency, ".", color=BLUE, markersize=3)
    growth.plot(swept.axis.values, swept.growth, ".", color=BLUE, markersize=3)
    for axis in (turning, growth):
        axis.axvline(1.0, color=VERMILION, ls="--", lw=1.0)
        axis.set_xlabel("friction coefficient")
    turning.set(title="frequencies", ylabel="imaginary part [rad/s]")
    growth.set(title="growth rates", ylabel="real part [1/s]")
    [limit] = _critical()
    yield Comparison("critical friction coefficient", "", limit, 1.0, "paper", absolute=1e-9)
    met = (_MEETS[0], _MEETS[0], _MEETS[1], _MEETS[1])
    yield from numbered("mu = 1: frequency {}", _frequencies(1.0), met, "rad/s", "theory", absolute=1e-6)
    for mu, printed in _BELOW.items():
        what = f"mu = {mu:g}: frequency {{}}"
        yield from numbered(what, _frequencies(mu), printed, "rad/s", "reference", absolute=1e-8)
    for mu, (fast, slow) in _ABOVE.items():
        rates = sorted(mode.growth for mode in _four_dof_modes(mu))
        what = f"mu = {mu:g}: growth rate"
        yield from numbered(what, rates, (-fast, -slow, slow, fast), "1/s", "reference", absolute=1e-8)
    [turned] = _critical(spring_3__angle=0.25 * math.pi, drive__speed=-0.3)
    yield Comparison("both couplings with the other sign: critical", "", turned, 1.0, "theory", absolute=1e-9)
    for what, changes in (
        ("only spring 3 with the other sign", {"spring_3__angle": 0.25 * math.pi}),
        ("only friction with the other sign", {"drive__speed": -0.3}),
    ):
        count = float(len(_critical(**changes)))
        yield Comparison(f"{what}: critical values up to 3", "", count, 0.0, "reference")
    [damped] = _critical(spring_1__damping=0.2)
    yield Comparison("one damper, beside spring 1: critical", "", damped, 0.5, "theory", absolute=1e-9)


def histories(figure: Figure) -> Compared:
    """Draw the model of figure 5 in time: growth from near sliding, then lift-off and stick."""
    growing, along, across = figure.subplots(3, 1)
    start = {
        "start__displacement": 0.008,
        "start__height": -0.008 * (1.0 - 1e-5),
        "start__body_1_displacement": 0.004,
        "start__body_3_height": -0.004,
    }
    near = quiet(load("four_dof", friction__mu=1.5, **start))
    ran = rig.simulate(near, _GROWS[1])
    rate = rig.modes(near).sliding.growth
    v = np.abs(ran.signals["velocity"])
    top = tops(v)
    top = top[ran.time[top] > _GROWS[0]]
    slope, height = np.polyfit(ran.time[top], np.log(v[top]), 1)
    fitted = np.exp(height + slope * ran.time)
    growing.semilogy(ran.time, v, color=BLUE, lw=0.8)
    growing.semilogy(ran.time, fitted, color=VERMILION, ls="--", label=f"fitted: {slope:.4f} 1/s")
    growing.set(title="mu = 1.5, from 1e-5 off sliding", ylabel="|velocity| [m/s]", xlabel="time [s]")
    growing.set_ylim(1e-7, None)
    growing.legend(loc="lower right")
    yield Comparison("mu = 1.5: growth rate, simulated", "1/s", float(slope), rate, "theory", relative=0.02)

    ran = rig.simulate(quiet(load("four_dof")), 30.0)
    lifts = _first(ran, "load opens")
    sticks = _first(ran, "contact slip ends")
    for axis, name, title in ((along, "displacement", "along the belt"), (across, "height", "away from the belt")):
        axis.plot(ran.time, 1e3 * ran.signals[name], color=BLUE, lw=0.8)
        axis.axvline(lifts, color=VERMILION, ls="--", lw=1.0, label="first: load opens")
        axis.axvline(sticks, color=AMBER, ls="--", lw=1.0, label="first: contact slip ends")
        axis.set(title=f"body 2 {title}, mu = 1.1", ylabel=f"{name} [mm]", xlim=(0.0, 30.0))
    across.axhline(0.0, color=GREY, lw=0.7)
    across.set_xlabel("time [s]")
    along.legend(loc="upper left")
    yield Comparison("mu = 1.1: first lift-off", "s", lifts, _LIFTS, "reference", absolute=1e-6)


def _first(ran: Run, what: str) -> float:
    """Time of the first event with this text [s]."""
    return float(next(event["t_ns"] * 1e-9 for event in ran.events if event["text"] == what))


ENTRIES = (
    Entry(
        "detachment-5",
        "detachment",
        "Figure 5",
        "the model with four degrees of freedom, in time",
        ("four_dof",),
        histories,
        "The paper shows the model, but no motion. Belt speed, preload and start are chosen. In the text mass 1 is "
        "preloaded and slides on the belt; in the matrices it is mass 2, as in this rig.",
        (9.6, 8.0),
    ),
    Entry(
        "detachment-6",
        "detachment",
        "Figure 6",
        "eigenvalues over the friction coefficient",
        ("four_dof",),
        four_dof_eigenvalues,
        "The paper prints curves and one number, the coalescence at 1. The comparisons with other signs and with a "
        "damper are ours: the rig flutters only if friction couples against spring 3, and one damper halves the "
        "limit.",
    ),
)
