"""Laws with memory in the kernels: the LuGre benchmark, and the Jacobian about a state against differences."""

import math
from dataclasses import replace

import numba
import numpy as np
import pytest
from numba import types

from rig.model import friction_law
from rig.model.assembly import Assembly
from rig.model.formulation import assemble
from rig.model.friction_law import Formula, InternalState, from_formula
from rig.motion.motion import Motion
from rig.solve.records import SLIP_MINUS, SLIP_PLUS
from rig.stability.linearisation import inputs, own_law

_NUMBERS = types.CPointer(types.double)
_SIGNATURE = types.void(_NUMBERS, types.double, types.double, _NUMBERS, _NUMBERS)


@numba.cfunc(_SIGNATURE)
def lugre(p, w, N, z, out):
    g = p[4] + (p[3] - p[4]) * math.exp(-((w / p[5]) ** 2))
    out[1] = w * (1.0 - p[0] * z[0] / g)
    out[0] = p[0] * z[0] + p[1] * out[1] + p[2] * w
    out[2] = 0.5 * p[0] * z[0] ** 2 * N


@numba.cfunc(_SIGNATURE)
def lugre_slopes(p, w, N, z, out):
    fall = (p[3] - p[4]) * math.exp(-((w / p[5]) ** 2))
    g = p[4] + fall
    out[3] = 1.0 - p[0] * z[0] / g - 2.0 * w * w / p[5] ** 2 * fall * p[0] * z[0] / g**2
    out[4], out[5] = 0.0, -w * p[0] / g
    out[0], out[1], out[2] = p[1] * out[3] + p[2], 0.0, p[0] + p[1] * out[5]


def pulled():
    """Canudas de Wit et al. 1995: a body of 1 kg on a spring of 2 N/m whose end moves at 0.1 m/s."""
    state = InternalState("deflection", "m", along=True)
    formula = Formula(lugre.address, lugre_slopes.address, (state,), sticks=False)
    a = Assembly()
    a.coordinate("x", 1.0)
    a.signal("pull", {"one": 0.1}, 0.0, "spring")
    a.push("x", {"x": -2.0, "pull": 2.0})
    a.patch("contact", {"x": 1.0}, {}, from_formula(1.5, (1e5, math.sqrt(1e5), 0.4, 1.5, 1.0, 1e-3), formula))
    a.normal("load", "contact", {"one": 1.0})
    return a.system()


@pytest.mark.parametrize("method", ["dopri5", "rosenbrock"])
def test_lugre_benchmark(method):
    """x and z at 25 s."""
    motion = Motion(pulled(), 1_000_000, method, tolerance=1e-11)
    for _ in range(25):
        motion.advance(1000)
    assert motion.x[0] == pytest.approx(1.90883919923, rel=1e-8)
    assert motion.x[2] == pytest.approx(-1.18167955e-5, rel=1e-8)
    energy = motion.energy()
    assert energy["bristles"] == pytest.approx(0.5 * 1e5 * motion.x[2] ** 2, rel=1e-12)
    assert energy["error"] < 1e-9


@pytest.mark.parametrize("mode", [SLIP_PLUS, SLIP_MINUS])
def test_slopes_of_inputs_are_differences_of_inputs(mode, input_slopes):
    system = pulled()
    modes = assemble(system, system.key([mode], [0], []))
    sign = 1.0 if mode == SLIP_PLUS else -1.0
    x = np.array([0.1, -sign * 2e-3, sign * 7e-6, 1.0, 0.3])
    _, slopes = inputs(system, modes, x, own_law(system, modes))
    assert input_slopes(system, modes.key, x) == pytest.approx(slopes, rel=1e-12, abs=1e-12)
    for i, step in enumerate(1e-6 * np.array([0.1, 1e-3, 1e-5, 1.0, 1.0])):
        ahead, behind = (inputs(system, modes, x + s * step * np.eye(5)[i], own_law(system, modes))[0] for s in (1, -1))
        assert (ahead - behind) / (2.0 * step) == pytest.approx(slopes[:, i], rel=1e-7, abs=1e-9)


def test_each_direction_of_slip_has_its_own_coefficient():
    """A body on a spring: each half cycle loses 2 mu N / k of its amplitude, with the mu of its direction.

    Moving back it slips forward (0.2), moving on backward (0.4). At -0.07 m the spring pulls 7 N: it sticks, since
    backward 8 N are needed, forward 2 N.
    """
    a = Assembly()
    a.coordinate("x", 1.0, 0.0, 100.0)
    a.start["x"] = 0.23
    law = replace(friction_law.coulomb(0.2, 0.2), backward=friction_law.coulomb(0.8, 0.4))
    a.patch("contact", {"x": 1.0}, {}, law)
    a.normal("load", "contact", {"one": 10.0})
    motion = Motion(a.system(), 1_000_000, "exact")
    turns = []
    for _ in range(2000):
        motion.advance(1)
        turns += [motion.x[0]] if motion.event_count else []
    assert turns[:2] == pytest.approx([-0.23 + 0.04, 0.19 - 0.08], abs=1e-4)  # at the end of the tick
    assert motion.x[0] == pytest.approx(-0.11 + 0.04, abs=1e-12)
    assert motion.system.describe(motion.key) == "contact stick"
