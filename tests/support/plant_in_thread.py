"""A plant in a thread, on the twin of the bus: no process, but everything else is real."""

import json
import threading

import numpy as np
from patience import PATIENCE_S
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
from rig.record.provenance import provenance
from rig.record.run import Commands
from rig.record.save_run import save

SCENE = "belt_normal_force"


class Bench:
    """One run in a thread; the test plays everybody else."""

    def __init__(self, scene, **job):
        self.twin = Twin("test")
        self.stopped = ""
        self.job = Job(scene.to_json(), **{"wait": 20.0, **job})
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
            thread.join(PATIENCE_S)
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
        """The messages of all topics, decoded if their type is known, when all threads have ended."""
        for thread in self.threads:
            thread.join(PATIENCE_S)
        heard = {}
        for message in self.heard.drain():
            heard.setdefault(message.topic, []).append(message.payload if message.said is None else message.said)
        return heard


def ran(scene, meanwhile=lambda me: None, **job):
    """A run with the controllers of the scene, and what was heard; `meanwhile(me)` is what an operator does to it."""
    outside = [name for name in scene.controllers if name not in scene.in_plant]
    with Bench(scene, expect=tuple(("controller", name) for name in outside), **job) as bench:
        for name in outside:
            bench.controller(name)
        bench.begin()
        meanwhile(bench.me)
        return bench, bench.finish()


def samples(heard, name):
    return np.concatenate([block.v for block in heard[f"meas/{name}"]])


def commands(heard, name):
    """Every command of a controller as it took effect."""
    rows = [messages.commands(applied) for applied in heard[f"applied/{name}"]]
    tick, answered, status, values = (np.concatenate([list(column) for column in columns]) for columns in zip(*rows))
    return Commands(*(c.astype(np.int64) for c in (tick, answered, status)), values.reshape(len(tick), -1))


def same_bits(heard, run):
    """A live run has measurements and commands of a run in one process."""
    for name, known in run.measurements.items():
        assert samples(heard, name).tobytes() == known.v.tobytes()
    for name, known in run.commands.items():
        assert [column.tobytes() for column in commands(heard, name)] == [column.tobytes() for column in known]


def same_again(bench, heard):
    """The events of a run, which comes out the same when it is simulated again."""
    given = {topic[8:]: commands(heard, topic[8:]) for topic in heard if topic.startswith("applied/")}
    events = [{"tick": e.tick, "kind": e.kind, "data": json.loads(e.data)} for e in heard["event/plant"]]
    for name, known in played(bench.plant.scene, bench.summary["ticks"], given, events).items():
        assert samples(heard, name).tobytes() == np.concatenate(known).tobytes()
    return events


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


def bits(run):
    """All that a run computed, as bytes."""
    columns = [*run.signals.values(), *(measured.v for measured in run.measurements.values()), run.mode]
    columns += [column for each in run.commands.values() for column in each]
    return [np.asarray(column).tobytes() for column in columns]


def recorded(folder, run, name="run.mcap"):
    """The path of a new recording of a run."""
    run.provenance |= provenance(0)
    save(run, folder / name)
    return folder / name
