"""Products: what is not linear in the state, against independent integrators and finite differences."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rig.model import friction_law
from rig.model.assembly import Assembly
from rig.model.formulation import assemble
from rig.motion.motion import Motion
from rig.stability.linearisation import inputs, own_law, sliding_key, steady

MS = 1_000_000


def duffing():
    a = Assembly("duffing")
    a.coordinate("x", 2.0, 0.1, 8.0)
    a.product("x^3", "x", "x", "x")
    a.push("x", {"x^3": -5.0, "one": 3.0})
    a.start |= {"x": 1.5}
    return a


STRIBECK = friction_law.stribeck(0.4, 0.25, 0.1)


def sliding(mu=STRIBECK, travel=None):
    """Two coordinates, a belt, a normal force that bends with the place; products of every level."""
    a = Assembly("bent")
    a.coordinate("x", 1.0, 0.3, 100.0)
    a.coordinate("z", 0.5, 0.4, 400.0)
    a.product("xz", "x", "z")
    a.product("bend", ("cos-1", {"x": 8.0}))
    a.product("N sin", "N:load", ("sin", {"x": 8.0}))
    a.product("T cos", "T:contact", ("cos-1", {"x": 8.0}))
    a.product("T", "T:contact")
    a.patch("contact", {"x": 1.0}, {"one": 0.3}, mu, travel)
    a.normal("load", "contact", {"one": 10.0, "z": -60.0, "xz": 40.0, "bend": 2.0}, {"z": 1.0})
    a.push("z", {"N sin": 0.2, "T cos": 0.5, "T": 0.05, "one": -10.0})
    a.push("x", {"xz": -3.0})
    a.start |= {"x": 0.02, "z": 0.01}
    return a


def advance(system, method, ticks, rows, **settings):
    motion = Motion(system, MS, method, outputs=rows, **settings)
    motion.advance(ticks)
    return motion, motion.outputs_at(motion.states, motion.mode_sets_of_states)


@pytest.mark.parametrize(
    ("method", "settings", "bound"),
    [
        ("dopri5", {"tolerance": 1e-10}, 1e-8),
        ("dop853", {"tolerance": 1e-10}, 1e-8),
        ("rosenbrock", {"tolerance": 1e-10}, 1e-8),
        ("rk4", {"substeps": 4}, 1e-9),
    ],
)
def test_a_cubic_spring_moves_as_an_independent_integrator_says(method, settings, bound):
    motion, found = advance(duffing().system(), method, 5000, [{"x": 1.0}, {"x''": 1.0}, {"x^3": 1.0}], **settings)

    def rate(_, y):
        return [y[1], (3.0 - 0.1 * y[1] - 8.0 * y[0] - 5.0 * y[0] ** 3) / 2.0]

    end = solve_ivp(rate, (0.0, 5.0), [1.5, 0.0], method="DOP853", rtol=1e-12, atol=1e-13)
    x = end.y[0, -1]
    assert found[-1] == pytest.approx([x, rate(0.0, end.y[:, -1])[1], x**3], abs=bound)
    assert abs(motion.energy()["error"]) < 1e-8


def bent_rate(y):
    x, z, v, u = y
    N = 10.0 - 60.0 * z + 40.0 * x * z + 2.0 * (np.cos(8.0 * x) - 1.0)
    T = (0.25 + 0.15 * np.exp(-(0.3 - v) / 0.1)) * N
    a = T - 3.0 * x * z - 100.0 * x - 0.3 * v
    c = N + 0.2 * N * np.sin(8.0 * x) + 0.5 * T * (np.cos(8.0 * x) - 1.0) + 0.05 * T - 10.0 - 400.0 * z - 0.4 * u
    return np.array([v, u, a, c / 0.5])


@pytest.mark.parametrize("method", ["dopri5", "dop853"])
def test_products_of_forces_move_as_an_independent_integrator_says(method):
    rows = [{"x": 1.0}, {"z": 1.0}, {"N:load": 1.0}, {"T:contact": 1.0}]
    motion, found = advance(sliding().system(), method, 150, rows, tolerance=1e-11)
    assert not motion.events()
    end = solve_ivp(
        lambda t, y: bent_rate(y), (0.0, 0.15), [0.02, 0.01, 0.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-14
    )
    x, z, v, _ = end.y[:, -1]
    N = 10.0 - 60.0 * z + 40.0 * x * z + 2.0 * (np.cos(8.0 * x) - 1.0)
    T = (0.25 + 0.15 * np.exp(-(0.3 - v) / 0.1)) * N
    assert found[-1] == pytest.approx([x, z, N, T], abs=1e-8)


def test_the_linearisation_is_the_slope_of_the_equations():
    system = sliding().system()
    modes = assemble(system, sliding_key(system))
    x = np.array([0.03, 0.012, 0.02, -0.01, 1.0])
    T, dT = inputs(system, modes, x, own_law(system, modes))
    assert modes.A[2:4] @ x + modes.b[2:4] @ T == pytest.approx(bent_rate(x[:4])[2:], rel=1e-12)
    slopes = modes.A + modes.b @ dT
    for j in range(4):
        h = 1e-6 * np.eye(5)[j]
        difference = (bent_rate((x + h)[:4]) - bent_rate((x - h)[:4])) / 2e-6
        assert slopes[:4, j] == pytest.approx(difference, rel=1e-7, abs=1e-6)


def test_steady_sliding_is_where_the_equations_rest():
    at = steady(sliding().system(), sliding_key(sliding().system()))
    assert at.exists
    assert np.abs(bent_rate(at.x[:4])).max() < 1e-9


def test_stick_sticks_where_the_equations_bend():
    a = sliding(friction_law.coulomb(0.9, 0.5))
    a.start |= {"x'": 0.3}
    motion, found = advance(a.system(), "dopri5", 60, [{"x": 1.0}, {"x'": 1.0}, {"T:contact": 1.0}, {"N:load": 1.0}])
    stuck = [
        i
        for i, mode_set in enumerate(motion.mode_sets_of_states)
        if "stick" in motion.system.describe(motion.mode_sets.sets[mode_set].key)
    ]
    assert len(stuck) > 20
    assert np.all(found[stuck, 1] == 0.3)
    assert np.all(np.abs(found[stuck, 2]) <= 0.9 * found[stuck, 3] * (1.0 + 1e-9))
    assert found[stuck[-1], 0] == pytest.approx(0.02 + 0.3e-3 * (stuck[-1] + 1), rel=1e-9)
    assert abs(motion.energy()["error"]) < 1e-6


def test_a_stuck_contact_may_not_need_its_own_force():
    a = sliding(friction_law.coulomb(0.9, 0.5))
    a.push("x", {"T cos": 1.0})
    a.start |= {"x'": 0.3}
    with pytest.raises(ValueError, match="T cos: it has a friction force as a factor, so no stuck contact may"):
        Motion(a.system(), MS, "dopri5")


def test_friction_may_act_along_more_than_the_slip_speed_counts():
    a = sliding(travel={"x": 1.0})
    a.patches[0] = ("contact", {"x": 1.0, "z": 0.05}, *a.patches[0][2:])
    a.force["z"].pop("T")
    rows = [{"x": 1.0}, {"z": 1.0}, {"w:contact": 1.0}, {"x'": 1.0}]
    motion, found = advance(a.system(), "dopri5", 150, rows, tolerance=1e-11)
    end = solve_ivp(
        lambda t, y: bent_rate(y), (0.0, 0.15), [0.02, 0.01, 0.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-14
    )
    assert found[-1, :2] == pytest.approx(end.y[:2, -1], abs=1e-9)
    assert found[:, 2] == pytest.approx(0.3 - found[:, 3], abs=1e-15)
    assert abs(motion.energy()["error"]) < 1e-8
