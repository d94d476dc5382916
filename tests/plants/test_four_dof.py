"""Three bodies on a belt: mode coupling with four degrees of freedom, in eigenvalues and in time.

"A new mechanism for friction-induced vibration and noise", section 3.1. Numbers: tests/reference/four_dof.json, by
independent code, and the closed form h^2 = 5000 (1 - mu) with h = 200 - W - 10000 / (200 - W), W = omega^2.
"""

import math

import numpy as np
import pytest
from reference import in_order, numbers, rates
from scipy.optimize import brentq

import rig
from rig.stability.linearisation import sliding_key, steady

REFERENCE = numbers("four_dof")
BELOW = [one for one in REFERENCE["eig"] if one["mu"] < 1.0]


def printed(mu):
    """The stiffness matrix of equation 1 with all k = kc = 100 N/m."""
    across = -50.0 + 100.0 * mu
    return np.array([[200.0, 0, -100, 0], [0, 200, 0, -100], [-100, 0, 150, across], [0, -100, -50, 250]])


def sliding(**changes):
    return rig.modes(rig.load("four_dof", {key.replace("__", "."): value for key, value in changes.items()})).sliding


def closed_form(mu):
    """Frequencies [rad/s] below the coalescence."""
    h = math.sqrt(5000.0 * (1.0 - mu))
    return sorted(math.sqrt(200.0 - 0.5 * (s * h + q * math.hypot(h, 200.0))) for s in (1, -1) for q in (1, -1))


@pytest.mark.parametrize("mu", [0.0, 0.5, 1.0, 1.7])
def test_matrices_of_sliding_are_those_of_the_paper(mu):
    system = rig.load("four_dof", {"friction.mu": mu}).assemble().system()
    assert system.coordinates == ("u1", "v3", "u2", "v2")
    assert system.mass == pytest.approx(np.eye(4), abs=1e-15)
    A = steady(system, sliding_key(system)).A
    assert -A[4:8, :4] == pytest.approx(printed(mu), abs=1e-12)
    assert np.abs(A[4:8, 4:8]).max() < 1e-15
    assert system.force[3, :].sum() == -2.0  # f: the preload on v2, and no force on u2
    assert np.count_nonzero(system.force) == 1


@pytest.mark.parametrize("one", REFERENCE["eig"], ids=lambda one: f"mu={one['mu']}")
def test_eigenvalues_are_those_of_the_reference(one):
    found = rates(sliding(friction__mu=one["mu"]))
    expected = in_order(map(complex, one["re"], one["im"]))
    double = 1e-6 if one["mu"] == 1.0 else 1e-11  # a rounding of K moves a double eigenvalue by its square root
    assert found == pytest.approx(expected, abs=double)


@pytest.mark.parametrize("one", BELOW, ids=lambda one: f"mu={one['mu']}")
def test_below_the_coalescence_frequencies_are_those_of_the_closed_form(one):
    assert [rate.imag for rate in rates(sliding(friction__mu=one["mu"]))] == pytest.approx(
        closed_form(one["mu"]), rel=1e-12
    )


def test_both_pairs_coalesce_at_a_friction_coefficient_of_one():
    [critical] = rig.sweep("four_dof", "friction.mu", np.linspace(0.0, 2.0, 41)).critical
    assert critical.value == pytest.approx(REFERENCE["mu_crit"], abs=1e-9)
    assert critical.kind == "flutter"
    assert critical.becomes == "unstable"
    low, same_low, high, same_high = (rate.imag for rate in rates(sliding(friction__mu=1.0)))
    assert [low, high] == pytest.approx(REFERENCE["omega_crit"], rel=1e-7)
    assert [same_low, same_high] == pytest.approx([low, high], rel=1e-7)


@pytest.mark.parametrize(
    ("angle", "speed", "flutters"), [(135, 0.3, True), (45, -0.3, True), (45, 0.3, False), (135, -0.3, False)]
)
def test_flutter_takes_opposite_signs_of_both_couplings(angle, speed, flutters):
    """Spring 3 couples with 0.5 k3 sin 2a, friction with mu kc in the direction of sliding."""
    changes = {"spring_3__angle": math.radians(angle), "drive__speed": speed}
    if not flutters:
        assert all(abs(sliding(friction__mu=mu, **changes).growth) < 1e-9 for mu in (0.5, 1.0, 1.5, 3.0))
        return
    found = brentq(lambda mu: sliding(friction__mu=mu, **changes).growth - 1e-6, 0.9, 1.1, xtol=1e-13)
    assert found == pytest.approx(1.0, abs=1e-9)


