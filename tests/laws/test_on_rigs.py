"""Laws with memory on a rig, against closed solutions and independent integrations."""

import math
from itertools import pairwise

import friction_oracles as oracles
import numpy as np
import pytest

import rig
from rig.motion.motion import Motion

RATE = {"mu_reference": 0.6, "speed": 1e-6, "a": 0.01, "b": 0.015, "distance": 1e-5}
HELD = """
format = 1
plant = "belt"
[body] # so heavy, for its load, that it does not move: the belt prescribes the slip
mass = 1e6
stiffness = 0
[load]
force = 1e-11
[drive]
speed = 0
[clock]
tolerance = 1e-12
"""


@pytest.fixture
def scene(tmp_path):
    """A scene from TOML `text`, with a friction law and protocol steps as dictionaries."""

    def make(text, friction, steps=(), **changes):
        tables = "\n".join(f"{key} = {_toml(value)}" for key, value in friction.items())
        protocol = "".join(
            "\n[[protocol]]\n" + "\n".join(f"{key} = {_toml(value)}" for key, value in step.items()) for step in steps
        )
        file = tmp_path / "scene.toml"
        file.write_text(f"{text}\n[friction]\n{tables}\n{protocol}\n")
        return rig.load(str(file), changes)

    return make


def _toml(value):
    return f'"{value}"' if isinstance(value, str) else repr(value)


def test_a_pulled_mass_with_lugre_friction(scene):
    """The frame of the spring's end: the ground moves at -0.1 m/s; here mirrored."""
    text = """
format = 1
plant = "belt"
[body]
mass = 1
stiffness = 2
[drive]
speed = 0.1
[load]
force = 1
[start]
velocity = 0.1
[clock]
tolerance = 1e-11
"""
    law = {
        "law": "lugre",
        "load": "1 N",
        "mu_static": "1.5 N",
        "mu_kinetic": "1 N",
        "speed_scale": 1e-3,
        "sigma0": "1e5 N/m",
        "sigma1": math.sqrt(1e5),
        "sigma2": 0.4,
    }
    signals = rig.simulate(scene(text, law), 25.0).signals
    assert 2.5 - signals["displacement"][-1] == pytest.approx(oracles.LUGRE_PULLED["x"], rel=1e-8)
    assert 0.1 - signals["velocity"][-1] == pytest.approx(oracles.LUGRE_PULLED["v"], rel=1e-7)
    assert signals["contact_deflection"][-1] == pytest.approx(oracles.LUGRE_PULLED["z"], rel=1e-8)


TURNS = [0.0, 2e-5, -1e-5, 4e-6, 1e-6, 3e-5, -3e-5]
"""Points between which the belt moves, each in 0.2 s [m]."""


def ramps(turns):
    """Protocol steps: the speed rises and falls linearly on the way to each point."""
    for begin, end in pairwise(turns):
        for to in ((end - begin) / 0.1, 0.0):
            yield {"step": "ramp", "target": "drive.speed", "to": to, "over": 0.1}


def shares(steps):
    """Shares of the way after each of `steps` equal times of such a motion."""
    t = np.linspace(0.0, 1.0, steps + 1)
    return np.where(t <= 0.5, 2.0 * t**2, 1.0 - 2.0 * (1.0 - t) ** 2)


