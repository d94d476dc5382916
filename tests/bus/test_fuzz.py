"""Whatever arrives: plant, controller, recorder and viewer go on, and tell what they refused."""

import json
import random
import threading
import time

import numpy as np
import pytest
from twin import Asked, Twin

from rig import controllers, design, scenes
from rig.bench.job import Job
from rig.bench.plant import Plant
from rig.bus import encode, messages
from rig.bus.arrivals import FASTEST, HEADER, Arrived, Count, Refused
from rig.bus.inbound import InboundCheck
from rig.bus.json_text import DEPTH, read_json
from rig.bus.run_setup import Setup, fetch
from rig.controllers.runtime.process import Worker
from rig.errors import BusError, ExitCode
from rig.record import reader
from rig.record.recorder import RunRecorder
from rig.record.writer import Writer

TOPICS = (
    "step", "batch", "state", "health", "scene", "act/nf", "act/mine", "applied/nf", "meas/vibrometer", "truth/x",
    "event/nf", "event/plant", "total/nf", "total/plant", "total/x", "param/plant", "cmd/plant", "alive/controller/nf",
    "alive/plant/plant", "nonsense/x", "nonsense", "", "/", "//", "act", "act/", "act/*", "**", "act/nf/more",
    "alive", "alive/controller", "alive/controller/nf/more", "alive/king/nf", "act/../../evil x", "act/" + "x" * 300,
    "act/\u00e9\u2028\x00", "event/\ud800",
)  # fmt: skip
USERS = ("plant", "nf", "recorder", "viewer", "operator", "guest-1", "guest-2", "stranger", "", "\ud800", "x" * 1000)
NUMBERS = (0, 1, 2, 999, 10**6, 10**12, 2**53, 2**62, 2**63 - 1, -1, -(2**63))
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


def _told(rng, topic):
    """The bytes of a message whose numbers make no sense."""
    number = lambda: rng.choice(NUMBERS)  # noqa: E731
    reals = [rng.choice((0.0, 1e308, -1e308, float("nan"), float("inf"))) for _ in range(rng.randrange(4))]
    kinds = messages.TYPES
    try:
        kind = messages.topics.of(topic).message
    except BusError:
        kind = rng.choice(list(kinds))
    if kind == "Step":
        said = kinds["Step"](tick=number(), t_ns=number(), values=reals, fresh=[number()], heard=[number()])
    elif kind == "Block":
        said = kinds["Block"](tick=number(), t0_ns=number(), dt_ns=number(), v=reals)
    elif kind == "Event":
        data = rng.choice(("", "{", "[" * 100_000, "[]", '{"a": NaN}', '{"set": 5}'))
        said = kinds["Event"](t_ns=number(), tick=number(), kind=rng.choice(("verdict", "x\x1b[2J")), data=data)
    elif kind == "Totals":
        said = kinds["Totals"](sent_topic=["step", ascii(topic)[:20]], sent=[number()], heard_topic=["step"])
    elif kind == "Batch":
        inner, user = rng.choice(TOPICS[:-1]), rng.choice(USERS).encode(errors="replace").decode()
        places = [rng.choice((0, 0, 0, 1, -1, 2**62)) for _ in range(rng.randrange(3))]
        headers = [HEADER.pack(rng.randrange(50), 0) for _ in places]
        said = kinds["Batch"](user=[user], topic=[inner], place=places, header=headers, said=[b"x"] * rng.randrange(3))
    elif kind == "Checkpoint":
        said = kinds["Checkpoint"](tick=number(), t_ns=number(), state=rng.randbytes(9))
    elif kind in kinds and kind != "Health":
        said = kinds[kind](tick=number(), t_ns=number(), values=reals)
    else:
        said = kinds["Act"](tick=number(), t_ns=number(), values=reals)
    return said.SerializeToString()


