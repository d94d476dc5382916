"""Whatever arrives: plant, controller, recorder and viewer go on, and tell what they refused."""

import json
import random
import threading
import time

import numpy as np
import pytest
from strange_messages import MS, NUMBERS, TOPICS, USERS, message
from twin import Asked, Twin

from rig import controllers, design, scenes
from rig.bench.live.outcome import Job
from rig.bench.live.plant import Plant
from rig.bus import encode
from rig.bus.run_setup import Setup, fetch
from rig.bus.topics import FASTEST, Arrived
from rig.controllers.runtime.process import Worker
from rig.errors import ExitCode
from rig.record import reader
from rig.record.recorder import RunRecorder
from rig.record.writer import Writer

QUESTIONS = (
    b"", b"{", b"{nope", b"[]", b"5", b"null", b'"x"', b"[" * 200_000, b'{"a":' * 200_000, b'{"do": "st', b"\xff\xfe",
    b'{"do": NaN}', b'{"set": {"load.force": Infinity}}', b'{"set": {"load.force": 1e999}}', b'{"set": 5}',
    b'{"get": 5}', b'{"get": [5]}', b'{"get": {"a": 1}}', b'{"set": {"gain": [[]]}}', b'{"a": 1, "a": 2}', b"1" * 5000,
    b'{"a": ' + b"9" * 5000 + b"}", b'{"do": "admit"}', b'{"do": "admit", "controller": "\\ud800"}',
    b'{"do": "admit", "controller": "../../evil x", "drives": ["load.force"], "reads": [], "period_ns": 1000000}',
    b'{"do": "admit", "controller": "x", "drives": ["load.force"], "reads": [], "period_ns": -1000000}',
    b'{"do": "knock", "impulse": "\\u0000"}', b'{"do": {}}', b'{"do": "begin", "without": [[]]}', b" " * 100_000,
    b'{"do": "connect", "controller": {}}', b'{"set": {"friction": {"mu_static": 1}}}', b'{"get": ["\\ud800"]}',
)  # fmt: skip


def token(rng: random.Random) -> Arrived:
    """One sign of life that is wrong, or of somebody who comes and goes."""
    name = rng.choice(TOPICS) if rng.random() < 0.5 else f"alive/controller/x{rng.randrange(10_000)}"
    return Arrived(rng.choice(USERS), name, put=rng.random() < 0.7)


def question(rng: random.Random) -> bytes:
    """The text of one question that makes no sense."""
    if rng.random() < 0.9:
        return rng.choice(QUESTIONS)
    return json.dumps({rng.choice(("do", "set", "get", "controller")): rng.choice(NUMBERS)}).encode()


MANY = [3_000, pytest.param(120_000, marks=pytest.mark.slow)]


class Stranger:
    """Hands things to one session of a Twin past everything that a sender checks, as fast as they are taken."""

    def __init__(self, hub, victim, seed):
        self.hub, self.inbound, self.rng = hub, victim.inbound, random.Random(seed)
        self.sent = 0

    def send(self, count, alive=lambda: True):
        for _ in range(count):
            if not alive():
                return
            found = message(self.rng)
            for receiver in self.hub.receivers:
                if receiver.inbound is self.inbound:
                    receiver.queue.put(found)
                    while receiver.queue.qsize() > 200 and receiver.patterns != ("total/*",) and alive():
                        time.sleep(0.0005)
            for _, watch in self.hub.watches:
                if watch.inbound is self.inbound:
                    watch.queue.put(token(self.rng))
            if self.rng.random() < 0.1:
                for topic, server in list(self.hub.servers.items()):
                    if server.inbound is self.inbound and server.queue.qsize() < 20:
                        server.queue.put(Asked(Arrived("stranger", topic, question(self.rng))))
            self.sent += 1


@pytest.mark.parametrize("count", MANY)
def test_a_plant_survives_and_its_controller_commands_as_if_nobody_else_spoke(count):
    scene = scenes.load("belt_normal_force")
    hub = Twin("fuzz")
    job = Job(scene.to_json(), pace=None, duration=1e6, wait=5.0, expect=(("controller", "nf"),))
    session, done, found = hub.open("plant", "plant"), threading.Event(), []
    plant = Plant(session, job, lambda: "done" if done.is_set() else "")
    session.announce()

    def run():
        plant.gather(lambda _: None)
        found.append(plant.run(lambda _: None))

    def control():
        with hub.open("controller", "nf") as mine:
            described = fetch(mine)
            Worker(mine, described, controllers.restored(described.controllers["nf"])).follow(done.is_set)

    threads = [threading.Thread(target=each, daemon=True) for each in (run, control)]
    for thread in threads:
        thread.start()
    stranger = Stranger(hub, session, count)
    stranger.send(count, lambda: all(thread.is_alive() for thread in threads))
    assert stranger.sent == count
    ask = hub.open("operator", "test").ask
    assert ask("param/plant", {"get": ["load.force"]}, 5.0)["values"]
    done.set()
    for thread in threads:
        thread.join(30.0)
    summary = found[0]
    assert summary["exit_code"] == ExitCode.INTERRUPTED  # stopped long before its end, and nothing else
    assert summary["loop"]["nf"]["taken"] > 0
    assert sum(summary["refused"].values()) > count / 2
    assert len(summary["refused"]) < 100  # bounded, however many names were made up
    assert not any("e+" in topic or len(topic) > 100 for topic in summary["lost"])
    assert all(number < FASTEST for number in summary["lost"].values())