@pytest.mark.parametrize(
    ("law", "loop"),
    [
        ({"law": "dahl", "mu_kinetic": 0.4, "sigma0": 1e5}, lambda at: oracles.dahl(TURNS, at, 1e5, 0.4, 1.0)),
        (
            {"law": "dahl", "mu_kinetic": 0.4, "sigma0": 1e5, "exponent": 2.5},
            lambda at: oracles.dahl(TURNS, at, 1e5, 0.4, 2.5),
        ),
        (
            {
                "law": "maxwell_slip",
                "mu_static": 0.3,
                "mu_kinetic": 0.3,
                "speed_scale": 1.0,
                "transition": 0.01,
                "stiffness": [1e5, 4e4, 1e4],
                "shares": [0.5, 0.3, 0.2],
            },
            lambda at: (
                0.0,
                sum(oracles.elements(TURNS, at, k, 0.3 * a, 0.01)[1] for k, a in ((1e5, 0.5), (4e4, 0.3), (1e4, 0.2))),
            ),
        ),
    ],
    ids=["dahl", "dahl of exponent 2.5", "maxwell"],
)
def test_loops_are_the_closed_solution(scene, law, loop):
    run = rig.simulate(scene(HELD, law, ramps(TURNS)), 0.2 * (len(TURNS) - 1))
    _, force = loop(shares(200))
    once = np.delete(force, np.arange(201, len(force), 201))  # a turn ends one leg and begins the next
    mu = run.signals["friction_force"] / 1e-11
    np.testing.assert_allclose(mu, once, atol=1e-9, rtol=0.0)


@pytest.mark.parametrize("speed", [0.0, 1e-8, 1e-5, 1e-3])
def test_steps_of_the_speed_follow_the_closed_solution_of_the_ageing_law(scene, speed):
    before, begin = 2e-6, 4.0
    steps = [
        {"step": "hold", "time": begin},
        {"step": "set", "target": "drive.speed", "to": speed},
        {"step": "hold", "time": 4.0},
    ]
    run = rig.simulate(scene(HELD, {"law": "rate_state", **RATE}, steps, **{"drive.speed": before}), begin + 4.0)
    first = np.searchsorted(run.time, begin)
    start = oracles.aged(0.0, before, np.array([begin]), RATE["speed"], RATE["distance"])[0]
    psi = oracles.aged(start, speed, run.time[first:] - begin, RATE["speed"], RATE["distance"])
    np.testing.assert_allclose(run.signals["contact_state"][first:], psi, atol=1e-9, rtol=0.0)


SPRING = """
format = 1
plant = "belt"
[body]
mass = 2
stiffness = 1
[load]
force = 30
[drive]
speed = 1e-3
[clock]
unstable = "run"
"""


@pytest.mark.parametrize("evolution", ["ageing", "slip"])
@pytest.mark.parametrize(("belt", "displacement"), [(1e-3, 3.3e-3), (0.0, 8e-3)])
def test_slip_begins_and_reverses_at_zero_where_friction_is_steep(evolution, belt, displacement):
    """Without a belt the mass swings back and creeps: the slip reverses."""
    values = {"drive.speed": belt, "start.velocity": belt, "start.displacement": displacement}
    run = rig.simulate(rig.load("belt_rate_state", values | {"friction.evolution": evolution}), 0.3)
    x, v = oracles.released(belt, displacement, 0.3, evolution)
    assert run.signals["displacement"][-1] == pytest.approx(x, abs=1e-7 * np.abs(run.signals["displacement"]).max())
    assert run.signals["velocity"][-1] == pytest.approx(v, abs=1e-6 * np.abs(run.signals["velocity"]).max())
    assert abs(run.energy["error"]) < 1e-8


@pytest.mark.parametrize("evolution", ["ageing", "slip"])
@pytest.mark.parametrize("speed", [1e-6, 1e-3, 0.1])
def test_steady_slip_loses_stability_at_the_critical_stiffness(scene, evolution, speed):
    stiffness, frequency = oracles.critical_stiffness(2.0, 30.0, RATE["a"], RATE["b"], RATE["distance"], speed)
    law = {"law": "rate_state", **RATE, "evolution": evolution}
    growths = []
    for factor in (1.0, 1.01, 0.99):
        changes = {"drive.speed": speed, "body.stiffness": factor * stiffness}
        modes = rig.modes(scene(SPRING, law, **changes)).sliding.modes
        mode = max(modes, key=lambda mode: mode.frequency)
        growths.append(mode.growth)
        if factor == 1.0:
            assert 2.0 * math.pi * mode.frequency == pytest.approx(frequency, rel=1e-9)
    fastest = RATE["a"] * 30.0 / 2.0 / speed + speed / RATE["distance"]
    assert abs(growths[0]) < 1e-10 * max(fastest, frequency)
    assert growths[1] < 0.0 < growths[2]


