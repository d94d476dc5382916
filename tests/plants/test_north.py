"""North's model: the limits of flutter and of divergence are two different things.

Kroeger, Neubauer, Popp (2008), section 2, equations 2.4 and 2.5. Numbers: tests/reference/kroger_rigs.json. The
matrices of equation 2.4 are written down here once more; the paper calls 2.5 a flutter limit, but it is det K = 0.
"""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from reference import in_order, rates
from scipy.optimize import brentq

import rig
from rig.plants.north import limits

SETS = {"north_1": "north", "north_2": "north_divergence"}


def matrices(p, mu):
    """M, D, K of equation 2.4 from a parameter set of the reference."""
    K = [
        [p["c1"] + p["c2"], -p["c2"] * p["s"]],
        [p["c2"] * (mu * p["h"] - p["s"]), p["c_phi"] + p["s"] * p["c2"] * (p["s"] - mu * p["h"])],
    ]
    return np.diag([p["m"], p["J"]]), np.diag([p["d1"], p["d_phi"]]), np.array(K)


def eigenvalues(p, mu):
    M, D, K = matrices(p, mu)
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    found = np.linalg.eigvals(A)
    return found[found.imag >= 0.0]


def told(scene, mu):
    return np.array(rates(rig.modes(rig.load(scene, {"friction.mu": mu})).sliding))


@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("mu", [0.0, 0.1, 0.25, 0.5, 1.05, 1.2])
def test_eigenvalues_are_those_of_equation_2_4(rigs, name, mu):
    expected = in_order(eigenvalues(rigs[name]["params"], mu))
    assert told(SETS[name], mu) == pytest.approx(np.array(expected), rel=1e-8, abs=1e-4)


@pytest.mark.parametrize("name", SETS)
def test_limits_are_those_of_the_reference(rigs, name):
    found = limits(rig.load(SETS[name]).parameters)
    assert found["divergence"] == pytest.approx(rigs[name]["mu_div_eq25"], rel=1e-12)
    flutter = rigs[name]["mu_flutter_H3"]
    assert found["flutter"] == (math.inf if flutter is None else pytest.approx(flutter, rel=1e-10))


def test_divergence_begins_at_equation_2_5_and_beyond_it_no_sliding_equilibrium_presses(rigs):
    expected = rigs["north_2"]["mu_div_eq25"]
    found = brentq(lambda mu: told("north_divergence", mu).real.max(), 1.07, 1.1, xtol=1e-14)
    assert found == pytest.approx(expected, rel=1e-9)
    for factor, exists in ((1.0 - 1e-4, True), (1.0 + 1e-4, False)):
        unbounded = {"friction.mu": factor * expected, "limits.displacement": "none"}
        sliding = rig.modes(rig.load("north_divergence", unbounded)).sliding
        assert sliding.exists is exists
        assert exists or sliding.modes[0].kind == "divergence"


@given(
    s=st.integers(1, 30).map(lambda i: i * 1e-3),
    h=st.integers(1, 30).map(lambda i: i * 1e-3),
    c_phi=st.integers(1, 200).map(lambda i: i * 100.0),
    J=st.integers(2, 60).map(lambda i: i * 1e-5),
    d_phi=st.integers(1, 50).map(lambda i: i * 1e-3),
)
@settings(max_examples=25)
def test_below_the_lesser_limit_sliding_is_stable_and_above_it_is_not(s, h, c_phi, J, d_phi):
    """For any body: Hurwitz's limits against the eigenvalues of the matrices of equation 2.4.

    Where both limits are one, as at 469.75 for some, it is neither this nor that.
    """
    changes = {
        "lining.offset": s,
        "lining.lever": h,
        "body.tilt_stiffness": c_phi,
        "body.inertia": J,
        "body.tilt_damping": d_phi,
    }
    found = limits(rig.load("north", changes).parameters)
    p = {"m": 0.5, "J": J, "c1": 2e7, "c2": 8e7, "c_phi": c_phi, "d1": 20.0, "d_phi": d_phi, "h": h, "s": s}
    least = min(found.values())
    assume(max(found.values()) > least * (1.0 + 1e-4))
    assert eigenvalues(p, least * (1.0 - 1e-6)).real.max() < 0.0
    growing = eigenvalues(p, least * (1.0 + 1e-5))
    worst = growing[growing.real.argmax()]
    assert worst.real > 0.0
    assert (worst.imag > 0.0) == (found["flutter"] < found["divergence"])


def test_first_lift_off_of_flutter_is_that_of_scipy(rigs, move, chain):
    """The whole way from the start of the scene to N = 0, by DOP853 on equation 2.4 with the preload on its right."""
    p, mu, F = rigs["north_1"]["params"], 0.3, 1000.0
    M, D, K = matrices(p, mu)
    push = np.array([0.0, -mu * p["h"] * F])

    def rate(mode, t, y):
        return [*y[2:], *np.linalg.solve(M, push - K @ y[:2] - D @ y[2:])] if mode == "closed" else np.zeros(4)

    def guards(mode):
        return [lambda t, y: F + p["c2"] * (y[0] - p["s"] * y[1])] if mode == "closed" else []

    opens, *_ = chain(rate, guards, lambda mode, which, t, y: ("open", y), "closed", [0.0, -2.4e-4, 0.0, 0.0], 0.05)
    run = move("north", step_ms=0.02, duration=0.05)
    assert run.motion.events()[0].what == "load opens"
    assert run.times("load opens")[0] == pytest.approx(opens, rel=1e-9)
    assert abs(run.motion.energy()["error"]) < 1e-12


def test_divergence_digs_in_without_vibration(move):
    """The body tips over one way and the contact presses ever more."""
    run = move("north_divergence", step_ms=0.05, duration=0.003)
    assert np.all(np.diff(run["tilt"]) < 0.0)
    assert np.all(run["tilt_velocity"] <= 0.0)
    N = run["normal_force"]
    assert N[-1] > 10.0 * N[0]
