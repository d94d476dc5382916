"""A contact that cannot open pulls as it presses, and what comes of it does not depend on where blocks begin."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rig.model import friction_law
from rig.model.assembly import Assembly
from rig.motion.motion import Motion

TICKS = 300
MASS, ALONG, ACROSS, BETWEEN = 1.0, 900.0, 1600.0, 300.0
LOAD, CONTACT = 20.0, 700.0
ROWS = [{"N:load": 1.0}, {"w:contact": 1.0}, {"T:contact": 1.0}]


def held(law, speed):
    """Mode coupling: x along the belt, z towards it; the contact is a spring that holds both ways."""
    a = Assembly("held")
    a.coordinate("x", MASS, 1.0, ALONG)
    a.coordinate("z", MASS, 1.0, ACROSS)
    a.stiffness["x", "z"] = a.stiffness["z", "x"] = BETWEEN
    a.push("z", {"one": LOAD})
    a.patch("contact", {"x": 1.0}, {"one": speed}, law)
    a.normal("load", "contact", {"one": LOAD, "z": CONTACT}, {"z": -1.0}, opens=False)
    a.start |= {"x": 0.01, "z": -0.08}
    return a.system()


def carried(system, method, block):
    motion = Motion(system, 1_000_000, method, outputs=ROWS, substeps=20, tolerance=1e-11, longest=block)
    states, outputs, events = [], [], []
    while motion.tick < TICKS:
        motion.advance(min(block, TICKS - motion.tick))
        states.append(motion.states.copy())
        outputs.append(motion.outputs_at(motion.states, motion.mode_sets_of_states))
        events += [((event.tick + event.place) * 1e-3, event.what) for event in motion.events()]
    return np.concatenate(states), np.concatenate(outputs), events, motion.energy()["error"]


@pytest.mark.parametrize("block", [7, TICKS])
@pytest.mark.parametrize(
    ("method", "law"),
    [
        ("exact", friction_law.coulomb(0.4, 0.4)),
        ("dopri5", friction_law.stribeck(0.4, 0.3, 0.5)),
        ("rk4", friction_law.stribeck(0.4, 0.3, 0.5)),
    ],
)
def test_it_moves_as_an_independent_integrator_says(method, law, block):
    speed = 5.0

    def rate(_, y):
        x, z, v, u = y
        N = LOAD + CONTACT * z
        T = law.mu(speed - v) * N
        return [v, u, (T - v - ALONG * x - BETWEEN * z) / MASS, (LOAD - N - u - ACROSS * z - BETWEEN * x) / MASS]

    found, outputs, events, error = carried(held(law, speed), method, block)
    at = 1e-3 * np.arange(1, TICKS + 1)
    true = solve_ivp(rate, (0.0, at[-1]), [0.01, -0.08, 0.0, 0.0], "DOP853", at, rtol=1e-12, atol=1e-14).y.T
    assert found[:, :4] == pytest.approx(true, abs=1e-7)
    assert not events
    assert outputs[:, 0].min() < -LOAD
    assert outputs[:, 0] == pytest.approx(LOAD + CONTACT * true[:, 1], abs=1e-4)
    assert abs(error) < 1e-7


def test_a_contact_that_sticks_and_pulls_does_so_whatever_the_block():
    system = held(friction_law.coulomb(1.0, 0.5), 0.03)
    whole, outputs, events, error = carried(system, "exact", TICKS)
    assert outputs[:, 0].min() < -LOAD
    assert {"contact slip ends", "contact releases +"} <= {what for _, what in events}
    assert np.any(outputs[:, 1] == 0.0)
    assert abs(error) < 1e-6
    for block in (1, 7):
        states, _, again, _ = carried(system, "exact", block)
        assert [what for _, what in again] == [what for _, what in events]
        assert [t for t, _ in again] == pytest.approx([t for t, _ in events], abs=1e-12)
        assert states == pytest.approx(whole, abs=1e-11)