def test_at_rest_bristles_are_springs():
    """Under a belt that does not move: omega^2 = (k + N sum of stiffness) / m, and nothing holds the deflections."""
    at_rest = rig.modes(rig.load("belt_maxwell_slip", {"drive.speed": 0.0}))
    hertz = [mode.frequency for mode in at_rest.sliding.modes if mode.frequency > 0.0]
    assert hertz == pytest.approx([math.sqrt((2500.0 + 20.0 * 1e5) / 5.0) / (2.0 * math.pi)], rel=1e-6)
    assert "at rest on its bristles" in at_rest.text()


@pytest.mark.parametrize(("a", "stops"), [(0.01, True), (0.013, True), (0.015, False)])
def test_a_slip_speed_below_rounding_ends_the_run(a, stops):
    """From rest friction is far below its steady value, and creep at exp(-mu_reference / a) of the belt speed."""
    run = rig.simulate(rig.load("belt_rate_state", {"friction.a": a, "start.displacement": 0.0}), 4.0)
    if stops:
        assert "lost in the rounding" in str(run.fault)
    else:
        assert not run.fault
        assert run.time[-1] == pytest.approx(4.0)
    assert abs(run.energy["error"]) < 1e-3


def test_a_spring_softer_than_critical_ends_in_a_cycle_that_the_tolerance_does_not_change():
    coarse, fine = (rig.limit_cycle(rig.load("belt_rate_state", {"clock.tolerance": t})) for t in (1e-7, 1e-9))
    assert coarse.period == pytest.approx(fine.period, rel=1e-6)
    assert np.ptp(coarse.outputs["displacement"]) == pytest.approx(np.ptp(fine.outputs["displacement"]), rel=1e-5)
    assert rig.modes(rig.load("belt_rate_state")).sliding.modes[0].growth > 0.0


def test_behind_a_spring_stiffer_than_critical_a_small_motion_decays_as_its_eigenvalue_says():
    scene = rig.load("belt_rate_state", {"body.stiffness": 8000.0, "start.displacement": 1.001e-3})
    mode = rig.modes(scene).sliding.modes[0]
    run = rig.simulate(scene, 4.0)
    ten, speed = round(10.0 / mode.frequency / 1e-3), np.abs(run.signals["velocity"])
    first, later = (speed[at : at + ten // 10].max() for at in (500, 500 + ten))
    assert math.log(later / first) / (ten * 1e-3) == pytest.approx(mode.growth, rel=0.02)


@pytest.mark.parametrize("cycles", [10**4, pytest.param(10**6, marks=pytest.mark.slow)])
def test_below_its_elastic_limit_a_contact_does_not_drift_in_many_cycles(cycles):
    """Bristles without a damper at 100 Hz: displacement and deflection keep their sum, so that nothing has slipped."""
    at_rest = {"drive.speed": 0.0, "start.velocity": 0.0, "start.displacement": 4e-4}
    free = {"friction.sigma1": 0.0, "body.damping": 0.0}
    scene = rig.load("belt_elasto_plastic", at_rest | free)
    motion = Motion(scene.assemble().system(), scene.step_ns, "rosenbrock", tolerance=1e-9)
    begun, turns = motion.x[0] + motion.x[2], 0
    for _ in range(cycles // 100):
        motion.advance(1000)
        turns += motion.event_count
    assert motion.system.names[2] == "contact_deflection"
    assert motion.x[0] + motion.x[2] == pytest.approx(begun, abs=1e-15 * math.sqrt(cycles) + 1e-14)
    assert turns == pytest.approx(2 * cycles, rel=0.01)
    assert motion.energy()["error"] == pytest.approx(0.0, abs=1e-3)
