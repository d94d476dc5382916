"""Whatever arrives: plant, controller, recorder and viewer go on, and tell what they refused."""

import json
import random
import threading
import time

import numpy as np
import pytest
from plant_in_thread import Bench
from strange_messages import MS, NUMBERS, TOPICS, USERS, message
from twin import Asked, Twin

from rig import controllers, design, scenes
from rig.bus import encode
from rig.bus.run_setup import Setup, fetch
from rig.bus.topics import FASTEST, Arrived
from rig.controllers.runtime.process import Worker
from rig.errors import ExitCode
from rig.record import reader
from rig.record.recorder import RunRecorder
from rig.record.writer import Writer

QUESTIONS = (
    b"",
    b"{nope",
    b"[]",
    b"\xff\xfe",
    b'{"do": NaN}',
    b'{"set": 5}',
    b'{"set": {"gain": [[]]}}',
    b'{"do": "admit"}',
    b'{"do": "admit", "controller": "../../evil x", "drives": ["load.force"], "reads": [], "period_ns": 1000000}',
    b'{"do": {}}',
    b'{"do": "begin", "without": [[]]}',
    b'{"do": "connect", "controller": {}}',
    b'{"get": {"a": 1}}',
)
MANY = [2_000, pytest.param(120_000, marks=pytest.mark.slow)]


class Stranger:
    """Hands things to one session of a Twin past everything that a sender checks, as fast as they are taken."""

    def __init__(self, hub, victim, seed):
        self.hub, self.inbound, self.rng = hub, victim.inbound, random.Random(seed)

    def token(self):
        """One sign of life that is wrong, or of somebody who comes and goes."""
        name = self.rng.choice(TOPICS) if self.rng.random() < 0.5 else f"alive/controller/x{self.rng.randrange(10_000)}"
        return Arrived(self.rng.choice(USERS), name, put=self.rng.random() < 0.7)

    def question(self):
        """The text of one question that makes no sense."""
        if self.rng.random() < 0.9:
            return self.rng.choice(QUESTIONS)
        return json.dumps({self.rng.choice(("do", "set", "controller")): self.rng.choice(NUMBERS)}).encode()

    def send(self, count, alive):
        for _ in range(count):
            assert alive()
            strange = message(self.rng)
            for receiver in self.hub.receivers:
                if receiver.inbound is self.inbound:
                    receiver.queue.put(strange)
                    while receiver.queue.qsize() > 200 and receiver.patterns != ("total/*",) and alive():
                        time.sleep(0.0005)
            for _, watch in self.hub.watches:
                if watch.inbound is self.inbound:
                    watch.queue.put(self.token())
            if self.rng.random() < 0.1:
                for topic, server in list(self.hub.servers.items()):
                    if server.inbound is self.inbound and server.queue.qsize() < 20:
                        server.queue.put(Asked(Arrived("stranger", topic, self.question())))


@pytest.mark.parametrize("count", MANY)
def test_a_plant_survives_and_its_controller_commands_as_if_nobody_else_spoke(count):
    scene = scenes.load("belt_normal_force")
    with Bench(scene, pace=None, duration=1e6, expect=(("controller", "nf"),)) as bench:
        bench.controller()
        plant = bench.begin()
        Stranger(bench.twin, bench.session, count).send(count, plant.is_alive)
        assert bench.me.ask("param/plant", {"get": ["load.force"]}, 20.0)["values"]
        bench.stopped = "by the test"
        plant.join(30.0)
    summary = bench.summary
    assert summary["exit_code"] == ExitCode.INTERRUPTED  # stopped long before its end, and nothing else
    assert summary["loop"]["nf"]["taken"] > 0
    assert sum(summary["refused"].values()) > count / 2
    assert len(summary["refused"]) < 100  # bounded, however many names were made up
    assert not any("e+" in topic or len(topic) > 100 for topic in summary["lost"])
    assert all(number < FASTEST for number in summary["lost"].values())


