"""Rigs with other matrices are built beside the frames of a live run, never in one."""

import json
import threading
import time

import numpy as np
import pytest
from plant_in_thread import Bench, played, samples

from rig import scenes
from rig.bench.live.status import summary
from rig.bench.run.rig_variants import RigVariants
from rig.bus import encode, messages
from rig.bus.run_setup import fetch
from rig.controllers.runtime.file import load_file
from rig.controllers.runtime.process import Worker
from rig.motion.motion import Motion
from rig.record.run import Commands
from rig.scenes.scene import Scene


@pytest.mark.parametrize("pace", [2.0, None], ids=["paced", "lockstep"])
def test_a_controller_that_joins_builds_the_rig_once(monkeypatch, pace):
    """It drives a load that has no command state, and the run can be simulated again to the bit."""
    scene, built = scenes.load("belt"), []
    replaced = Motion.replace
    monkeypatch.setattr(Motion, "replace", lambda motion, ready: built.append(motion) or replaced(motion, ready))
    here = () if pace else (("controller", "example_controller"),)  # in lockstep it joins before the first frame
    with Bench(scene, duration=1.5, pace=pace, expect=here) as bench:
        session, gone = bench.twin.open("controller", "example_controller"), threading.Event()

        def work():
            worker = Worker(session, fetch(session), load_file("docs/example_controller.py"))
            worker.follow(gone.is_set)
            session.close()

        bench.begin()
        bench.thread(work)
        heard = bench.finish()
    applied = [messages.decode("applied/example_controller", p) for p in heard["applied/example_controller"]]
    values = np.array([list(a.values) for a in applied])
    assert len(np.unique(values)) > 1
    assert built == [bench.plant.runner.motion]
    commands = Commands(
        *(np.array([getattr(a, f) for a in applied], np.int64) for f in ("tick", "answered", "status")), values
    )
    events = [{"tick": e.tick, "kind": e.kind, "data": json.loads(e.data)} for e in bench.events(heard)]
    again = played(scene, bench.summary["ticks"], {"example_controller": commands}, events)
    for name, known in again.items():
        assert samples(heard, name).tobytes() == np.concatenate(known).tobytes()


@pytest.mark.parametrize("limits", [{}, {"displacement": 0.05}], ids=["", "with a limit"])
def test_no_frame_builds_a_rig_for_what_an_operator_tunes_and_the_protocol_sets_then(monkeypatch, limits):
    """A coefficient has no command state: each value is another matrix, built apart and in force at one tick."""
    raw = json.loads(scenes.load("belt_shunt").to_json()) | {"limits": limits}
    hold = {"step": "hold", "time": 1.5}
    raw["protocol"] = [hold, {"step": "set", "target": "shunt.resistance", "to": 40.0}, hold | {"time": 0.2}]
    scene = Scene.from_json(json.dumps(raw))
    monkeypatch.setattr("rig.bench.run.builds.PAUSE_S", 0.05)
    built, ready = [], Motion.ready

    def noted(*given):
        built.append(threading.current_thread().name)
        return ready(*given)

    with Bench(scene, pace=1.0) as bench:
        bench.begin()
        bench.me.ask("param/plant", {"get": ["shunt.delta"]}, 20.0)  # the frames have begun
        monkeypatch.setattr(Motion, "ready", noted)
        told = bench.me.ask("param/plant", {"set": {"shunt.delta": -0.8, "load.force": 11.0}}, 5.0)
        heard = bench.finish()
    assert told["values"] == {"shunt.delta": -0.8, "load.force": 11.0}
    assert bench.plant.runner.values["shunt.resistance"] == 40.0
    assert set(built) == {"variant"}
    events = [{"tick": e.tick, "kind": e.kind, "data": json.loads(e.data)} for e in bench.events(heard)]
    assert [e["tick"] for e in events if e["kind"] == "parameter"] == [told["tick"]]
    again = played(scene, bench.summary["ticks"], {}, events)
    for name, known in again.items():
        assert samples(heard, name).tobytes() == np.concatenate(known).tobytes()


def rebuilt_apart(bench, heard, scene, built):
    """The events of a run in which no frame built a rig, and which comes out the same when it is simulated again."""
    assert set(built) == {"variant"}
    commands = {}
    for topic in [topic for topic in heard if topic.startswith("applied/")]:
        said = [messages.decode(topic, payload) for payload in heard[topic]]
        commands[topic[8:]] = Commands(
            *(np.array([getattr(a, f) for a in said], np.int64) for f in ("tick", "answered", "status")),
            np.array([list(a.values) for a in said]),
        )
    events = [{"tick": e.tick, "kind": e.kind, "data": json.loads(e.data)} for e in bench.events(heard)]
    for name, known in played(scene, bench.summary["ticks"], commands, events).items():
        assert samples(heard, name).tobytes() == np.concatenate(known).tobytes()
    return events


@pytest.fixture
def built(monkeypatch):
    """Names of the threads that build matrices, once the second of these is called."""
    found, ready = [], Motion.ready

    def noted(*given):
        found.append(threading.current_thread().name)
        return ready(*given)

    return found, lambda: monkeypatch.setattr(Motion, "ready", noted)