def test_equilibrium_is_that_of_the_printed_equation():
    x = np.linalg.solve(printed(1.1), [0.0, 0.0, 0.0, -2.0])
    found = sliding(friction__mu=1.1).equilibrium
    names = ("body_1_displacement", "body_3_height", "displacement", "height")
    assert [found[name] for name in names] == pytest.approx(x, rel=1e-12)
    assert found["normal_force"] == pytest.approx(-100.0 * x[3], rel=1e-12)
    start = rig.load("four_dof").parameters.start
    assert [start.body_1_displacement, start.body_3_height, start.displacement] == pytest.approx(x[:3], rel=1e-12)
    assert start.height == pytest.approx(0.99 * x[3], rel=1e-12)


def rate(mode, t, y, mu, V):
    """Equations of motion written once more; y: u1, v3, u2, v2 and their velocities."""
    stiffness = printed({"slip": mu, "back": -mu, "stick": 0.0, "open": 0.0}[mode])
    if mode == "open":
        stiffness[3, 3] -= 100.0
    force = -stiffness @ y[:4] - (0.0, 0.0, 0.0, 2.0)
    if mode == "stick":
        force[2] = 0.0
    return np.concatenate((y[4:], force))


@pytest.mark.parametrize(
    ("changes", "first"), [({}, ("load opens", 9.258)), ({"drive.speed": 0.02}, ("contact slip ends", 5.944))]
)
def test_first_event_is_that_of_scipy(move, chain, changes, first):
    """Lift-off at the belt's speed of the scene, stick on a slow belt; up to there by DOP853."""
    what, about = first
    run = move("four_dof", changes, duration=about + 0.5, cap=1000)
    V, start = changes.get("drive.speed", 0.3), run.motion.system.start

    def guards(mode):
        yield lambda t, y: -100.0 * y[3]
        yield lambda t, y: V - y[6]

    def follow(mode, which, t, y):
        return ("open" if which == 0 else "stick"), y

    [expected, *_] = chain(lambda mode, t, y: rate(mode, t, y, 1.1, V), guards, follow, "slip", start[:8], about + 0.05)
    assert run.motion.events()[0].what == what
    assert expected == pytest.approx(about, abs=1e-3)
    assert run.times(what)[0] == pytest.approx(expected, abs=1e-9)


def test_growth_that_lift_off_limits_is_told_and_does_not_refuse_a_run():
    found = rig.modes("four_dof").findings
    assert {one.level for one in found} == {"info"}
    assert sorted(one.number for one in found) == pytest.approx([0.3230301031927026, 0.5564174589206108], rel=1e-9)
    assert all("it grows until load opens" in one.what for one in found)
    assert rig.modes(rig.load("four_dof", {"friction.mu": 0.9})).findings == ()


@pytest.mark.parametrize("spring", [1, 2, 4, 5])
def test_one_damper_halves_the_critical_friction(spring):
    """At mu = 0.5 friction cancels the coupling of spring 3 in row u2, whatever the damper."""
    scene = rig.load("four_dof", {f"spring_{spring}.damping": 0.1})
    [critical] = rig.sweep(scene, "friction.mu", np.linspace(0.0, 0.9, 16)).critical
    assert critical.value == pytest.approx(0.5, abs=1e-9)


def test_with_dampers_it_has_a_limit_cycle_that_slides_lifts_off_and_sticks():
    """The one that docs/theory/plants.md tells."""
    changes = {f"spring_{i}.damping": 0.5 for i in range(1, 6)} | {"friction.mu": 1.5}
    found = rig.limit_cycle(rig.load("four_dof", changes))
    assert found.period == pytest.approx(0.6643446824, rel=1e-6)
    assert found.extremes["normal_force"][0] == pytest.approx(0.0, abs=1e-12)
    assert found.stick_time["contact"] == pytest.approx(0.06336626902, rel=1e-6)
