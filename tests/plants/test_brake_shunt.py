"""The brake with a shunted piezo stack: eigenvalues, stable tunings, and what connecting does to the squeal.

Numbers: Kroeger, Neubauer, Popp (2008), section 4 d, with calibrated parameters, by independent code
(tests/reference/kroger_shunt.json).
"""

from functools import cache

import numpy as np
import pytest
from reference import numbers
from scipy.optimize import brentq, minimize_scalar

import rig
from rig.effects import shunt as shunt_limits
from rig.effects.shunt import Stack
from rig.plants import brake
from rig.stability.linearisation import sliding_key, steady
from rig.stability.report import stability_report

ORACLE = numbers("kroger_shunt")["brake"]


@cache
def parameters(mu=None):
    changes = {} if mu is None else {"friction.mu": mu}
    return rig.load("brake_shunt", changes).parameters


def system(kind="series", mu=None, **values):
    """The brake's matrices with another shunt."""
    p = parameters(mu)
    values = (
        {"connected": True, "resistance": 0.0, "inductance": 0.0, "delta": 0.0} | values if kind == "series" else {}
    )
    shunt = type(p).model_validate(p.model_dump() | {"shunt": {"kind": kind} | values}).shunt
    return brake.assemble(p.model_copy(update={"shunt": shunt}), {}).system()


def least(*kind, **values):
    """The least stable eigenvalue [1/s]."""
    found = system(*kind, **values)
    return complex(steady(found, sliding_key(found)).eigenvalues()[0])


def test_every_tuning_of_the_reference():
    for kind in ("open", "short"):
        found = least(kind)
        assert [found.real, found.imag] == pytest.approx(ORACLE[kind], abs=1e-3)
    for delta, R, L, re, im in ORACLE["points"]:
        found = least(delta=delta, resistance=R, inductance=L)
        assert [found.real, found.imag] == pytest.approx([re, im], abs=1e-3), (delta, R, L)


@pytest.mark.parametrize("R", ORACLE["R_shunt_only"])
def test_a_resistor_alone_does_not_help(R):
    found = least(resistance=float(R))
    assert [found.real, found.imag] == pytest.approx(ORACLE["R_shunt_only"][R], abs=1e-3)
    assert found.real > 37.0


@pytest.mark.parametrize("delta", ORACLE["stable"])
def test_stable_intervals_of_the_inductance(delta):
    """Their ends to 0.005 of L_LRC, the step of the reference, which looked from 0.5 to 1.5."""
    bands = dict(ORACLE["stable"][delta])
    tuned = bands.pop("L_LRC")
    for R, (low, high) in bands.items():
        inside, outside = (
            [least(delta=float(delta), resistance=float(R), inductance=x * tuned).real for x in (low - d, high + d)]
            for d in (0.0, 0.005)
        )
        assert max(inside) < 0.0, R
        assert low == 0.5 or outside[0] > 0.0, R
        assert high == 1.5 or outside[1] > 0.0, R


def test_beyond_a_resistance_nothing_helps():
    """At the tunings of the reference, and at the best ones: there it is the same for every capacitance."""
    limits = []
    for delta, (x, expected) in ORACLE["R_limit"].items():
        tuned = ORACLE["stable"][delta]["L_LRC"]

        def growth(x, R, delta=float(delta), tuned=tuned):
            return least(delta=delta, resistance=R, inductance=x * tuned).real

        def best(R, growth=growth):
            return minimize_scalar(growth, bounds=(0.8, 1.1), args=(R,), method="bounded", options={"xatol": 1e-5}).fun

        assert brentq(lambda R, x=x, growth=growth: growth(x, R), 140.0, 160.0) == pytest.approx(expected, abs=1e-3)
        limits.append(brentq(best, 140.0, 160.0, xtol=1e-3))
        assert limits[-1] > expected
    assert limits == pytest.approx([limits[0]] * 3, abs=2e-3)


