"""The mass on a belt with two degrees of freedom: mode coupling, lift-off, tangential dither.

Liu and Ouyang, Meccanica 55 (2020), section 2. Numbers: tests/reference/two_dof.json, by independent code: eigenvalues
1e-6, first events 1e-6. The boundary of dither is that of averaging, with the fast motion to leading order as in the
reference; test_map_dither finds it by simulation.
"""

import math

import numpy as np
import pytest
from reference import in_order, numbers, rates
from scipy.optimize import brentq

import rig
from rig.analysis.cycles.averaged import averaged

LIU = numbers("two_dof")
W0 = LIU["omega_ref"]
UNDAMPED = {"spring_1.damping": 0.0, "spring_2.damping": 0.0}


def sliding(mu, changes=None):
    return rig.modes(rig.load("two_dof", {"friction.mu": mu} | (changes or {}))).sliding


@pytest.mark.parametrize("one", LIU["eig_table"], ids=lambda one: f"mu={one['mu']}")
def test_equilibrium_and_eigenvalues_are_those_of_the_reference(one):
    found = sliding(one["mu"])
    assert rates(found) == pytest.approx(in_order(complex(*v) for v in one["eigs"]), rel=1e-6)
    got = [found.equilibrium[name] for name in ("displacement", "height", "normal_force")]
    assert got == pytest.approx([one["x_e"], one["y_e"], one["N_e"]], rel=1e-9, abs=1e-15)


def test_matrices_are_those_of_the_reference():
    system = rig.load("two_dof").assemble().system()
    k3 = rig.load("two_dof").parameters.contact.stiffness
    assert system.stiffness + np.diag([0.0, k3]) == pytest.approx(np.array(LIU["K"]), rel=1e-12)
    assert system.damping == pytest.approx(np.array(LIU["C"]), rel=1e-12)


def hurwitz(mu, K, C, k3):
    """a3 a2 a1 - a1^2 - a3^2 a0 of the sliding mass (m = 1): zero where it begins to flutter."""
    coupled = K[0][1] + mu * k3
    a3, a2 = C[0][0] + C[1][1], K[0][0] + K[1][1] + C[0][0] * C[1][1] - C[0][1] ** 2
    a1 = C[0][0] * K[1][1] + C[1][1] * K[0][0] - C[0][1] * (K[0][1] + coupled)
    return a3 * a2 * a1 - a1**2 - a3**2 * (K[0][0] * K[1][1] - K[0][1] * coupled)


def test_critical_friction_is_that_of_the_paper_and_of_hurwitz():
    """0.37 as published, 0.369726 with the reference's parameters."""
    found = brentq(lambda mu: sliding(mu).growth, 0.3, 0.5, xtol=1e-13)
    assert found == pytest.approx(LIU["mu_c_damped"], abs=1e-6)
    assert round(found, 2) == 0.37
    found = brentq(lambda mu: hurwitz(mu, LIU["K"], LIU["C"], LIU["params"]["k3"]), 0.3, 0.5, xtol=1e-14)
    assert found == pytest.approx(LIU["mu_c_damped"], rel=1e-9)


@pytest.mark.parametrize("contact", [50.0, 35.0])
def test_without_damping_the_modes_meet_at_the_closed_form(contact):
    """((K11 - K22)^2 / 4 + K12^2) / (|K12| k3)."""
    K = rig.load("two_dof", {"contact.stiffness": contact}).assemble().system().stiffness
    limit = ((K[0, 0] - K[1, 1] - contact) ** 2 / 4.0 + K[0, 1] ** 2) / (abs(K[0, 1]) * contact)
    if contact == LIU["params"]["k3"]:
        assert limit == pytest.approx(LIU["mu_c_undamped"], rel=1e-12)
    changes = UNDAMPED | {"contact.stiffness": contact}
    below, above = (sliding(limit * f, changes) for f in (1.0 - 1e-6, 1.0 + 1e-6))
    assert below.growth < 1e-6
    assert above.growth > 5e-4
    apart = [rate.imag for rate in rates(below)]
    assert apart[1] - apart[0] > 1e-3
    assert np.ptp([rate.imag for rate in rates(above)]) < 1e-6


