"""Rigs with other matrices are built beside the frames of a live run, never in one."""

import json
import threading
import time

import numpy as np
import pytest
from plant_in_thread import Bench, commands, same_again

from rig import scenes
from rig.bench.live.status import summary
from rig.bench.run.rig_variants import RigVariants
from rig.bus import encode
from rig.bus.run_setup import fetch
from rig.controllers.runtime.file import load_file
from rig.controllers.runtime.process import Worker
from rig.motion.motion import Motion
from rig.scenes.scene import Scene


@pytest.mark.parametrize("pace", [2.0, None], ids=["paced", "lockstep"])
def test_a_controller_that_joins_builds_the_rig_once(monkeypatch, pace):
    """It drives a load that has no command state, and the run can be simulated again to the bit."""
    scene, built = scenes.load("belt"), []
    replaced = Motion.replace
    monkeypatch.setattr(Motion, "replace", lambda motion, ready: built.append(motion) or replaced(motion, ready))
    here = () if pace else (("controller", "example_controller"),)  # in lockstep it joins before the first frame
    with Bench(scene, duration=60.0 if pace else 0.5, pace=pace, expect=here) as bench:
        session, gone = bench.twin.open("controller", "example_controller"), threading.Event()

        def work():
            worker = Worker(session, fetch(session), load_file("docs/example_controller.py"))
            worker.follow(gone.is_set)
            session.close()

        bench.begin()
        bench.thread(work)
        queues = bench.plant.experiment.exchange.queues
        while pace and ("example_controller" not in queues or queues["example_controller"].counts.taken < 700):
            time.sleep(0.01)  # two cycles of the belt
        bench.stopped = "by the test" if pace else ""
        heard = bench.finish()
    assert built == [bench.plant.runner.motion]
    same_again(bench, heard)
    assert len(np.unique(commands(heard, "example_controller").values)) > 1


class Gate:
    """Threads that build rigs wait here while it is closed; in `threads` are the names of those that build matrices."""

    def __init__(self, patch):
        self.open, made, ready, self.threads = threading.Event(), RigVariants.build, Motion.ready, []
        self.open.set()

        def variant(*given):
            if threading.current_thread().name == "variant":
                self.open.wait(30.0)
            return made(*given)

        def noted(*given):
            self.threads.append(threading.current_thread().name)
            return ready(*given)

        patch.setattr(RigVariants, "build", variant)
        patch.setattr(Motion, "ready", noted)


class Shunt(Bench):
    """A paced run of belt_shunt with these steps of a protocol, in which an operator has just tuned the shunt.

    `gate`: from then on.
    """

    def __init__(self, patch, *steps, **more):
        raw = json.loads(scenes.load("belt_shunt").to_json())
        self.scene = Scene.from_json(json.dumps(raw | {"protocol": list(steps)} | more))
        self._patch = patch
        super().__init__(self.scene, pace=1.0)

    def begun(self, **changes):
        self.begin()
        self.ask("param/plant", get=["shunt.delta"])  # the frames have begun
        self.gate = Gate(self._patch)
        return self.ask("param/plant", set={"shunt.delta": -0.8, **changes})

    def ask(self, topic, **body):
        return self.me.ask(topic, body, 20.0)

    def reach(self, done):
        """Wait until `done()`, while frames go on."""
        while not done():
            assert self.threads[0].is_alive()
            time.sleep(0.002)

    def ended(self):
        """The events of the run, by kind; no frame has built a rig, and it can be simulated again to the bit."""
        heard = self.finish()
        assert set(self.gate.threads) == {"variant"}
        told = {}
        for event in same_again(self, heard):
            told.setdefault(event["kind"], []).append(event)
        return told


def hold(seconds):
    return {"step": "hold", "time": seconds}


def put(target, to):
    return {"step": "set", "target": target, "to": to}


def test_no_frame_builds_a_rig_for_what_an_operator_tunes_and_the_protocol_sets_then(monkeypatch):
    """A coefficient has no command state: each value is another matrix, built apart and in force at one tick."""
    monkeypatch.setattr("rig.bench.run.builds.PAUSE_S", 0.05)
    steps = [hold(0.7), put("shunt.resistance", 40.0), hold(60.0)]
    with Shunt(monkeypatch, *steps, limits={"displacement": 0.05}) as bench:
        told = bench.begun(**{"load.force": 11.0})
        bench.reach(lambda: bench.plant.runner.values["shunt.resistance"] == 40.0)
        bench.ask("cmd/plant", do="stop")
        events = bench.ended()
    assert told["values"] == {"shunt.delta": -0.8, "load.force": 11.0}
    assert bench.plant.runner.values["shunt.resistance"] == 40.0
    assert [e["tick"] for e in events["parameter"]] == [told["tick"]]


def test_steps_and_operators_get_their_matrices_beside_a_controller_that_asks_for_others_all_the_time(monkeypatch):
    """Steps of one tick take effect at one tick; then it is the operator's turn, then the controller's."""
    steps = [put("friction.mu_static", 0.45), put("shunt.delta", -0.6), put("body.mass", 1.1)]
    mine = {"mine": {"kind": "shunt_schedule", "drive": "shunt.resistance"}}
    monkeypatch.setattr("rig.bench.run.builds.PAUSE_S", 0.0)
    with Shunt(monkeypatch, hold(1.5), *steps, hold(60.0), controllers=mine) as bench:
        runner, over, answers = bench.plant.runner, threading.Event(), []
        bench.begun()
        act = bench.twin.open("controller", "mine").publisher("act/mine")

        def command():
            while not over.is_set():
                act.put(encode.act(runner.tick, 0, (30.0 + runner.tick % 10,)), 0)
                time.sleep(0.002)

        bench.thread(command)
        bench.reach(lambda: runner.tick > 600)
        bench.gate.open.clear()
        bench.reach(lambda: runner.tick > 1510)
        asking = bench.thread(lambda: answers.append(bench.ask("param/plant", set={"friction.mu_kinetic": 0.2})))
        time.sleep(0.1)
        bench.gate.open.set()
        asking.join(20.0)
        then = runner.values["shunt.resistance"]
        bench.reach(lambda: runner.values["shunt.resistance"] != then)
        over.set()
        bench.ask("cmd/plant", do="stop")
        events = bench.ended()
    assert (runner.values["shunt.delta"], runner.parameter("friction.mu_static")) == (-0.6, 0.45)
    assert [e["tick"] for e in events["waits"]] == [1500] * 3
    [tick] = {e["tick"] for e in events["goes on"]}
    assert 1500 < tick < answers[0]["tick"]
    longest = 1e-3 * (tick - 1500)
    assert bench.summary["postponed"] == {"waited": 3, "longest_s": pytest.approx(longest), "never": 0}
    assert f"3 steps waited for new matrices, the longest {longest:.3g} s" in summary(bench.summary)
