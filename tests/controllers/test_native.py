"""Compiled control laws: the bits of Python, or no compiling at all; what a law may and may not contain."""

import cmath
import math
import random
from functools import partial
from typing import NamedTuple

import numpy as np
import pytest

import rig
from rig import controllers
from rig.controllers.blocks.base import mapped
from rig.controllers.lti import LTI
from rig.controllers.runtime.native import Native, Uncompiled
from rig.design import numbers

SHIPPED = ("belt_velocity_feedback", "belt_dither_controlled", "brake_active")  # more in tests/loop/test_inside.py


def of_scene(name):
    """The only controller of a shipped scene."""
    scene = rig.load(name)
    ((key, section),) = scene.controllers.items()
    return controllers.build(section, numbers(scene)[key])


def compared(controller, count=500, size=0.05):
    """Have Python and the compiled code answer the same measurements; how many answers agree to the last bit."""
    draw, period = random.Random(1), controller.period_ns
    state, command = controller.update(controller.start(), 0, tuple(0.01 for _ in controller.reads))
    native, agreed, t_ns = Native(controller, state), 0, period
    for k in range(count):
        values = tuple(size * draw.gauss(0.0, 1.0) for _ in controller.reads)
        assert native.resume(controller, state)
        state, command = controller.update(state, t_ns, values)
        agreed += native.reproduces(t_ns, values, command, state)
        t_ns += 4 * period if k % 100 == 99 else period  # a sample may be missing
    return agreed


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_controller_gives_the_bits_of_python(name):
    assert compared(of_scene(name)) == 500


def test_a_linear_system_gives_the_bits_of_python_at_its_limits_too():
    draw, states = np.random.default_rng(3), 3
    a = draw.normal(size=(states, states))
    shapes = {"B": (states, 2), "C": (2, states), "D": (2, 2)}
    matrices = {name: draw.normal(size=shape).tolist() for name, shape in shapes.items()}
    matrices["A"] = (0.95 * a / abs(np.linalg.eigvals(a)).max()).tolist()
    keys = {"reads": ["a", "b"], "drives": ["u", "v"], "lowest": -0.05, "highest": 0.1}
    assert compared(controllers.build(LTI.model_validate({"kind": "lti", **matrices, **keys}), {})) == 500


class Kept(NamedTuple):
    """State."""

    z: tuple[complex, complex] = (0j, 0j)
    count: int = 0
    last: float = math.inf
    best: float = -1.0


class Constants(NamedTuple):
    """Constants with parts."""

    weights: tuple[float, ...] = (0.3, 0.7)
    poles: tuple[complex, ...] = (0.9 + 0.1j, 0.5 - 0.2j)
    high: float = 1.0
    wide: bool = True


LEVEL = 0.5


def clip(u, low, high):
    return low if u < low else high if u > high else u


def turned(pole, z, b):
    return pole * z + b


def law(p, state, t_ns, values):
    """What users write: parts, tuples, constants, conditions, functions of the module."""
    gain = 2.0
    a, b = values
    total = 0.0
    for weight, entry in zip(p.weights, (a, b)):
        total += weight * entry
    z = mapped(state.z, turned, (b,), p.poles, state.z)
    count = state.count + 1 if p.wide and t_ns % 3_000_000 else state.count // 2
    u = clip(gain * total + z[0].real, -p.high, p.high) * LEVEL
    return Kept(z, count, u, state.best), (u + cmath.phase(z[1]) + math.exp(-abs(u)),)


class Plain:
    """A controller with a law."""

    reads, drives, period_ns = ("a", "b"), ("x",), 1_000_000

    def __init__(self, law=law):
        self.update = partial(law, Constants())

    def start(self):
        return Kept()


def test_what_users_write_is_compiled():
    assert compared(Plain(), size=1.0) == 500


def with_sum(p, state, t_ns, values):
    return state, (sum(values),)


def with_growing_state(p, state, t_ns, values):
    return (state, 1.0), (values[0],)


def with_a_hidden_power(p, state, t_ns, values):
    return state, (squared(values[0]),)


def squared(v):
    return pow(v, 2)


REFUSED = [with_sum, with_growing_state, with_a_hidden_power]


@pytest.mark.parametrize("law", REFUSED, ids=lambda law: law.__name__)
def test_what_could_round_or_behave_in_another_way_is_left_to_python(law):
    with pytest.raises(Uncompiled, match=r"\S"):
        Native(Plain(law), Kept())


def divides(p, state, t_ns, values):
    return state, (values[0] / values[1],)


@pytest.mark.parametrize("values", [(1.0, 0.0), (math.nan, 1.0), (1e300, 1e-300)])
def test_it_declines_where_python_would_raise_or_a_value_is_not_finite(values):
    controller = Plain(divides)
    native = Native(controller, Kept())
    assert native.resume(controller, Kept())
    before = native.memory.tobytes()
    assert not native.reproduces(0, values, (0.0,), Kept())
    assert native.memory.tobytes() == before
    assert native.reproduces(0, (1.0, 4.0), (0.25,), Kept())