def test_what_the_protocol_sets_right_after_an_operator_has_tuned_waits_for_its_matrices(built):
    """In the order of the protocol; what needs no other matrices does not wait."""
    found, begin = built
    steps = [("shunt.resistance", 40.0), ("friction.mu_static", 0.45), ("shunt.connected", 0)]
    steps.append(("shunt.resistance", 30.0))
    raw = json.loads(scenes.load("belt_shunt").to_json())
    hold = {"step": "hold", "time": 0.5}
    raw["protocol"] = [hold, *({"step": "set", "target": key, "to": to} for key, to in steps), hold | {"time": 1.5}]
    scene = Scene.from_json(json.dumps(raw))
    with Bench(scene, pace=1.0) as bench:
        bench.begin()
        bench.me.ask("param/plant", {"get": ["shunt.delta"]}, 20.0)  # the frames have begun
        begin()
        told = bench.me.ask("param/plant", {"set": {"shunt.delta": -0.8}}, 5.0)
        heard = bench.finish()
    assert told["tick"] < 500
    runner = bench.plant.runner
    assert (runner.values["shunt.resistance"], runner.parameter("friction.mu_static")) == (30.0, 0.45)
    events = rebuilt_apart(bench, heard, scene, found)
    waited = {kind: [e for e in events if e["kind"] == kind] for kind in ("waits", "goes on")}
    assert [e["tick"] for e in waited["waits"]] == [500] * 3
    order = [e["data"]["action"] for e in waited["goes on"]]
    assert order == sorted(order)
    assert len(order) == 3
    assert all(e["tick"] > 500 for e in waited["goes on"])


class Gate:
    """Threads that build rigs wait here while it is closed."""

    def __init__(self, monkeypatch, takes_s=0.0):
        self.open, made = threading.Event(), RigVariants.build
        self.open.set()

        def variant(*given):
            if threading.current_thread().name == "variant":
                time.sleep(takes_s)
                self.open.wait(20.0)
            return made(*given)

        monkeypatch.setattr(RigVariants, "build", variant)


def test_steps_and_operators_get_their_matrices_beside_a_controller_that_asks_for_others_all_the_time(
    built, monkeypatch
):
    """Steps of one tick take effect at one tick; then it is the operator's turn, then the controller's."""
    found, begin = built
    steps = [("friction.mu_static", 0.45), ("shunt.delta", -0.8), ("body.mass", 1.1)]
    raw = json.loads(scenes.load("belt_shunt").to_json())
    hold = {"step": "hold", "time": 1.0}
    raw["protocol"] = [hold, *({"step": "set", "target": key, "to": to} for key, to in steps), hold | {"time": 3.0}]
    raw["controllers"] = {"mine": {"kind": "shunt_schedule", "drive": "shunt.resistance"}}
    scene = Scene.from_json(json.dumps(raw))
    monkeypatch.setattr("rig.bench.run.builds.PAUSE_S", 0.0)
    Gate(monkeypatch, takes_s=0.1)
    with Bench(scene, pace=1.0) as bench:
        runner, over = bench.plant.runner, threading.Event()
        bench.begin()
        mine = bench.twin.open("controller", "mine")
        bench.me.ask("param/plant", {"get": ["shunt.delta"]}, 20.0)  # the frames have begun
        begin()

        def command():
            while not over.is_set():
                mine.publisher("act/mine").put(encode.act(runner.tick, 0, (30.0 + runner.tick % 10,)), 0)
                time.sleep(0.002)

        bench.thread(command)
        while runner.tick < 1001:
            time.sleep(0.001)
        told = bench.me.ask("param/plant", {"set": {"friction.mu_kinetic": 0.2}}, 5.0)
        then = runner.values["shunt.resistance"]
        while runner.values["shunt.resistance"] == then and runner.tick < 3900:
            time.sleep(0.01)
        over.set()
        heard = bench.finish()
    assert runner.values["shunt.resistance"] != then
    assert (runner.values["shunt.delta"], runner.parameter("friction.mu_static")) == (-0.8, 0.45)
    events = rebuilt_apart(bench, heard, scene, found)
    ticks = {kind: [e["tick"] for e in events if e["kind"] == kind] for kind in ("waits", "goes on")}
    assert ticks["waits"] == [1000] * 3
    [tick] = set(ticks["goes on"])
    assert 1000 < tick < told["tick"]
    assert bench.summary["postponed"] == {"waited": 3, "longest_s": pytest.approx(1e-3 * (tick - 1000)), "never": 0}
    assert f"3 steps waited for new matrices, the longest {1e-3 * (tick - 1000):.3g} s" in summary(bench.summary)


