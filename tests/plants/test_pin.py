"""The tilted pin: damping, mass and stiffness that friction uses up, jamming, and the vibration that sticks.

Kroeger, Neubauer, Popp (2008), section 2, equation 2.3. Numbers: tests/reference/kroger_rigs.json; the effective
oscillator m2 + m1 k, d2 + d1 k, c2 + c1 k with k = sin g (sin g - mu cos g) is written down here once more.
"""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rig
from rig.errors import SceneError
from rig.model.formulation import assemble
from rig.plants.pin import limits
from rig.solve.records import SLIP_PLUS

M1, M2, C1, C2, D1, D2, G, F, V, MU = 1.0, 0.2, 1e6, 5e5, 20.0, 2.0, math.radians(25.0), 20.0, 0.01, 0.75
SIN, COS = math.sin(G), math.cos(G)


def sliding(mu, **changes):
    return rig.modes(rig.load("pin", {"friction.mu": mu} | changes)).sliding


def effective(mu):
    k = SIN * (SIN - mu * COS)
    return M2 + M1 * k, D2 + D1 * k, C2 + C1 * k


def test_eigenvalues_are_those_of_the_reference(rigs):
    for mu, values in rigs["pin"]["eig"].items():
        mode = sliding(float(mu)).modes[0]
        growth, turning = max(values, key=lambda v: v[1])
        assert complex(mode.growth, 2.0 * math.pi * mode.frequency) == pytest.approx(
            complex(growth, turning), rel=1e-12, abs=1e-11
        )


def test_the_three_limits_are_those_of_the_reference(rigs):
    found, expected = limits(rig.load("pin").parameters), rigs["pin"]
    assert found["damping"] == pytest.approx(expected["mu_crit_eq23"], rel=1e-12)
    assert found["mass"] == pytest.approx(expected["mu_jam_mass"], rel=1e-12)
    assert found["stiffness"] == pytest.approx(expected["mu_static"], rel=1e-12)
    assert min(found, key=found.get) == "damping"
    assert found["damping"] == pytest.approx(math.tan(G) + 2.0 * D2 / (D1 * math.sin(2.0 * G)), rel=1e-14)


@given(
    tilt=st.integers(5, 85).map(math.radians),
    mu=st.integers(0, 250).map(lambda i: i / 100.0),
    ratio=st.integers(1, 100).map(lambda i: i / 20.0),
)
@settings(max_examples=30)
def test_effective_mass_damping_and_stiffness_vanish_at_the_limits(tilt, mu, ratio):
    """For any pin: the rows of the assembled mode set against the oscillator written down here; signs at the limits."""
    scene = rig.load("pin", {"pin.tilt": tilt, "friction.mu": mu, "pin.mass": ratio * M1})
    system = scene.assemble().system()
    modes = assemble(system, system.key([SLIP_PLUS], [0], []))
    k = math.sin(tilt) * (math.sin(tilt) - mu * math.cos(tilt))
    m, d, c = ratio * M1 + M1 * k, D2 + D1 * k, C2 + C1 * k
    assert modes.jam == pytest.approx(m / (ratio * M1), rel=1e-9, abs=1e-12)
    assert modes.A[1, 0] * m == pytest.approx(-c, rel=1e-9, abs=1e-6)
    assert modes.A[1, 1] * m == pytest.approx(-d, rel=1e-9, abs=1e-9)
    found = limits(scene.parameters)
    for name, value in (("mass", m), ("damping", d), ("stiffness", c)):
        if abs(mu - found[name]) > 1e-9:
            assert (mu < found[name]) == (value > 0.0), name


def test_jamming_is_reported_before_the_run_while_the_contact_still_presses():
    """Just below the mass limit the rig may run; just above it is refused, and the normal force would be positive."""
    limit = limits(rig.load("pin").parameters)["mass"]
    below, above = (rig.load("pin", {"friction.mu": limit * f}) for f in (1.0 - 1e-6, 1.0 + 1e-6))
    assert not [f for f in rig.modes(below).findings if f.level == "error"]
    with pytest.raises(SceneError, match="jams in contact slip"):
        rig.simulate(above, 0.01)
    for scene in (below, above):
        assert rig.modes(scene).sliding.equilibrium["normal_force"] > F


def test_below_the_limit_vibration_decays_at_the_rate_of_the_effective_damper(move):
    mu = 0.5
    m, d, c = effective(mu)
    rest = (SIN - mu * COS) * F / c
    run = move("pin", {"friction.mu": mu, "start.displacement": rest + 1e-7}, step_ms=0.05, duration=0.5)
    decay, w = d / (2.0 * m), math.sqrt(c / m - (d / (2.0 * m)) ** 2)
    t = run.time
    expected = rest + 1e-7 * np.exp(-decay * t) * (np.cos(w * t) + decay / w * np.sin(w * t))
    assert run["pin_displacement"] == pytest.approx(expected, abs=1e-15)
    assert not run.motion.events()


def test_first_mode_changes_are_those_of_scipy(move, chain):
    """From the start of the scene: slip to w = 0, stick to |T| = mu N."""
    m, d, c = effective(MU)
    push = (SIN - MU * COS) * F

    def rate(stuck, t, y):
        return [y[1], 0.0 if stuck else (push - d * y[1] - c * y[0]) / m]

    def to_spare(t, y):
        normal = F - D1 * SIN * y[1] - C1 * SIN * y[0]
        return MU * normal - abs((SIN * normal - D2 * y[1] - C2 * y[0]) / COS)

    def guards(stuck):
        return [to_spare if stuck else lambda t, y: V + COS * y[1]]

    def follow(stuck, which, t, y):
        return not stuck, np.array([y[0], -V / COS])

    run = move("pin", step_ms=0.05, duration=1.12)
    found = sorted([*run.times("contact slip ends"), *run.times("contact releases +")])
    expected = chain(rate, guards, follow, False, [-1.5e-5, 0.0], 1.12)
    assert len(expected) >= 4
    assert found[: len(expected)] == pytest.approx(list(expected), abs=2e-9)


def test_the_growing_vibration_ends_in_a_cycle_that_sticks_and_stays_on_the_disc():
    cycle = rig.limit_cycle("pin")
    assert cycle.found
    assert 0.0 < cycle.stick_share["contact"] < 0.05
    assert cycle.extremes["velocity"][1] == pytest.approx(V, rel=1e-9)
    assert cycle.extremes["normal_force"][0] > 0.0
    assert abs(cycle.energy["error"]) < 1e-9