def described():
    scene = scenes.load("belt_normal_force")
    told = design.described(scene)
    outputs, sensors = {"displacement": "m", "velocity": "m/s"}, {"vibrometer": ("m/s", MS)}
    return Setup("fuzz", scene.to_json(), MS, MS, outputs, sensors, told)


@pytest.fixture
def followed():
    """A plant that answers who asks, on a Twin, with what follows it in a thread."""
    hub = Twin("fuzz")
    plant, setup = hub.open("plant", "plant"), described()
    server = plant.serve("scene", lambda _: setup.to_json())
    plant.announce()
    stop = threading.Event()

    def serve():
        while not stop.is_set():
            server.poll(0.01)

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    yield hub, plant
    stop.set()
    thread.join(5.0)
    plant.close()


@pytest.mark.parametrize("count", MANY)
def test_a_controller_answers_the_next_step_whatever_came_before(followed, count):
    hub, plant = followed
    mine, acts, stop = hub.open("controller", "nf"), plant.subscribe("act/nf"), threading.Event()
    setup = fetch(mine)
    worker = Worker(mine, setup, controllers.restored(setup.controllers["nf"]))
    thread = threading.Thread(target=worker.follow, args=(stop.is_set,), daemon=True)
    thread.start()
    step, tick = plant.publisher("step"), 0
    stranger = Stranger(hub, mine, count)
    for _ in range(10):
        stranger.send(count // 10, thread.is_alive)
        acts.drain()
        tick = worker.tick + 1
        step.put(encode.step(tick, tick * MS, [0.01], np.ones(1, np.int64)), tick * MS)
        answer = acts.get(5.0)
        while answer is not None and answer.said.tick != tick:
            answer = acts.get(5.0)
        assert answer is not None
    stop.set()
    thread.join(5.0)
    assert mine.inbound.total > count / 4
    assert tick < 10**9


@pytest.mark.parametrize("count", MANY)
def test_a_recorder_writes_what_can_be_read(followed, count, tmp_path):
    hub, plant = followed
    mine, stop, found = hub.open("recorder", "recorder"), threading.Event(), []
    heard, watch = mine.subscribe("**", depth=1 << 17), mine.watch("plant/*")
    setup = fetch(mine)
    recorder = RunRecorder(mine, setup, heard, watch, Writer(tmp_path / "run.mcap", setup, "recorded"))
    watch.wait_for("plant", "plant", 5.0)
    thread = threading.Thread(target=lambda: found.append(recorder.run(stop)), daemon=True)
    thread.start()
    state, pack, measured = plant.publisher("state"), encode.StateEncoder(2), plant.publisher("meas/vibrometer")
    for k in range(10):
        state.put(pack(k * MS, k, 0, np.array([k, -k], float)), k * MS)
        measured.put(encode.block(k, k * MS, MS, [float(k)]), k * MS)
        plant.flush()
        Stranger(hub, mine, count + k).send(count // 10, thread.is_alive)
    time.sleep(0.1)
    stop.set()
    thread.join(20.0)
    (recording,) = found
    assert sum(recording.refused.values()) > count / 2
    assert recording.lost < 10 * FASTEST
    run = reader.open(tmp_path / "run.mcap")
    assert not run.fault
    assert {-k for k in range(10)} <= set(run.signals["velocity"].tolist())


@pytest.mark.parametrize("count", MANY)
def test_a_viewer_goes_on_drawing(followed, count):
    rr = pytest.importorskip("rerun")
    from rig.view.process import Bridge

    hub, _ = followed
    mine, stop, found = hub.open("viewer", "viewer"), threading.Event(), []
    bridge = Bridge(mine)
    rec = rr.RecordingStream("fuzz", recording_id="fuzz")
    rec.memory_recording()
    thread = threading.Thread(target=lambda: found.append(bridge.run(rec, stop)), daemon=True)
    thread.start()
    Stranger(hub, mine, count).send(count, thread.is_alive)
    stop.set()
    thread.join(20.0)
    assert found[0].ended == "told to stop"
    assert found[0].refused > count / 4


def test_a_step_far_ahead_does_not_silence_a_controller(followed):
    hub, plant = followed
    mine = hub.open("controller", "nf")
    setup = fetch(mine)
    worker = Worker(mine, setup, controllers.restored(setup.controllers["nf"]))
    step = plant.publisher("step")
    for tick in (0, 10**12, 1):
        step.put(encode.step(tick, tick * MS, [0.01], np.ones(1, np.int64)), tick * MS)
        if (told := worker.steps.get()) is not None:
            worker.answer_step(told.said)
    assert worker.tick == 1
    assert mine.inbound.refusals() == {"plant on step: implausible tick": 1}
