"""Actuators that nobody drove at the start: they get a command state once, and the motion does not notice."""

import json
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

import rig
from rig.bench.again.verify import verify
from rig.bench.run.builds import Builds, CommandedRigs
from rig.bench.run.exchange import Exchange, Playback
from rig.bench.run.journal import Journal
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


def test_a_variant_that_was_built_apart_gives_the_bits_of_one_built_at_its_tick():
    found = []
    for apart in (True, False):
        runner = PlantRunner(shorn("belt"))
        carried(runner, 100)
        wanted = Wanted({"friction.mu_static": 0.45}, ("load.force",))
        builds = Builds(runner)
        if apart:
            assert builds.in_spare_time("", lambda s=runner, w=wanted: s.variants.build_all([w]))
        carried(runner, 60)  # meets mode sets that a variant begun before does not have
        built_apart()
        builds.collect("")
        runner.go_on(wanted)
        runner.apply("load.force", 15.0)
        found.append(carried(runner, 500))
    assert found[0].tobytes() == found[1].tobytes()


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
        [(20, "admitted", {**BY, "controller": "watcher", "drives": []}),
         (40, "admitted", {**BY, "controller": "mine", "drives": ["load.force"]}),
         (200, "dismissed", {"by": "operator", "controller": "mine"}),
         (200, "admitted", {**BY, "controller": "yours", "drives": ["load.force"]}),
         (300, "parameter", {"by": "operator", "set": {"load.force_min": 15.0}})],
        {"watcher": (30, 400, []), "mine": (50, 150, [22.0]), "yours": (210, 400, [22.0])},
    ),
    "another actuator in a second life": (
        [(40, "admitted", {**BY, "controller": "mine", "drives": ["load.force"]}),
         (200, "dismissed", {**BY, "controller": "mine"}),
         (200, "admitted", {**BY, "controller": "mine", "drives": ["drive.speed"]})],
        {"mine": (50, 400, [0.08])},
    ),
}  # fmt: skip


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


class Slow:
    """A stand whose rigs take until `finish` to be built, and count."""

    def __init__(self, runner, builds, monkeypatch):
        self.built, self._go = [], threading.Semaphore(0)
        self.runner, self.builds = runner, builds
        made = runner.variants.build

        def variant(wanted, after=None):
            if threading.current_thread() is not threading.main_thread():
                self._go.acquire(timeout=20.0)
                self.built.append(dict(wanted.parameters))
            return made(wanted, after)

        monkeypatch.setattr(runner.variants, "build", variant)

    def finish(self):
        before, end = len(self.runner.variants.kept), time.monotonic() + 20.0
        self._go.release()
        while len(self.runner.variants.kept) == before and time.monotonic() < end:
            self.builds.collect(None)
            time.sleep(0.001)
        assert len(self.runner.variants.kept) > before


def test_commands_that_ask_for_another_matrix_take_effect_when_it_is_built_and_others_at_once(monkeypatch):
    runner = PlantRunner(shorn("belt_shunt"))
    journal = Journal(MS, lambda: runner.tick)
    exchange = Exchange(runner, MS, 50, journal)
    drives = ["shunt.resistance", "load.force"]
    runner.take(runner.variants.build(Wanted(driven=("load.force",))))
    line = exchange.admit("mine", drives, MS)
    builds = Builds(runner)
    exchange.rebuild, slow = CommandedRigs(runner, journal, builds), Slow(runner, builds, monkeypatch)
    monkeypatch.setattr("rig.bench.run.builds.PAUSE_S", 0.0)
    before = runner.values["shunt.resistance"]
    force, in_force = runner.outputs.index("normal_force"), []

    def frame(tick, command=None):
        if command is not None:
            exchange.receive("mine", tick, command)
        exchange.take_over()
        in_force.append(line.values)
        runner.frame()
        assert runner.output_values()[force] == line.values[1]

    for tick in range(5):
        frame(tick, (before + 10.0 * (tick + 1), 20.0 + tick))
    assert in_force == [(before, 20.0 + tick) for tick in range(5)]  # the load follows at once
    slow.finish()
    frame(5)  # the rig that was asked for first is there
    frame(6)  # the newest value is being built
    assert in_force[-2:] == [(before + 10.0, 24.0)] * 2
    slow.finish()
    frame(7)
    frame(8)
    assert in_force[-2:] == [(before + 50.0, 24.0)] * 2
    assert line.wanted == ()
    assert [one["shunt.resistance"] for one in slow.built] == [before + 10.0, before + 50.0]
    assert runner.values["shunt.resistance"] == before + 50.0
    recorded = line.commands()  # what took effect, and when, is simulated again to the bit
    again = PlantRunner(shorn("belt_shunt"))
    other = Playback(again, MS, 50, Journal(MS, lambda: again.tick))
    again.take(again.variants.build(Wanted(driven=("load.force",))))
    other.admit("mine", drives, MS)
    other.play({"mine": recorded})
    for _ in range(9):
        other.take_over()
        again.frame()
    assert again.output_values().tobytes() == runner.output_values().tobytes()


def test_commands_of_a_controller_whose_admission_was_not_recorded_end_in_words(tmp_path):
    scene = shorn("belt")
    ticks = np.arange(50, 90, dtype=np.int64)
    commands = Commands(ticks, ticks, np.zeros_like(ticks), np.full((40, 1), 25.0))
    told = {"by": "operator", "controller": "mine", "drives": ["load.force"], "period_ns": MS}
    run = simulate(scene, {}, 10**8, Recorded({"mine": commands}, [{"tick": 40, "kind": "admitted", "data": told}]))
    save(replace(run, events=[event for event in run.events if event["kind"] != "admitted"]), tmp_path / "late.mcap")
    found = verify(tmp_path / "late.mcap")
    assert not found.passed
    assert "mine are recorded, but not that it was admitted" in found.faults[0]