@pytest.fixture
def followed():
    """A plant that answers who asks, on a Twin; `start(role, work)` follows it in a thread, and ends it again."""
    hub, stop, threads = Twin("fuzz"), threading.Event(), []
    scene = scenes.load("belt_normal_force")
    outputs, sensors = {"displacement": "m", "velocity": "m/s"}, {"vibrometer": ("m/s", MS)}
    setup = Setup("fuzz", scene.to_json(), MS, MS, outputs, sensors, design.described(scene))

    def start(work):
        threads.append(threading.Thread(target=work, daemon=True))
        threads[-1].start()
        return threads[-1]

    with hub.open("plant", "plant") as plant:
        server = plant.serve("scene", lambda _: setup.to_json())
        plant.announce()
        serving = start(lambda: [server.poll(0.01) for _ in iter(stop.is_set, True)])
        yield hub, plant, stop, start
        stop.set()
        serving.join(20.0)


@pytest.mark.parametrize("count", MANY)
def test_a_controller_answers_the_next_step_whatever_came_before(followed, count):
    hub, plant, stop, start = followed
    mine, acts = hub.open("controller", "nf"), plant.subscribe("act/nf")
    setup = fetch(mine)
    worker = Worker(mine, setup, controllers.restored(setup.controllers["nf"]))
    thread, step, stranger = start(lambda: worker.follow(stop.is_set)), plant.publisher("step"), Stranger(hub, mine, 1)
    for tick in range(1, 11):
        stranger.send(count // 10, thread.is_alive)
        acts.drain()
        step.put(encode.step(tick, tick * MS, [0.01], np.ones(1, np.int64)), tick * MS)
        assert acts.get(20.0).said.tick == tick
    stop.set()
    thread.join(20.0)
    assert mine.inbound.total > count / 4


@pytest.mark.parametrize("count", MANY)
def test_a_recorder_writes_what_can_be_read(followed, count, tmp_path):
    hub, plant, stop, start = followed
    mine, recordings = hub.open("recorder", "recorder"), []
    heard, watch = mine.subscribe("**", depth=1 << 17), mine.watch("plant/*")
    setup = fetch(mine)
    recorder = RunRecorder(mine, setup, heard, watch, Writer(tmp_path / "run.mcap", setup, "recorded"))
    watch.wait_for("plant", "plant", 5.0)
    thread = start(lambda: recordings.append(recorder.run(stop)))
    state, pack, measured = plant.publisher("state"), encode.StateEncoder(2), plant.publisher("meas/vibrometer")
    for k in range(10):
        state.put(pack(k * MS, k, 0, np.array([k, -k], float)), k * MS)
        measured.put(encode.block(k, k * MS, MS, [float(k)]), k * MS)
        plant.flush()
        Stranger(hub, mine, count + k).send(count // 10, thread.is_alive)
    while heard.queue.qsize():
        time.sleep(0.01)
    stop.set()
    thread.join(20.0)
    (recording,) = recordings
    assert sum(recording.refused.values()) > count / 2
    assert recording.lost < 10 * FASTEST
    run = reader.open(tmp_path / "run.mcap")
    assert not run.fault
    assert {-k for k in range(10)} <= set(run.signals["velocity"].tolist())


@pytest.mark.parametrize("count", MANY)
def test_a_viewer_goes_on_drawing(followed, count):
    rr = pytest.importorskip("rerun")
    from rig.view.process import Bridge

    hub, _, stop, start = followed
    mine, viewed = hub.open("viewer", "viewer"), []
    bridge = Bridge(mine)
    rec = rr.RecordingStream("fuzz", recording_id="fuzz")
    rec.memory_recording()
    thread = start(lambda: viewed.append(bridge.run(rec, stop)))
    Stranger(hub, mine, count).send(count, thread.is_alive)
    stop.set()
    thread.join(20.0)
    assert viewed[0].ended == "told to stop"
    assert viewed[0].refused > count / 4
