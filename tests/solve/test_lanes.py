"""Eight instants at once: the same bits as one after the other, for every friction law and with products."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import rig
from rig.bench.run.runner import PlantRunner
from rig.compiled.kernel import kernel
from rig.model import friction_law
from rig.motion.motion import Motion
from rig.solve.column_blocks import LANE
from rig.solve.expm import exponential_factors
from tests.solve.conftest import oscillator

LAWS = {
    "coulomb": friction_law.coulomb(0.5, 0.3),
    "stribeck": friction_law.stribeck(0.5, 0.2, 0.05),
    "falling": friction_law.falling(0.5, 0.4, 0.1),
    "seal": friction_law.seal(0.3, 2.0, 0.1, 0.01),
    "table": friction_law.table(np.array([0.0, 0.1, 0.5]), np.array([0.4, 0.3, 0.2]), 0.5),
    "smoothed": friction_law.smoothed(friction_law.stribeck(0.5, 0.2, 0.05), 1e-3),
}


@kernel
def _product(u):
    coarse, fine = exponential_factors(u)
    return coarse * fine


@given(st.floats(-800.0, 800.0))
def test_the_factors_come_to_the_exponential_within_two_units_in_the_last_place(u):
    with np.errstate(over="ignore", under="ignore"):
        expected = float(np.exp(u))
    assert _product(u) == expected or abs(_product(u) - expected) <= 2.0 * np.spacing(expected)


def _one_by_one(motion, states, mode_sets):
    return np.concatenate([motion.outputs_at(x[None], s[None]) for x, s in zip(states, mode_sets)])


@pytest.mark.parametrize("name", LAWS)
def test_outputs_of_many_states_are_those_of_each(name):
    """The states reach far beyond the motion: there the exponential of the law leaves its table."""
    rows = [{"x": 1.0}, {"T:contact": 1.0}, {"T:contact": 0.2, "x'": 3.0}]
    motion = Motion(oscillator(law=LAWS[name]).system(), 1_000_000, "dopri5", outputs=rows, longest=600)
    motion.advance(600)
    states = np.concatenate([motion.states, motion.states * [1.0, 1e3, 1.0]])
    mode_sets = np.concatenate([motion.mode_sets_of_states] * 2)
    found = motion.outputs_at(states, mode_sets)
    assert len(set(mode_sets.tolist())) > 1 or name == "smoothed", "stick and slip"
    assert np.ascontiguousarray(found).tobytes() == _one_by_one(motion, states, mode_sets).tobytes()


@pytest.mark.parametrize("name", ["four_dof", "lever", "disc_slider", "belt_shunt", "plate"])
def test_outputs_of_rigs_with_several_contacts_or_products(name):
    motion = PlantRunner(rig.load(name), piece=40).motion
    motion.advance(min(40, len(motion.log.out)), keep=False)
    states, mode_sets = motion.states, motion.mode_sets_of_states
    found = np.ascontiguousarray(motion.outputs_at(states, mode_sets))
    assert len(states) >= 2 * LANE
    assert found.tobytes() == _one_by_one(motion, states, mode_sets).tobytes()


@pytest.mark.parametrize("method", ["dopri5", "dop853"])
def test_the_energy_closes_while_a_contact_moves_far_round_a_disc(method):
    """Sines of angles beyond 0.8 rad are the library's, one after the other and in the lanes that are needed."""
    run = rig.simulate(rig.load("disc_slider_a", {"clock.method": method, "clock.tolerance": 1e-7}), 0.5)
    assert np.ptp(run.signals["angle"]) > 0.8
    assert run.energy["error"] < 1e-4
