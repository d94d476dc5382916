"""A plant in a thread, on the twin of the bus: no process, but everything else is real."""

import threading

import numpy as np
from twin import Twin

from rig import controllers
from rig.bench.live.outcome import Job
from rig.bench.live.plant import Plant
from rig.bench.run.exchange import Playback
from rig.bench.run.experiment import Experiment
from rig.bench.run.runner import PlantRunner
from rig.bus import messages
from rig.bus.run_setup import fetch
from rig.controllers.runtime.process import Worker

SCENE = "belt_normal_force"


class Bench:
    """One run in a thread; the test plays everybody else."""

    def __init__(self, scene, **job):
        self.twin = Twin("test")
        self.stopped = ""
        self.job = Job(scene.to_json(), **{"wait": 5.0, **job})
        self.session = self.twin.open("plant", "plant")
        self.plant = Plant(self.session, self.job, lambda: self.stopped)
        self.me = self.twin.open("operator", "test")
        self.heard = self.me.subscribe("**", depth=1 << 20)
        self.session.announce()
        self.summary = None
        self.threads = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.stopped = "by the test"
        for thread in self.threads:
            thread.join(20.0)
        assert not any(thread.is_alive() for thread in self.threads)

    def thread(self, function, *arguments):
        thread = threading.Thread(target=function, args=arguments, daemon=True)
        thread.start()
        self.threads.append(thread)
        return thread

    def begin(self, say=lambda _: None):
        def run():
            self.plant.gather(say)
            self.summary = self.plant.run(lambda _: None)
            self.session.close()

        return self.thread(run)

    def controller(self, name="nf"):
        """The controller of the scene, in a thread; returns what makes it leave."""
        session = self.twin.open("controller", name)
        gone = threading.Event()

        def run():
            described = fetch(session)
            worker = Worker(session, described, controllers.restored(described.controllers[name]))
            worker.follow(gone.is_set)
            session.close()

        self.thread(run)
        return gone

    def finish(self):
        for thread in self.threads:
            thread.join(20.0)
        messages_of = {}
        for message in self.heard.drain():
            messages_of.setdefault(message.topic, []).append(message.payload)
        return messages_of

    def events(self, heard):
        return [messages.decode("event/plant", payload) for payload in heard["event/plant"]]


def samples(heard, name):
    return np.concatenate([messages.decode(f"meas/{name}", p).v for p in heard[f"meas/{name}"]])


def played(scene, ticks, commands, events):
    """Samples of every sensor when a run is simulated again from what came from outside."""
    runner = PlantRunner(scene)
    experiment = Experiment(scene, runner, ticks * scene.frame_ns, None, exchange=Playback, events=events)
    experiment.exchange.play(commands)
    experiment.open()
    found = {name: [] for name in runner.bank.names}
    while True:
        for i, name in enumerate(runner.bank.names):
            found[name].append(runner.bank.samples(i).copy())
        if not experiment.begin():
            return found
        experiment.exchange.take_over()
        runner.frame()