def history(at):
    one = LIU["time_history_no_dither"][at]
    x, y, _, _ = one["z0"]
    return one, {"friction.mu": one["mu"], "start.displacement": x, "start.height": y}


@pytest.mark.parametrize("at", [0, 1], ids=["mu=0.4", "mu=0.5"])
def test_first_event_is_the_lift_off_of_the_reference(move, at):
    one, changes = history(at)
    run = move("two_dof", changes, duration=80.0, cap=1000)
    first, *_ = events = run.motion.events()
    what = [event.what for event in events]  # N has one term, whose size at N = 0 says nothing of its rounding
    assert what[0::2] == ["load opens"] * len(what[0::2])
    assert what[1::2] == ["load closes"] * len(what[1::2])
    assert (one["first_event"], first.what) == ("separation", "load opens")
    assert run.times("load opens")[0] == pytest.approx(one["t_first_event"], rel=1e-6)
    assert abs(run.motion.energy()["error"]) < 1e-9
    sim = one["event_sim"]
    assert [run["height"].min(), run["height"].max()] == pytest.approx([sim["y_min"], sim["y_max"]], rel=1e-4)


def field(mu, V, closed, A=0.0, w=1.0):
    """Equations 1 to 4 without the rig's code; x, y, x', y'."""
    (K11, K12), (_, K22) = LIU["K"]
    (C11, C12), (_, C22) = LIU["C"]
    k3, F0 = LIU["params"]["k3"], LIU["params"]["F0"]

    def rate(t, z):
        N = -k3 * z[1] if closed else 0.0
        T = mu * N * np.sign(V - z[2])
        return [
            z[2],
            z[3],
            T + A * np.cos(w * t) - C11 * z[2] - C12 * z[3] - K11 * z[0] - K12 * z[1],
            N - F0 - C12 * z[2] - C22 * z[3] - K12 * z[0] - (K22 - k3) * z[1],
        ]

    return rate


def test_lift_off_and_return_are_those_of_scipy(move, chain):
    one, changes = history(1)
    run = move("two_dof", changes, duration=12.0)
    fields = {closed: field(0.5, 0.3, closed) for closed in (True, False)}
    expected = chain(
        lambda closed, t, z: fields[closed](t, z),
        lambda closed: [lambda t, z: -z[1] if closed else z[1]],
        lambda closed, which, t, z: (not closed, z),
        True,
        np.array(one["z0"], float),
        12.0,
    )
    assert len(expected) >= 8
    assert sorted([*run.times("load opens"), *run.times("load closes")]) == pytest.approx(list(expected), rel=1e-8)


# Dither


def shaken(mu, V, r, a, **more):
    """Changes for a force A cos(r w0 t) whose fast velocity is a V."""
    w = r * W0
    return {
        "friction.mu": mu,
        "drive.speed": V,
        "dither.frequency": w / (2.0 * math.pi),
        "dither.amplitude": a * V * w,
        "dither.phase": math.pi / 2.0,
        "dither.enable": True,
    } | more


def mean(mu, V, r, a, leading=False):
    """Averaged sliding."""
    system = rig.load("two_dof_dither", shaken(mu, V, r, a)).assemble().system()
    sine, cosine = (system.names.index(f"dither.{name}") for name in ("sin", "cos"))
    return averaged(system, sine, cosine, a * V * r * W0, leading)


def boundary(mu, V, r, leading=False):
    """The largest a / V at which averaged sliding is neutral: above a sliver just beyond 1."""
    return brentq(lambda a: mean(mu, V, r, a, leading).eigenvalues()[0].real, 1.006, 2.0, xtol=1e-12)


CASES = [
    tuple(float(part[2:] if part[:2] == "mu" else part[1:]) for part in key.split("_"))
    for key in LIU["dither_boundary"]["avg"]
]


def reference(mu, V):
    return LIU["dither_boundary"]["avg"][f"mu{mu:g}_V{V:g}"]


@pytest.mark.parametrize(("mu", "V"), [case for case in CASES if case[0] > 0.45])
def test_leading_order_boundary_is_that_of_the_reference(mu, V):
    """Fast velocity A / (m omega), whatever the frequency."""
    for r in (3, 20):
        assert boundary(mu, V, r, leading=True) == pytest.approx(reference(mu, V)["a_over_V"], rel=1e-9)


