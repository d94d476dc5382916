"""Actuators that nobody drove at the start: they get a command state once, and the motion does not notice."""

import json
import threading
import time

import numpy as np
import pytest

import rig
from rig.bench.again.verify import verify
from rig.bench.run.builds import Builds
from rig.bench.run.rig_variants import Wanted
from rig.bench.run.runner import PlantRunner
from rig.bench.run.simulate import Recorded, simulate
from rig.errors import SceneError
from rig.record.run import Commands
from rig.record.save_run import save
from rig.scenes.scene import Scene

MS = 1_000_000
MAGNET = {"load.lag": "5 ms", "load.force_min": "0 N", "load.force_max": "40 N"}


def shorn(name, changes=None):
    """A shipped scene without its protocol: nobody moves an actuator."""
    raw = json.loads(rig.load(name, changes or {}).to_json())
    return Scene.from_json(json.dumps(raw | {"protocol": [{"step": "hold", "time": 1.0}], "controllers": {}}))


def carried(runner, frames):
    found = []
    for _ in range(frames):
        runner.frame()
        found.append(runner.output_values().copy())
    return np.array(found)


def built_apart():
    """Wait until no rig is being built in another thread."""
    while any(thread.name == "variant" for thread in threading.enumerate()):
        time.sleep(0.001)


@pytest.mark.parametrize(
    ("scene", "actuator"),
    [
        (shorn("belt"), "load.force"),
        (shorn("belt", MAGNET), "load.force"),
        (shorn("belt_shunt"), "shunt.connected"),
        (shorn("belt_shunt", {"shunt.connected": False, "shunt.delta": 0.0}), "shunt.connected"),
    ],
    ids=["load", "magnet", "closed shunt", "open shunt"],
)
def test_a_command_state_does_not_disturb_the_motion(scene, actuator):
    driven, other = PlantRunner(scene), PlantRunner(scene)
    carried(driven, 400), carried(other, 400)
    assert driven.lacking([actuator]) == (actuator,)
    driven.take(driven.variants.build(Wanted(driven=(actuator,))))
    assert driven.lacking([actuator]) == ()
    driven.apply(actuator, driven.values[actuator])
    found, known = carried(driven, 200), carried(other, 200)
    for i, name in enumerate(driven.outputs):
        scale = np.abs(known[:, i]).max()
        assert np.abs(found[:, i] - known[:, i]).max() <= 1e-9 * scale, name
    assert abs(driven.motion.energy()["error"]) < 1e-9


def test_what_cannot_be_built_is_told_and_changes_nothing():
    runner = PlantRunner(shorn("belt"))
    before = runner.motion.system
    for wanted, told in [
        (Wanted({"friction.mu_static": -1.0, "body.mass": -2.0}), "(?s)mu_static.*mass|mass.*mu_static"),
        (Wanted({"friction.nothing": 1.0}), "is not a parameter"),
    ]:
        builds = Builds(runner)
        builds.in_spare_time("", lambda w=wanted: runner.variants.build_all([w]))
        built_apart()
        with pytest.raises(SceneError, match=told):
            builds.collect("")
    assert runner.motion.system is before


BY = {"by": "operator", "period_ns": MS}
LIVES = {
    "came and went": (
        # one leaves and another takes its actuator over; one drives nothing; the range of the actuator changes
        [
            (20, "admitted", {**BY, "controller": "watcher", "drives": []}),
            (40, "admitted", {**BY, "controller": "mine", "drives": ["load.force"]}),
            (200, "dismissed", {"by": "operator", "controller": "mine"}),
            (200, "admitted", {**BY, "controller": "yours", "drives": ["load.force"]}),
            (300, "parameter", {"by": "operator", "set": {"load.force_min": 15.0}}),
        ],
        {"watcher": (30, 400, []), "mine": (50, 150, [22.0]), "yours": (210, 400, [22.0])},
    ),
    "another actuator in a second life": (
        [
            (40, "admitted", {**BY, "controller": "mine", "drives": ["load.force"]}),
            (200, "dismissed", {**BY, "controller": "mine"}),
            (200, "admitted", {**BY, "controller": "mine", "drives": ["drive.speed"]}),
        ],
        {"mine": (50, 400, [0.08])},
    ),
}


@pytest.mark.parametrize("lives", LIVES)
def test_a_recording_holds_in_which_controllers_came_and_went(tmp_path, lives):
    outside, spoken = LIVES[lives]
    commands = {}
    for name, (first, last, values) in spoken.items():
        ticks = np.arange(first, last, dtype=np.int64)
        commands[name] = Commands(ticks, ticks, np.zeros_like(ticks), np.tile(values, (ticks.size, 1)))
    events = [{"tick": tick, "kind": kind, "data": data} for tick, kind, data in outside]
    run = simulate(shorn("belt"), {}, 5 * 10**8, Recorded(commands, events))
    assert {name: each.tick.size for name, each in run.commands.items()} == {
        name: last - first for name, (first, last, _) in spoken.items()
    }
    save(run, tmp_path / "run.mcap")
    verified = verify(tmp_path / "run.mcap")
    assert verified.passed, verified.text()
    assert verified.identical


FILM = {
    "film.along": 2,
    "film.across": 2,
    "film.lateral": True,
    "film.retardation": 1e-8,
    "clock.rk4_step": "0.125 us",
}


@pytest.mark.parametrize("factor", [10.0, 0.1])
def test_the_energy_closes_where_the_stiffness_of_a_film_is_changed_by_the_protocol(factor):
    raw = json.loads(rig.load("plate", FILM).to_json())
    young = raw["parameters"]["film"]["young"]
    hold = {"step": "hold", "time": 0.02}
    change = {"step": "set", "target": "film.young", "to": factor * young}
    run = rig.simulate(Scene.from_json(json.dumps(raw | {"protocol": [hold, change, hold]})))
    assert abs(run.energy["error"]) < 1e-5
    assert run.energy["impulses"] * (factor - 1.0) > 0.0
    assert run.signals["openings"][-1] > 20.0


def test_a_film_that_becomes_too_stiff_for_its_step_or_has_other_points_is_refused():
    runner = PlantRunner(shorn("plate", FILM | {"clock.rk4_step": "2 us"}))
    runner.frame()
    with pytest.raises(SceneError, match=r"kick is unstable at a step of 2e-06 s.*rk4_step of"):
        runner.set_parameter("film.young", 1e11)
    with pytest.raises(SceneError, match="changes the contacts of the rig"):
        runner.set_parameter("film.along", 3)
