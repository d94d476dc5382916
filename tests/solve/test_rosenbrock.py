"""The implicit steps: order and stability of the tables, the exact Jacobian, motions that dopri5 agrees with."""

import numpy as np
import pytest

from rig.model import friction_law
from rig.motion.motion import Motion
from rig.scenes import load
from rig.solve import rosenbrock

PRODUCTS = np.linalg.inv(np.eye(8) / rosenbrock.GAMMA - rosenbrock.C)  # Gamma; A and b in terms of k = Gamma^-1 u
ALPHA = rosenbrock.A @ PRODUCTS
BETA = ALPHA + PRODUCTS
WEIGHTS = np.append(rosenbrock.A[7, :7], 1.0)
"""Of u at the end of the step."""


def trees(order):
    """Rooted trees of `order` vertices: tuples of their subtrees."""
    if order == 1:
        return [()]

    def forests(left, largest):
        if left == 0:
            yield ()
        for size in range(min(left, largest), 0, -1):
            for tree in trees(size):
                for rest in forests(left - size, size):
                    if not rest or (size, tree) >= (vertices(rest[0]), rest[0]):
                        yield (tree, *rest)

    return list(dict.fromkeys(forests(order - 1, order - 1)))


def vertices(tree):
    return 1 + sum(map(vertices, tree))


def density(tree):
    return vertices(tree) * int(np.prod([density(branch) for branch in tree]))


def elementary(tree):
    """The weight of a tree in each stage: one branch goes through beta, several through alpha."""
    rows = BETA if len(tree) == 1 else ALPHA
    return np.prod([rows @ elementary(branch) for branch in tree], axis=0) * np.ones(8)


@pytest.mark.parametrize("order", range(1, 6))
def test_the_tables_satisfy_the_order_conditions(order):
    assert len(trees(order)) == (1, 1, 2, 4, 9)[order - 1]
    ends = [(WEIGHTS, 1.0)]
    if order < 5:
        ends.append((np.append(WEIGHTS[:7], 0.0), 1.0))  # the embedded method
        for place in (0.1, 0.5, 0.8):
            inside = np.array([1.0, place, place * place]) @ rosenbrock.DENSE
            ends.append((place * (WEIGHTS + (1.0 - place) * inside), place))
    for weights, place in ends:
        for tree in trees(order):
            value = weights @ PRODUCTS @ elementary(tree)
            assert value == pytest.approx(place**order / density(tree), abs=1e-13)


def test_the_method_is_l_stable():
    def growth(z):
        return 1.0 + z * WEIGHTS @ PRODUCTS @ np.linalg.solve(np.eye(8) - z * BETA, np.ones(8))

    assert abs(growth(-1e9)) < 1e-6
    assert np.abs(growth(-1e-3) - np.exp(-1e-3)) < 1e-14
    assert max(abs(growth(1j * omega)) for omega in np.geomspace(1e-2, 1e6, 400)) <= 1.0 + 1e-12


STRIBECK = friction_law.stribeck(0.4, 0.25, 0.05)


def swinging(products):
    """A mass that slides all the time under a falling law; with products, over a bumpy ground."""

    def build(rigs):
        load = {"one": 20.0, "wave": 4.0} if products else {"one": 20.0}
        law = STRIBECK if products else friction_law.smoothed(STRIBECK, 0.02)
        a = rigs.oscillator(law=law, load=load, start={"x": 0.0025, "x'": 0.01}, vb=0.4, c=1.0)
        if products:
            a.product("wave", ("cos-1", {"x": 200.0}), "x'")
        return a.system()

    return build


@pytest.mark.parametrize("products", [False, True])
def test_the_error_falls_as_the_fifth_power_of_the_step(rigs, run, products):
    """In smooth motion; the end of the run cuts one step only."""
    system = swinging(products)(rigs)
    exact = run(system, 100.0, 0.5, "dopri5", tolerance=1e-13)
    assert len(exact.times) == 0
    steps, errors = [], []
    for tolerance in 10.0 ** -np.arange(8.0, 12.0):
        found = run(system, 500.0, 0.5, "rosenbrock", tolerance=tolerance)
        steps.append(0.5 / found.motion.counts()["trial_steps"])
        errors.append(np.abs(found.states[-1] - exact.states[-1]).max())
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(5.0, abs=0.6)


SCENES = ("belt", "belt_dither", "disc_slider", "lever", "four_dof")


def seen(scene, method, tolerance, ticks=300, **values):
    scene = load(scene, values)
    motion = Motion(scene.assemble().system(), scene.step_ns, method, tolerance=tolerance, longest=ticks)
    motion.advance(ticks)
    return motion, motion.events()


@pytest.mark.parametrize("name", SCENES)
def test_scenes_move_as_with_dopri5(name):
    (found, events), (expected, others) = (seen(name, method, 1e-9, 1000) for method in ("rosenbrock", "dopri5"))
    assert [e.what for e in events] == [e.what for e in others]
    times = np.array([[a.tick + a.place, b.tick + b.place] for a, b in zip(events, others)]).reshape(-1, 2)
    assert np.abs(times[:, 0] - times[:, 1]).max(initial=0.0) < 1e-4
    assert found.states == pytest.approx(expected.states, abs=1e-6 * np.abs(expected.states).max())
    assert abs(found.energy()["error"]) < 1e-6


@pytest.mark.parametrize(
    "values",
    [
        {"load.lag": 1e-9},
        {"drive.lag": 1e-9},
        {"body.damping": 1e9},
    ],
)
def test_what_is_stiff_needs_no_short_steps(values):
    found, events = seen("belt", "rosenbrock", 1e-7, 300, **values)
    expected, others = seen("belt", "dopri5", 1e-7, 300, **values)
    assert found.counts()["trial_steps"] < 2000
    assert [e.what for e in events] == [e.what for e in others]
    assert found.x == pytest.approx(expected.x, rel=1e-5, abs=1e-9)
    assert abs(found.energy()["error"]) < 1e-6