def message(rng: random.Random) -> Arrived:
    """One message that is wrong in one way or many."""
    topic = rng.choice(TOPICS)
    try:
        encoding = messages.encoding(topic)
    except BusError:
        encoding = ""
    whole = _told(rng, topic) if rng.random() < 0.7 else rng.randbytes(rng.choice((0, 1, 3, 40, 4000)))
    cut = rng.random()
    payload = whole if cut < 0.6 else whole[: rng.randrange(len(whole) + 1)] + (b"\xff" if cut < 0.8 else b"")
    header = rng.choice((None, b"", b"abc", rng.randbytes(16), HEADER.pack(2**64 - 1, 0), HEADER.pack(0, 2**64 - 1),
                         HEADER.pack(rng.randrange(50), rng.randrange(10**9)), HEADER.pack(0, 0)))  # fmt: skip
    if rng.random() < 0.1:
        encoding = "text/plain"
    return Arrived(rng.choice(USERS), topic, payload, header, rng.random() < 0.9, encoding)


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
MS = 1_000_000


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


@pytest.mark.parametrize(
    ("text", "kind"),
    [(b"{nope", "not JSON"), (b"[" * 200_000, "too long"), (b'{"a":' * 9_000 + b"1" + b"}" * 9_000, "too deep"),
     (b'{"a": NaN}', "not finite"), (b'{"a": -Infinity}', "not finite"), (b'{"a": 1e999}', "not finite"),
     (b'{"a": 1, "a": 2}', "not JSON"), (b"[1]", "not JSON"), (b'{"a": "\xff"}', "not JSON"),
     (b'{"a": "\\ud800"}', "not JSON"), (b'{"a": ' + b"9" * 5000 + b"}", "not JSON"), (b"", "not JSON")],
)  # fmt: skip
def test_json_that_is_no_question_is_refused_with_its_reason(text, kind):
    with pytest.raises(Refused) as found:
        read_json(text)
    assert found.value.kind == kind


def test_json_that_is_a_question_is_read():
    deep = b'{"a":' * (DEPTH - 1) + b'"[[[{{{ \\" ]"' + b"}" * (DEPTH - 1)
    assert read_json(deep)
    assert read_json(b'{"set": {"gain": "0.3 N*s/mm \xc2\xb5"}}') == {"set": {"gain": "0.3 N*s/mm \u00b5"}}


def arrived(topic, payload, seq, t_ns=0, user="plant", **more):
    return Arrived(user, topic, payload, HEADER.pack(seq, t_ns), encoding=messages.encoding(topic), **more)


def test_numbers_that_cannot_be_are_not_counted_as_losses():
    door, counts = InboundCheck(frozenset({"plant"})), {}
    act = encode.act(0, 0, [1.0])
    assert door.message(arrived("act/nf", act, 7, user="nf"), counts).seq == 7
    for seq in (2**64 - 1, 2**63, 10**9, 10**6):
        with pytest.raises(Refused, match="number"):
            door.message(arrived("act/nf", act, seq, user="nf"), counts)
    assert door.message(arrived("act/nf", act, 9, user="nf"), counts).seq == 9
    assert counts["act/nf"] == Count(received=2, lost=1, first=7, last=9, at=counts["act/nf"].at)


@pytest.mark.parametrize("seed", range(4))
def test_the_short_way_in_lets_in_and_counts_what_the_door_would(seed):
    """Most messages are the next of their row and take the short way; the others are left to the door."""
    rng = random.Random(seed)
    strict, short, counts, others = InboundCheck(frozenset({"plant"})), InboundCheck(frozenset({"plant"})), {}, {}
    seq, tick, passed = {"step": 0, "act/nf": 0}, 0, 0
    for _ in range(2000):
        topic, user = rng.choice((("step", "plant"), ("act/nf", "nf")))
        tick += 1
        payload = encode.step(tick, tick * MS, [0.0], np.ones(1, np.int64)) if topic == "step" else _told(rng, topic)
        wrong = rng.random()
        number = seq[topic] if wrong < 0.9 else rng.choice((0, seq[topic] + 2, 2**64 - 1))
        header = HEADER.pack(number, 0 if wrong < 0.97 else 2**64 - 1) if wrong < 0.99 else b"abc"
        payload = payload if rng.random() < 0.97 else payload[: rng.randrange(len(payload) + 1)] + b"\xff"
        found = Arrived(user, topic, payload, header, True, messages.encoding(topic))
        judged = strict.let_in(lambda one: strict.message(one, counts), found)
        row = short.row(user, topic, others)
        message = None if row is None else short.usual(row, header + payload, 0)
        passed += message is not None
        if message is None:
            message = short.let_in(lambda one: short.message(one, others), found)
        assert message == judged or (message[:5] == judged[:5] and repr(message.said) == repr(judged.said))
        if judged is not None:
            seq[topic] = number + 1
    assert 500 < passed < 2000
    assert strict.refused == short.refused
    told = [{t: (c.received, c.lost, c.first, c.last, c.tick) for t, c in one.items()} for one in (counts, others)]
    assert told[0] == told[1]


