"""A brake disc that bends, in place of the rigid one: the limit of a stiff plate, the squeal."""

import numpy as np
import pytest
from scipy.optimize import brentq

import rig
from rig.effects.disc_modes import free_modes

DISC = {
    "inner_radius": 0.07,
    "outer_radius": 0.14,
    "thickness": 0.012,
    "density": 7200.0,
    "modulus": 1.2e11,
    "poisson": 0.25,
}
PLATE = {f"disc_modes.{key}": value for key, value in DISC.items()}


def motions(changes):
    return rig.modes(rig.load("brake", changes)).sliding.modes


def test_a_plate_too_stiff_to_bend_is_a_rigid_disc_held_fast():
    stiff = motions(PLATE | {"disc_modes.thickness": 2.0})
    fast = motions({"springs.disc_z.stiffness": 1e13, "springs.disc_phi.stiffness": 1e10})
    got, expected = (sorted((m.frequency, m.growth) for m in found if m.frequency < 12e3) for found in (stiff, fast))
    assert np.array(got) == pytest.approx(np.array(expected), rel=1e-4)


@pytest.mark.parametrize("scale", [1.0, 1.7])
def test_the_frequencies_and_the_damping_of_the_ring_are_those_of_its_data(scale):
    scene = rig.load("brake_disc_modes", {"structure.scale": scale, "disc_modes.damping_ratio": 0.01})
    a = scene.assemble()
    for mode in free_modes(scene.parameters.disc_modes):
        for part in "CS" if mode.pair else "C":
            assert np.sqrt(a.stiffness[(f"disc.{part}{mode.diameters}",) * 2]) == pytest.approx(mode.omega)
            assert a.damping[(f"disc.{part}{mode.diameters}",) * 2] > 2.0 * 0.01 * mode.omega * (1.0 - 1e-12)


def test_squeal_shifts_with_the_modes_of_the_disc():
    """From 0.640 at 2140 Hz to 0.933 at 2686 Hz: another pair of motions couples first."""

    def least_stable(mu):
        return rig.modes(rig.load("brake_disc_modes", {"friction.mu": mu})).sliding.modes[0]

    assert motions({"friction.mu": 0.7})[0].growth > 0.0
    assert least_stable(0.7).growth < 0.0
    found = brentq(lambda mu: least_stable(mu).growth, 0.8, 1.1, xtol=1e-6)
    assert found == pytest.approx(0.93293, abs=1e-5)
    assert least_stable(found).frequency == pytest.approx(2685.64, abs=0.01)
