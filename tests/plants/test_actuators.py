"""Drive and magnet of the plants: lag, limits, ramps, what a command does and what it leaves alone."""

import math

import numpy as np
import pytest
from pydantic import ValidationError

from rig import scenes
from rig.bench.run.simulate import simulate
from rig.effects.drive import BeltDrive
from rig.effects.load import Load

HELD, RAMPED = {"drive.speed": "held"}, {"drive.speed": "ramped"}
COULOMB = {"friction.law": "coulomb", "friction.mu_static": 0.4, "friction.mu_kinetic": 0.25}
LAGGING = COULOMB | {"drive.lag": "10 ms", "drive.speed_min": 0.0, "drive.speed_max": 0.25}


def test_a_drive_with_lag_follows_exponentially(move):
    """V = u + (V0 - u) exp(-t / lag), at any step."""
    for step_ms in (1.0, 5.0):
        for command, reached in ((0.2, 0.2), (1.0, 0.25), (-1.0, 0.0)):  # clamped in the plant
            run = move("belt_c_damped", LAGGING, moved=HELD, step_ms=step_ms)
            run.write("drive.command", command)
            run.motion.advance(40)
            expected = reached + (0.06 - reached) * np.exp(-run.time / 0.01)
            assert run["surface_speed"] == pytest.approx(expected, rel=1e-12, abs=1e-15)


def test_a_magnet_with_lag_follows_and_clamps(move):
    changes = {"load.lag": "5 ms", "load.force_min": 0.0, "load.force_max": "40 N"} | COULOMB
    run = move("belt_c_damped", changes, moved={"load.force": "held"})
    for command, held in ((30.0, 30.0), (100.0, 40.0), (-10.0, 0.0)):
        before = float(run.motion.x[run.motion.system.names.index("load.actual")])
        start = run.motion.tick * 1e-3
        run.write("load.command", command)
        run.motion.advance(30)
        expected = held + (before - held) * np.exp(-(run.time - start) / 0.005)
        assert run["normal_force"] == pytest.approx(expected, abs=1e-11)
    assert np.all(run["normal_force"] > 0.0)


def test_friction_follows_the_load(move):
    run = move("belt_c_damped", COULOMB, moved={"load.force": "held"}, duration=0.3)
    for load in (10.0, 30.0, 0.0):
        run.write("load.command", load)
        run.motion.advance(50)
        slips = run["slip_speed"] > 1e-9
        assert run["normal_force"] == pytest.approx(load, rel=1e-14)
        assert run["friction_force"][slips] == pytest.approx(0.25 * load, rel=1e-12)


def test_a_contact_without_load_oscillates_freely(move):
    """N = 0: the free damped oscillation, energy exp(-d/m t); no friction, no stick."""
    run = move("belt_c_damped", COULOMB, moved={"load.force": "held"}, duration=0.5)
    run.write("load.command", 0.0)
    run.motion.advance(1)
    x0, v0 = run["displacement"][-1], run["velocity"][-1]
    run.motion.advance(2000)
    decay, w = 0.2, math.sqrt(500.0 - 0.04)
    t = run.time - run.time[0] + 1e-3
    free = np.exp(-decay * t) * (x0 * np.cos(w * t) + (v0 + decay * x0) / w * np.sin(w * t))
    assert run["displacement"] == pytest.approx(free, abs=1e-13)
    assert np.all(run["friction_force"] == 0.0)


def test_a_ramp_is_a_straight_line_between_its_ends(move):
    run = move("belt_c_damped", moved=RAMPED)
    run.write("drive.slope", 0.05)
    run.motion.advance(2000)
    assert run["surface_speed"] == pytest.approx(0.06 + 0.05 * run.time, rel=1e-12)
    assert run["slip_speed"] == pytest.approx(run["surface_speed"] - run["velocity"], abs=1e-15)
    force = run["friction_force"] - 2.0 * run["velocity"] - 2500.0 * run["displacement"]
    assert run["acceleration"] == pytest.approx(force / 5.0, abs=1e-10)


@pytest.mark.parametrize(
    ("section", "given", "told"),
    [
        (BeltDrive, {"speed": 0.3, "speed_min": 0.0, "speed_max": 0.25}, "speed 0.3 is outside"),
        (Load, {"force": 20.0, "force_min": 5.0, "force_max": 5.0}, "is not below"),
    ],
)
def test_actuators_that_cannot_be_are_refused(section, given, told):
    with pytest.raises(ValidationError, match=told):
        section(**given)


def test_every_actuator_has_a_range_that_holds_what_the_scene_does(shipped):
    for scene in shipped:
        for actuator, one in scene.assemble().inputs.items():
            assert math.isfinite(one.high - one.low), actuator
            assert one.low < one.high, actuator
            assert one.low <= one.value <= one.high, actuator
            assert one.low <= one.safe <= one.high, actuator


def test_a_scene_widens_the_range_of_its_actuators():
    given = {"load.force": "200 kN", "drive.speed_max": "200 m/s"}
    inputs = scenes.load("belt", given).assemble().inputs
    assert (inputs["load.force"].low, inputs["load.force"].high) == (0.0, 2e5)
    assert (inputs["drive.speed"].low, inputs["drive.speed"].high) == (-100.0, 200.0)


class Wild:
    """Commands beyond any range, of either sign."""

    reads, period_ns = (), 1_000_000

    def __init__(self, *drives):
        self.drives = drives

    def start(self):
        return 1.0

    def update(self, state, t_ns, values):
        return -state, (state * 1e300,) * len(self.drives)


@pytest.mark.parametrize(
    ("name", "controller", "drive"),
    [("belt_normal_force", "nf", "load.force"), ("belt_velocity_feedback", "belt", "drive.speed")],
)
def test_wild_commands_are_clamped_and_the_run_tells_its_energy(name, controller, drive):
    scene = scenes.load(name)
    run = simulate(scene, {controller: Wild(drive)}, 20_000_000)
    assert run.fault == ""
    assert run.summary["exchange"][controller]["clamped"] >= 19
    assert all(math.isfinite(value) for value in run.energy.values())
    assert all(math.isfinite(one["share"]) for one in run.summary["audit"])
    assert np.abs(run.commands[controller].values).max() <= scene.assemble().inputs[drive].high
