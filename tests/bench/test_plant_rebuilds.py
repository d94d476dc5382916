"""Rigs with other matrices are built beside the frames of a live run, never in one."""

import json
import threading
import time

from plant_in_thread import Bench, same_again

from rig import scenes
from rig.motion.motion import Motion
from rig.scenes.scene import Scene


def threads_of_builds(patch):
    """A list of the names of the threads that build matrices from now on."""
    threads, ready = [], Motion.ready

    def noted(*given):
        threads.append(threading.current_thread().name)
        return ready(*given)

    patch.setattr(Motion, "ready", noted)
    return threads


class Shunt(Bench):
    """A paced run of belt_shunt with these steps of a protocol, in which an operator has just tuned the shunt.

    `builders`: the threads that have built matrices from then on.
    """

    def __init__(self, patch, *steps, **more):
        raw = json.loads(scenes.load("belt_shunt").to_json())
        self.scene = Scene.from_json(json.dumps(raw | {"protocol": list(steps)} | more))
        self._patch = patch
        super().__init__(self.scene, pace=1.0)

    def begun(self, **changes):
        self.begin()
        self.ask("param/plant", get=["shunt.delta"])  # the frames have begun
        self.builders = threads_of_builds(self._patch)
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
        assert set(self.builders) == {"variant"}
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