@pytest.mark.parametrize(("mu", "V"), [case for case in CASES if case[0] > 0.45])
def test_just_above_the_belt_speed_there_is_a_sliver_of_stability(mu, V):
    """Small motions decay there, but amplitudes a little larger grow on; the boundary is the largest root."""
    sliver = reference(mu, V)["lower_sliver"]
    found = brentq(lambda a: mean(mu, V, 20, a, True).eigenvalues()[0].real, 1.0 + 1e-9, 0.5 * (1.0 + sliver) + 4e-3)
    assert found == pytest.approx(sliver, rel=1e-9)


def test_just_above_the_critical_friction_any_dither_faster_than_the_belt_suffices():
    """Averaging to leading order, mu = 0.4: damped sliding from a = V on, as before below."""
    assert reference(0.4, 0.3)["a_over_V"] == 1.0
    for a in (1.0 + 1e-6, 1.001, 1.01, 1.1, 1.5):
        assert mean(0.4, 0.3, 20, a, True).eigenvalues()[0].real < 0.0
    growth = sliding(0.4).growth
    for a in (0.3, 0.9, 0.999):
        assert mean(0.4, 0.3, 20, a, True).eigenvalues()[0].real == pytest.approx(growth, rel=1e-9)


def test_boundary_without_the_damping_of_dither_is_the_closed_form():
    """1 / sin(pi mu_c / 2 mu) from g0 = mu_c / mu: above the boundary, because dither damps as well."""
    for mu, V in CASES:
        formula = 1.0 / math.sin(0.5 * math.pi * LIU["mu_c_damped"] / mu)
        assert formula == pytest.approx(reference(mu, V)["no_damping_formula"], rel=1e-9)
        assert formula > reference(mu, V)["a_over_V"]


@pytest.mark.parametrize("at", [0, 1, 3], ids=["mu=0.5 a=1.3V", "mu=0.6 a=1.5V", "mu=0.5 a=0.9V"])
def test_dithered_runs_are_those_of_the_reference(move, at):
    """100 s from 10 % off: what is left of the normal motion, means and ripple of what is left."""
    one = LIU["suppression_runs"][at]
    mu, V, r, a = one["mu"], one["V"], one["ratio"], one["a_over_V"]
    start = {"start.displacement": one["x_e_avg"] - a * V / (r * W0), "start.height": 0.9 * one["y_e_avg"]}
    run = move("two_dof_dither", shaken(mu, V, r, a, **start), step_ms=1.0, duration=100.0, cap=2000)
    late = run.time > 90.0
    x, y = run["displacement"][late], run["height"][late]
    if a < 1.0:
        assert np.ptp(y) > 0.02
        assert len(run.times("load opens")) > 10
        return
    assert np.abs(y - y.mean()).max() < 1.5e-6
    assert y.mean() == pytest.approx(one["y_mean_last"], abs=1e-7)
    assert x.mean() == pytest.approx(one["x_mean_last"], abs=1e-6)
    assert 0.5 * np.ptp(x) == pytest.approx(one["x_amp_last"], rel=1e-3)
    assert not len(run.times("load opens"))


def test_dithered_slip_is_that_of_scipy(move, chain):
    """The first reversals of slip, mu = 0.6, r = 5, a = 1.4 V."""
    mu, V, r, a = 0.6, 0.3, 5, 1.4
    w, start = r * W0, {"start.displacement": 0.0, "start.height": -0.01}
    run = move("two_dof_dither", shaken(mu, V, r, a, **start), duration=1.0)
    fields = {slip: field(mu, slip * 1e6, True, a * V * w, w) for slip in (1.0, -1.0)}  # sgn(V - x') is slip
    expected = chain(
        lambda slip, t, z: fields[slip](t, z),
        lambda slip: [lambda t, z: slip * (V - z[2])],
        lambda slip, which, t, z: (-slip, z),
        1.0,
        np.array([0.0, -0.01, 0.0, 0.0]),
        1.0,
    )
    assert len(expected) >= 10
    assert run.times("contact slip ends")[: len(expected)] == pytest.approx(list(expected), rel=1e-6)