def test_the_static_limit_is_that_of_the_brake():
    path = {"inner_pad.z": 1.0, "inner_pad.phi": -0.0167, "calliper.z": -1.0, "calliper.phi": 0.0167}
    stack = Stack(ORACLE["params"]["e_N_per_V"], ORACLE["params"]["Cps"], path)
    free = system("open", mu=0.0)
    expected = ORACLE["static"]
    assert stack.kappa == pytest.approx(expected["kappa"], rel=1e-12)
    assert shunt_limits.stiffness_between_ends(free, stack) == pytest.approx(
        expected["k_struct_seen_by_piezo_SC"], rel=1e-12
    )
    assert shunt_limits.static_limit(free, stack) == pytest.approx(expected["delta_static_limit"], rel=1e-12)


def test_below_the_static_limit_the_brake_gives_way():
    limit = ORACLE["static"]["delta_static_limit"]
    slow = {"mu": 0.0, "resistance": 50.0, "inductance": 0.01}
    assert least(delta=limit - 1e-3, **slow).real > 1.0 > 0.0 > least(delta=limit + 1e-3, **slow).real
    found = stability_report(system(delta=-0.98, resistance=50.0, inductance=0.002), "exact", 2e-5)
    assert [f for f in found if f.level == "error" and "is statically unstable" in f.what]


def envelope(run, start):
    """Largest pad speed within 10 ms of `start` [s]."""
    inside = (run.time >= start - 1e-9) & (run.time <= start + 0.01 + 1e-9)
    return np.abs(run.signals["velocity"])[inside].max()


@pytest.mark.parametrize("row", ORACLE["time"], ids=lambda row: f"{row['delta']:g}")
def test_the_shunt_silences_the_squeal_and_it_comes_back(row):
    """Open until 0.8 s, connected until 1.1 s: the envelope of the reference within 5 %, energy to 1e-9."""
    changes = {"shunt.delta": row["delta"], "shunt.resistance": row["R"], "shunt.inductance": row["L"]}
    run = rig.simulate(rig.load("brake_shunt", changes))
    assert abs(run.energy["error"]) < 1e-9
    assert run.energy["resistor"] > 0.0
    assert envelope(run, 0.78) == pytest.approx(row["v_pad_x_open_LC"], rel=0.01)
    squeals = (run.time > 0.7) & (run.time < 0.8)
    assert np.abs(run.signals["stack_voltage"])[squeals].max() == pytest.approx(row["U_open_LC"], rel=0.01)
    for begin, rows in ((0.8, row["v_after_connect"]), (1.1, row["v_after_disconnect"])):
        for after, expected in rows:
            assert envelope(run, begin + after) == pytest.approx(expected, rel=0.05), (begin, after)
    full = envelope(run, 0.78)
    assert envelope(run, 1.1 + 0.2) > 0.98 * full  # figure 29: full again in less than 200 ms


def squeal_growth(L):
    """Growth rate [1/s] of the brake's squeal with the shunt of brake_shunt and another coil."""
    found = system(delta=-0.5, resistance=50.0, inductance=L)
    values = steady(found, sliding_key(found)).eigenvalues()
    return max(value.real for value in values if 3000.0 < abs(value.imag) / (2.0 * np.pi) < 3800.0)


def test_the_best_coil_takes_twenty_decibels_within_30_ms():
    """Figure 29 connects the optimal shunt: where the squeal dies fastest, not where its circuit is in tune with it."""
    best = rig.load("brake_shunt_sound").parameters.shunt.inductance
    assert squeal_growth(best) == pytest.approx(-22.857, abs=1e-3)
    assert squeal_growth(best) < min(squeal_growth(0.998 * best), squeal_growth(1.002 * best))

    def takes(L):
        run = rig.simulate(rig.load("brake_shunt", {"shunt.inductance": L}), duration=0.9)
        tenth = 0.1 * envelope(run, 0.78)
        return next(ms for ms in range(90) if envelope(run, 0.8 + 1e-3 * ms) < tenth)

    assert takes(best) == pytest.approx(20, abs=1)
    assert takes(rig.load("brake_shunt").parameters.shunt.inductance) == pytest.approx(32, abs=1)
