"""The plant on its own between two ticks: whatever the stiffness of its modes, the exponential of its matrix."""

import numpy as np
import pytest
from scipy.linalg import expm

from rig import scenes
from rig.bench.free_rig import FreeRig


@pytest.mark.parametrize("ticks", [-0.4, 0.03, 0.77, 3.4, 40.6])
@pytest.mark.parametrize("name", ["belt_c", "belt_shunt", "brake"])
def test_a_linear_motion_is_the_exponential_of_its_matrix(name, ticks):
    rig = FreeRig(scenes.load(name))
    x = rig.settled.copy()
    x[rig.moving] += 1e-3 * np.arange(1.0, len(rig.moving) + 1.0)
    time = ticks * rig.step
    wanted = expm(rig.modes(rig.key).A * time) @ x
    for _ in range(2):
        assert rig.within(x, rig.key, time) == pytest.approx(wanted, rel=1e-11, abs=1e-12 * np.abs(wanted).max())


def test_a_body_that_no_spring_holds_moves_on():
    """Every eigenvalue of its matrix is zero: no mode says how long a step may be."""
    rig = FreeRig(scenes.load("belt_c", {"body.stiffness": "0 N/m"}))
    x = rig.settled.copy()
    x[:2] = 0.5, 0.1
    gains = rig.rate(x, rig.key)[1]  # by the friction of the belt that slips past it
    assert gains != 0.0
    assert rig.within(x, rig.key, 0.2)[:2] == pytest.approx([0.52 + 0.02 * gains, 0.1 + 0.2 * gains])