def test_a_backlog_that_is_read_at_one_instant_is_let_in(monkeypatch):
    """A process was stopped for 12 s: some of what was sent meanwhile arrives, more is dropped, then comes the rest."""
    door, counts, now = InboundCheck(frozenset({"plant"})), {}, 1000.0
    monkeypatch.setattr("rig.bus.inbound.time.monotonic", lambda: now)

    def step(tick, seq=None):
        payload = encode.step(tick, tick * MS, [0.0], np.ones(1, np.int64))
        door.message(arrived("step", payload, tick if seq is None else seq), counts)

    step(0)
    now += 12.0
    for tick in (*range(1, 500), *range(6_000, 6_100), *range(11_990, 12_000)):
        step(tick)
    assert counts["step"].lost == 12_000 - 610
    for tick, seq in ((12_000, 2**63), (12_000, 10**9), (10**12, 12_000)):
        with pytest.raises(Refused) as found:
            step(tick, seq)
        assert "implausible" in found.value.kind
    step(12_000)


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


@pytest.mark.parametrize(
    ("user", "topic"),
    [("nf", "act/other"), ("nf", "step"), ("guest-1", "act/nf"), ("guest-1", "event/plant"), ("recorder", "total/nf"),
     ("", "state")],
)  # fmt: skip
def test_nobody_speaks_for_another(user, topic):
    door = InboundCheck(frozenset({"plant", "nf", "recorder", "viewer", "operator"}))
    with pytest.raises(Refused, match="belongs to"):
        door.message(arrived(topic, b"", 0, user=user), {})


def test_a_session_cannot_even_declare_what_belongs_to_another():
    hub = Twin("own")
    mine = hub.open("controller", "mine")
    for topic in ("act/nf", "step", "event/plant"):
        with pytest.raises(BusError, match="cannot publish there"):
            mine.publisher(topic)
    with pytest.raises(BusError, match="cannot publish there"):
        mine.serve("param/plant", lambda body: {})


@pytest.mark.parametrize("key", ["alive", "alive/controller", "alive/controller/x/y", "alive/king/nf", "alive/plant/nf",
                                 "alive/controller/" + "x" * 65, "act/nf"])  # fmt: skip
def test_signs_of_life_of_another_form_are_refused(key):
    hub = Twin("tokens")
    watch = hub.open("plant", "plant").watch()
    watch.queue.put(Arrived("nf", key))
    watch.queue.put(Arrived("nf", "alive/controller/nf"))
    assert [(p.role, p.name) for p in watch.poll()] == [("controller", "nf")]
    assert watch.inbound.total == 1


def test_thousands_of_signs_of_life_fill_nothing():
    hub = Twin("tokens")
    watch = hub.open("plant", "plant").watch()
    for i in range(5000):
        watch.queue.put(Arrived(f"x{i}", f"alive/controller/x{i}"))
    begun = time.monotonic()
    while watch.poll():
        pass
    assert len(watch.present) <= 256
    assert time.monotonic() - begun < 2.0
    assert len(json.dumps(watch.inbound.refusals())) < 5000