def test_a_step_that_still_waits_when_the_run_ends_is_told(built, monkeypatch):
    """The recording holds all the same: simulated again, it waits until the end, too."""
    found, begin = built
    raw = json.loads(scenes.load("belt_shunt").to_json())
    hold = {"step": "hold", "time": 0.5}
    raw["protocol"] = [hold, {"step": "set", "target": "shunt.resistance", "to": 40.0}, hold]
    scene = Scene.from_json(json.dumps(raw))
    gate = Gate(monkeypatch)
    with Bench(scene, pace=1.0) as bench:
        bench.begin()
        bench.me.ask("param/plant", {"get": ["shunt.delta"]}, 20.0)  # the frames have begun
        begin()
        bench.me.ask("param/plant", {"set": {"shunt.delta": -0.8}}, 5.0)  # what was built for the step fits no more
        gate.open.clear()
        heard = bench.finish()
        gate.open.set()
    assert bench.plant.runner.values["shunt.resistance"] != 40.0
    told = "shunt.resistance = 40 of t = 0.5 s never took effect"
    assert told in bench.summary["faults"]
    assert told in bench.summary["reasons"]
    assert bench.summary["verdict"] != "VALID"
    assert bench.summary["postponed"] == {"waited": 1, "longest_s": pytest.approx(0.5), "never": 1}
    events = rebuilt_apart(bench, heard, scene, found)
    assert [(e["tick"], e["kind"]) for e in events if e["kind"] in ("waits", "goes on", "never")] == [
        (500, "waits"),
        (1000, "never"),
    ]


def test_an_operator_who_tunes_in_a_pause_does_not_wait_for_a_step_that_cannot_take_effect_then(built, monkeypatch):
    found, begin = built
    raw = json.loads(scenes.load("belt_shunt").to_json())
    hold = {"step": "hold", "time": 0.5}
    raw["protocol"] = [hold, {"step": "set", "target": "shunt.resistance", "to": 40.0}, hold | {"time": 1.0}]
    scene = Scene.from_json(json.dumps(raw))
    gate = Gate(monkeypatch)
    with Bench(scene, pace=1.0) as bench:
        bench.begin()
        bench.me.ask("param/plant", {"get": ["shunt.delta"]}, 20.0)  # the frames have begun
        begin()
        bench.me.ask("param/plant", {"set": {"shunt.delta": -0.8}}, 5.0)
        gate.open.clear()
        while bench.plant.runner.tick < 510:
            time.sleep(0.001)
        bench.me.ask("cmd/plant", {"do": "pause"}, 5.0)
        gate.open.set()
        told = bench.me.ask("param/plant", {"set": {"shunt.delta": -0.7}}, 5.0)
        bench.me.ask("cmd/plant", {"do": "resume"}, 5.0)
        heard = bench.finish()
    runner = bench.plant.runner
    assert (runner.values["shunt.resistance"], runner.values["shunt.delta"]) == (40.0, -0.7)
    events = rebuilt_apart(bench, heard, scene, found)
    [tick] = [e["tick"] for e in events if e["kind"] == "goes on"]
    assert tick > told["tick"]


@pytest.mark.parametrize("by", ["operator", "protocol", "a successor"])
def test_no_frame_builds_a_rig_when_a_controller_that_commands_a_coefficient_is_disconnected(built, by, monkeypatch):
    found, begin = built
    drives = ["shunt.resistance"] if by != "a successor" else ["shunt.resistance", "shunt.delta"]
    raw = json.loads(scenes.load("belt_shunt").to_json())
    hold = {"step": "hold", "time": 2.0}
    raw["protocol"] = [hold, {"step": "disconnect", "controller": "mine"}, hold] if by == "protocol" else [hold, hold]
    if by != "a successor":
        raw["controllers"] = {"mine": {"kind": "shunt_schedule", "drive": "shunt.resistance"}}
    scene = Scene.from_json(json.dumps(raw))
    with Bench(scene, pace=1.0) as bench:
        runner, over = bench.plant.runner, threading.Event()
        first = [runner.values[name] for name in drives]
        bench.begin()
        mine = bench.twin.open("controller", "mine")
        wanted = {"do": "admit", "controller": "mine", "drives": drives, "period_ns": scene.frame_ns}
        if by == "a successor":
            mine.ask("cmd/plant", wanted, 20.0)
        bench.me.ask("param/plant", {"get": ["shunt.delta"]}, 20.0)  # the frames have begun
        begin()

        def command():
            while not over.is_set():
                mine.publisher("act/mine").put(encode.act(runner.tick, 0, (50.0, -0.7)[: len(drives)]), 0)
                time.sleep(0.002)

        bench.thread(command)
        while [runner.values[name] for name in drives] != [50.0, -0.7][: len(drives)]:
            assert runner.tick < 2000
            time.sleep(0.01)
        if by == "operator":
            bench.me.ask("cmd/plant", {"do": "disconnect", "controller": "mine"}, 5.0)
        elif by == "a successor":  # which drives an actuator that has no command state yet, too
            monkeypatch.setattr("rig.bench.live.hub.ANNOUNCED_S", 0.0)  # `mine` will not announce itself
            yours = bench.twin.open("controller", "yours")
            told = wanted | {"controller": "yours", "drives": [*drives, "load.force"]}
            yours.ask("cmd/plant", told, 5.0)
        while [runner.values[name] for name in drives] != first:
            assert runner.tick < 3900
            time.sleep(0.01)
        over.set()
        heard = bench.finish()
    rebuilt_apart(bench, heard, scene, found)
