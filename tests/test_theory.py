"""The pages of docs/theory: closed forms that they state, evaluated against the program."""

import math

import numpy as np
import pytest

import rig
from rig.analysis.cycles.cycle import limit_cycle
from rig.model.formulation import assemble
from rig.solve.records import STICK


def growth(scene, changes):
    return max(mode.growth for mode in rig.modes(rig.load(scene, changes)).sliding.modes)


def test_the_landing_projection_is_mass_weighted():
    """eq-landing, on a rig whose mass matrix is not diagonal."""
    system = rig.load("belt_tuned_mass").assemble().system()
    nq = len(system.coordinates)
    direction = np.array([patch.direction for patch in system.patches]).T
    pushed = np.linalg.solve(system.mass, direction)
    own = -system.slip_rows[:, nq : 2 * nq]
    expected = np.eye(system.n)
    expected[nq : 2 * nq] += pushed @ np.linalg.solve(own @ pushed, system.slip_rows)
    landing = assemble(system, system.key([STICK], [0], [])).landing
    assert landing == pytest.approx(expected, abs=1e-15)
    assert np.abs(system.slip_rows @ landing).max() < 1e-15
    assert not np.allclose(landing[nq + 1], np.eye(system.n)[nq + 1])  # the absorber takes part


def test_cycle_of_the_mass_on_a_belt_with_coulomb_friction():
    """eq-belt-cycle."""
    scene = rig.load("belt_c")
    p = scene.parameters
    assert p.body.damping == 0.0
    omega, v = math.sqrt(p.body.stiffness / p.body.mass), p.drive.speed
    a = (p.friction.mu_static - p.friction.mu_kinetic) * p.load.force / p.body.stiffness
    b = v / omega
    stick, slip = 2.0 * a / v, (2.0 * math.pi - 2.0 * math.atan(a / b)) / omega
    cycle = limit_cycle(scene)
    assert cycle.stick_time["contact"] == pytest.approx(stick, rel=1e-12)
    assert cycle.period == pytest.approx(stick + slip, rel=1e-12)
    reach = math.hypot(a, b)
    assert min(cycle.extremes["velocity"]) == pytest.approx(-omega * reach, rel=1e-9)
    top = p.friction.mu_kinetic * p.load.force / p.body.stiffness + reach
    assert max(cycle.extremes["displacement"]) == pytest.approx(top, rel=1e-9)


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_a_tread_block_flutters_beyond_the_coalescence(share):
    """eq-tread-flutter."""
    free = {"tip.tangential_damping": 0.0, "tip.normal_damping": 0.0}
    p = rig.load("tread", free).parameters
    cx, cz, cxz, cc = p.tip.tangential_stiffness, p.tip.normal_stiffness, p.tip.coupling, p.contact.stiffness
    critical = ((cx - cz - cc) ** 2 / (4.0 * cxz) + cxz) / cc
    found = growth("tread", free | {"friction.law": "constant", "friction.mu": share * critical})
    assert (found > 1e-3) == (share > 1.0)


def test_a_tip_in_sliding_is_stiffer_and_pressed_less():
    """eq-tip-sliding."""
    changes = {"friction.law": "constant", "friction.mu": 0.3, "tip.damping": 0.0, "tip.retardation": 0.0}
    changes |= {"waviness": "none", "drive.speed": 0.1}
    scene = rig.load("tip", changes)
    tip, mu = scene.parameters.at_fixed_height, 0.3
    assert tip.relief > 0.0
    (mode,) = rig.modes(scene).sliding.modes
    omega = math.sqrt((1.0 + tip.relief * mu) * tip.stiffness / tip.mass)
    assert 2.0 * math.pi * mode.frequency == pytest.approx(omega, rel=1e-9)
