"""A recording into a controller once more: same bytes in, same answers out, or the first that is not."""

import dataclasses
import threading
import time

import numpy as np
import pytest
from twin import Twin

from rig import bus
from rig.bus import encode, messages
from rig.bus.run_setup import fetch
from rig.errors import BusError
from rig.record.curves import derived
from rig.record.message_scan import Scan
from rig.record.reader import open as read
from rig.record.recorded_setup import head, setup_of
from rig.record.replay import replay
from rig.record.run import Commands, Run, Samples
from rig.record.save_run import save
from rig.record.writer import Writer

FRAMES = 400
TUNED_AFTER, TUNED = 250, 3.0  # the gain was changed live after this tick


def answer(state, values, gain):
    """A filter with memory, so that a single wrong or missing step shows in all later answers."""
    state = 0.9 * state + (0.0 if np.isnan(values[0]) else values[0])
    return state, (gain * state, values[1])


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """The same closed loop, saved from arrays and recorded message by message."""
    draw = np.random.default_rng(2)
    fast, slow = draw.standard_normal(10 * FRAMES + 1), draw.standard_normal(FRAMES + 1)
    state, given = 0.0, []
    for k in range(FRAMES):
        state, values = answer(state, (fast[10 * k], slow[k]), 2.0 if k <= TUNED_AFTER else TUNED)
        given.append(values)
    ticks = np.arange(FRAMES, dtype=np.int64)
    run = Run(
        scene="{}",
        step_ns=100_000,
        frame_ns=1_000_000,
        time=np.arange(FRAMES + 1) * 1e-3,
        signals={"x": slow},
        units={"x": "m"},
        measurements={
            "fast": Samples(np.arange(fast.size, dtype=np.int64) * 100_000, fast),
            "slow": Samples(np.arange(slow.size, dtype=np.int64) * 1_000_000, slow),
        },
        commands={"feedback": Commands(ticks, ticks, (ticks % 5 == 4).astype(np.int64), np.array(given))},
        events=[
            {
                "t_ns": 0,
                "tick": 0,
                "source": "feedback",
                "kind": "parameter",
                "text": "gain = 3.0",
                "data": {"set": {"gain": TUNED}, "after_tick": TUNED_AFTER},
            }
        ],
    )
    folder = tmp_path_factory.mktemp("logs")
    save(run, folder / "saved.mcap")
    writer = Writer(folder / "recorded.mcap", setup_of(head(folder / "saved.mcap")), "recorded")
    for k in range(FRAMES):
        now, latest = k * 1_000_000, np.array([fast[10 * k], slow[k]])
        writer.write("meas/slow", encode.block(k, now, 1_000_000, slow[k : k + 1]), now, k, now)
        writer.write("step", encode.step(k, now, latest, np.array([10, 1])), now, k, now)
        writer.write("act/feedback", encode.act(k, now, given[k]), now, k, now)
        if k == TUNED_AFTER:
            writer.write("event/feedback", messages.event(**run.events[0]), now, 0, now)
    writer.close({}, {})
    return folder


class Feedback:
    """What a replay needs to know of the controller in `control`."""

    reads, drives, period_ns = ("fast", "slow"), ("a", "b"), 1_000_000


class Mine(Feedback):
    """It answers every other step."""

    period_ns = 2_000_000


FEEDBACK = {"feedback": Feedback()}


def control(me, gain=2.0, dies_at=FRAMES + 1, held_up_at=FRAMES + 1, silent_from=FRAMES + 1, at_first=None):
    """A controller's process in small; answers until the replay ends. A held-up one sleeps once, for 0.1 s."""
    gains = [gain]

    def retune(body):
        gains.append(body["set"]["gain"])
        return {"values": body["set"]}

    steps, plant, server = me.subscribe("step"), me.watch("plant/*"), me.serve(f"param/{me.name}", retune)
    assert plant.wait_for("plant", "plant", 5.0)
    if me.name not in fetch(me).controllers:
        me.ask("cmd/plant", {"do": "admit", "controller": me.name, "period_ns": 2_000_000}, 3.0)
    me.announce()
    state = 0.0
    while ("plant", "plant") in plant.present:
        server.poll()
        said = steps.get(0.01)
        if said is None:
            plant.poll()
            continue
        step = messages.decode("step", said.payload)
        if at_first is not None:
            at_first(me)
            at_first = None
        if step.tick == dies_at:
            me.close()
            return
        if step.tick == held_up_at:
            time.sleep(0.1)
        if step.tick >= silent_from:
            continue
        state, values = answer(state, tuple(step.values), gains[-1])
        if me.name != "feedback" and step.tick % 2:
            continue
        me.publisher(f"act/{me.name}").put(encode.act(step.tick, step.t_ns, values), step.t_ns)


@pytest.fixture(params=["twin", "zenoh"])
def stage(request, runs):
    """A hub, and a way to start a controller that joins it."""
    twin = Twin("replay") if request.param == "twin" else None
    hub = twin.open("plant", "plant") if twin else bus.host(scene="replay")
    threads = []

    def start(name="feedback", **how):
        me = twin.open("controller", name) if twin else bus.join(role="controller", name=name)
        threads.append(threading.Thread(target=lambda: _closing(me, how)))
        threads[-1].start()

    yield hub, start
    hub.close()
    for thread in threads:
        thread.join(5.0)
        assert not thread.is_alive()


def _closing(me, how):
    with me:
        control(me, **how)


@pytest.mark.parametrize("log", ["saved.mcap", "recorded.mcap"])
def test_the_same_controller_gives_the_same_bits(stage, logs, log):
    hub, start = stage
    start()
    found = replay(hub, logs / log, into=FEEDBACK)
    assert found.divergence is None
    assert found.compared == {"feedback": FRAMES if log == "recorded.mcap" else FRAMES * 4 // 5}  # some were clamped
    assert (found.unanswered, found.fault) == (0, "")
    assert found.steps >= FRAMES


def test_an_operator_is_told_that_the_plant_of_a_replay_is_recorded(stage, logs):
    hub, start = stage
    answers = []

    def ask(me):
        answers.append(me.ask("param/plant", {"list": True}, 3.0))
        for body in ({"set": {"load": 1}}, {"get": ["load"]}):
            with pytest.raises(BusError) as refused:
                me.ask("param/plant", body, 3.0)
            answers.append(str(refused.value))

    start(at_first=ask)
    replay(hub, logs / "recorded.mcap", into=FEEDBACK)
    listed, *refusals = answers
    assert listed == {"values": {}, "units": {}}
    for text in refusals:
        assert "load: this run is a replay, and its plant is recorded." in text
        assert "can be tuned: feedback" in text


def test_another_gain_parts_at_its_first_answer(stage, logs):
    hub, start = stage
    start(gain=np.nextafter(2.0, 3.0))
    found = replay(hub, logs / "recorded.mcap", into=FEEDBACK)
    where = found.divergence
    assert (where.topic, where.tick) == ("act/feedback", 0)
    assert where.recorded[1] == where.answered[1]
    assert where.recorded[0] != where.answered[0]
    assert "differs at tick 0, t = 0 s" in str(where)


def test_a_paced_replay_keeps_time_and_compares_too(stage, logs):
    hub, start = stage
    start()
    found = replay(hub, logs / "recorded.mcap", into=FEEDBACK, pace=2.0)
    assert (found.divergence, found.compared, found.unanswered) == (None, {"feedback": FRAMES}, 0)


@pytest.mark.parametrize("pace", [0.5, 20.0, None])
def test_a_controller_slower_than_the_pace_makes_the_replay_late_and_loses_nothing(stage, logs, pace):
    hub, start = stage
    start(held_up_at=TUNED_AFTER - 10)  # sleeps 0.1 s before it is tuned
    found = replay(hub, logs / "recorded.mcap", into=FEEDBACK, pace=pace)
    assert found.divergence is None
    assert (found.compared, found.unanswered) == ({"feedback": FRAMES}, 0)
    if pace is None:
        assert found.timing is None
    else:
        assert found.timing.worst > 0.09
        assert 0.0 <= found.timing.p50 <= found.timing.p99 <= found.timing.worst
        assert "timing error of the steps: mean" in found.text()


def test_a_controller_that_leaves_ends_the_replay(stage, logs):
    hub, start = stage
    start(dies_at=100)
    with pytest.raises(BusError, match=r"feedback left at tick 100, t = 0\.1 s, without an answer"):
        replay(hub, logs / "recorded.mcap", into=FEEDBACK)


def test_a_controller_that_hangs_ends_the_replay(stage, logs):
    hub, start = stage
    start(silent_from=100)
    begun = time.monotonic()
    with pytest.raises(BusError, match=r"feedback did not answer the step of tick 100, t = 0\.1 s within 5 s"):
        replay(hub, logs / "recorded.mcap", into=FEEDBACK)
    assert 5.0 < time.monotonic() - begun < 15.0


def test_a_controller_that_never_comes_is_told(stage, logs):
    hub, _ = stage
    with pytest.raises(BusError, match="feedback did not join the replay"):
        replay(hub, logs / "recorded.mcap", into=FEEDBACK, wait=0.1)


def test_a_controller_that_the_recording_does_not_know_may_listen(stage, logs):
    hub, start = stage
    start(name="mine")
    found = replay(hub, logs / "recorded.mcap", into={"mine": Mine()})
    assert (found.steps, found.compared, found.unanswered, found.divergence) == (FRAMES, {"mine": 0}, 0, None)


@pytest.mark.parametrize(
    "data", ['{"set": {"gain": 9.0}}', '{"after_tick": 3}', '{"after_tick": "x", "set": 5}', "", "[]"]
)
def test_an_event_of_a_controller_that_says_too_little_is_passed_over(logs, tmp_path, data):
    start = head(logs / "recorded.mcap")
    writer = Writer(tmp_path / "odd.mcap", setup_of(start), "recorded")
    odd = messages.TYPES["Event"](source="feedback", kind="parameter", text="?", data=data).SerializeToString()
    writer.write("event/feedback", odd, 0, 0, 0)
    for record in Scan(logs / "recorded.mcap"):
        writer.write(record.topic, record.payload, record.t_ns, record.seq, record.log_ns)
    writer.close({}, {})
    twin = Twin("replay")
    me = twin.open("controller", "feedback")
    thread = threading.Thread(target=lambda: _closing(me, {}))
    thread.start()
    with twin.open("plant", "plant") as hub:
        found = replay(hub, tmp_path / "odd.mcap", into=FEEDBACK)
    thread.join(5.0)
    assert (found.divergence, found.compared, found.fault) == (None, {"feedback": FRAMES}, "")


class Threads:
    """The processes of a replay, as threads on the twin; a successor begins with an empty memory."""

    def __init__(self, twin):
        self.twin, self.started, self.me = twin, [], None

    def start(self, name):
        if self.me is not None:
            self.me.close()
            self.started[-1].join(5.0)
        self.me = self.twin.open("controller", name)
        self.started.append(threading.Thread(target=_closing, args=(self.me, {})))
        self.started[-1].start()

    def ended(self):
        return []


def lives(path, logs, joined, killed, successor, lost=()):
    """The recording without the commands while no controller was there; a new process joined at the last tick."""
    writer, state, number = Writer(path, setup_of(head(logs / "recorded.mcap")), "recorded"), 0.0, 0
    for record in Scan(logs / "recorded.mcap"):
        content = None if derived(record.topic) else messages.decode(record.topic, record.payload)
        if record.topic == "step":
            tick, seen = content.tick, tuple(content.values)
            writer.write(*record)
            if tick in (joined, successor):
                state, number = 0.0, 0
            if (joined <= tick < killed or tick >= successor) and tick not in lost:
                state, values = answer(state, seen, 2.0 if tick <= TUNED_AFTER else TUNED)
                writer.write("act/feedback", encode.act(tick, record.t_ns, values), record.t_ns, number, record.t_ns)
                number += 1
        elif not record.topic.startswith("act/") and content is not None:
            writer.write(*record)
    writer.close({}, {})
    return path


def replayed(path, **how):
    twin = Twin("replay")
    threads = Threads(twin)
    with twin.open("plant", "plant") as hub:
        found = replay(hub, path, FEEDBACK, processes=threads, **how)
    for thread in threads.started:
        thread.join(5.0)
    return found, threads


def test_a_late_joiner_joins_late_again(logs, tmp_path):
    found, threads = replayed(lives(tmp_path / "late.mcap", logs, 150, FRAMES, FRAMES))
    assert (found.divergence, found.unanswered, found.silent) == (None, 0, {"feedback": 0})
    assert (found.compared, found.unknown_memory) == ({"feedback": FRAMES - 150}, ())
    assert len(threads.started) == 1


def test_a_killed_controller_and_its_successor_are_two_processes_again(logs, tmp_path):
    found, threads = replayed(lives(tmp_path / "killed.mcap", logs, 0, 100, 200))
    assert (found.divergence, found.unanswered, found.silent) == (None, 0, {"feedback": 0})
    assert found.compared == {"feedback": FRAMES - 100}
    assert len(threads.started) == 2


def test_steps_that_a_controller_lost_are_told_and_show(logs, tmp_path):
    found, _ = replayed(lives(tmp_path / "lost.mcap", logs, 0, FRAMES, FRAMES, lost=(120, 121)))
    assert (found.silent, found.unknown_memory) == ({"feedback": 2}, ())
    assert found.divergence.tick == 122  # its memory had not seen two steps
    assert "2 steps have no recorded command of feedback" in found.text()


def test_a_step_that_lockstep_repeated_is_one_step(logs, tmp_path):
    writer, number = Writer(tmp_path / "repeated.mcap", setup_of(head(logs / "recorded.mcap")), "recorded"), 0
    for record in Scan(logs / "recorded.mcap"):
        if derived(record.topic):
            continue
        times = 3 if record.topic in ("step", "act/feedback") and record.t_ns in (0, 70_000_000, 399_000_000) else 1
        for _ in range(times):
            number += 1
            writer.write(record.topic, record.payload, record.t_ns, number, record.log_ns)
    writer.close({}, {})
    found, threads = replayed(tmp_path / "repeated.mcap")
    assert (found.divergence, found.unanswered, found.silent) == (None, 0, {"feedback": 0})
    assert (found.steps, found.compared, len(threads.started)) == (FRAMES, {"feedback": FRAMES}, 1)


def test_the_result_as_json_names_topic_tick_time_and_both_values(stage, logs):
    hub, start = stage
    start(gain=2.5)
    told = replay(hub, logs / "recorded.mcap", into=FEEDBACK, pace=20.0).to_json()
    assert told["divergence"].keys() == {"topic", "tick", "time", "recorded", "answered"}
    assert told["timing"].keys() == {"mean", "p50", "p99", "worst"}
    assert not told["passed"]


def test_viewers_need_no_code_of_the_controllers(logs, tmp_path):
    unknown = {"feedback": {"section": {"kind": "nobody_knows"}, "numbers": {}}}
    setup = dataclasses.replace(setup_of(head(logs / "recorded.mcap")), controllers=unknown)
    writer = Writer(tmp_path / "foreign.mcap", setup, "recorded")
    for record in Scan(logs / "recorded.mcap"):
        if not derived(record.topic):
            writer.write(*record)
    writer.close({}, {})
    found = replay(Twin("replay").open("plant", "plant"), tmp_path / "foreign.mcap")
    assert (found.steps, found.fault) == (FRAMES, "")


def test_a_recording_that_begins_late_begins_at_once(logs, tmp_path):
    writer = Writer(tmp_path / "late.mcap", setup_of(head(logs / "recorded.mcap")), "recorded")
    for record in Scan(logs / "recorded.mcap"):
        if record.t_ns >= 300_000_000 and not derived(record.topic):
            writer.write(*record)
    writer.close({}, {})
    begun = time.monotonic()
    found = replay(Twin("replay").open("plant", "plant"), tmp_path / "late.mcap", pace=0.1)
    assert found.steps == FRAMES - 300
    assert 0.98 < time.monotonic() - begun < 3.9  # 0.099 s of simulated time; with the 0.3 s before it, 4 s
    assert found.timing.p50 < 0.5


def test_a_recording_that_begins_late_lacks_the_memory_of_its_controllers(logs, tmp_path):
    writer = Writer(tmp_path / "late.mcap", setup_of(head(logs / "recorded.mcap")), "recorded")
    for record in Scan(logs / "recorded.mcap"):
        if record.t_ns >= 300_000_000 and not derived(record.topic):
            writer.write(*record)
    writer.close({}, {})
    found, _ = replayed(tmp_path / "late.mcap")
    assert found.unknown_memory == ("feedback",)
    assert found.divergence.tick == 300
    assert "feedback ran before the recording began" in found.text()


def test_a_saved_run_has_steps_states_commands_and_events_again(logs):
    twin = Twin("replay")
    heard = twin.open("viewer", "v").subscribe("**", depth=10_000)
    replay(twin.open("plant", "plant"), logs / "saved.mcap")
    got = {}
    for message in heard.drain():
        got.setdefault(message.topic, []).append(message)
    saved = read(logs / "saved.mcap")
    assert [messages.decode("step", m.payload).tick for m in got["step"]] == list(range(FRAMES + 1))
    for name, samples in saved.measurements.items():
        blocks = [messages.decode(f"meas/{name}", m.payload) for m in got[f"meas/{name}"]]
        np.testing.assert_array_equal(np.concatenate([messages.times(block) for block in blocks]), samples.t_ns)
        np.testing.assert_array_equal(np.concatenate([block.v for block in blocks]), samples.v)
    state = messages.state_type(["x"])
    states = [state.FromString(m.payload) for m in got["state"]]
    assert [one.t_ns for one in states] == list(range(0, FRAMES * 1_000_000 + 1, 5_000_000))
    assert [one.x for one in states] == saved.signals["x"][::5].tolist()
    applied = [messages.decode("applied/feedback", m.payload) for m in got["applied/feedback"]]
    known = saved.commands["feedback"]
    assert [(a.tick, a.answered, a.status, *a.values) for a in applied] == [
        (tick, answered, status, *values)
        for tick, answered, status, values in zip(*(column.tolist() for column in known))
    ]
    assert [messages.decode("event/feedback", m.payload).text for m in got["event/feedback"]] == ["gain = 3.0"]


def test_listeners_get_the_recorded_bytes(logs):
    twin = Twin("replay")
    heard = twin.open("viewer", "v").subscribe("**", depth=10_000)
    found = replay(twin.open("plant", "plant"), logs / "recorded.mcap")
    sent = [(r.topic, r.payload, r.t_ns) for r in Scan(logs / "recorded.mcap") if not derived(r.topic)]
    got = [(m.topic, m.payload, m.t_ns) for m in heard.drain()]
    assert got[:-1] == sent
    assert got[-1][0] == "total/plant"
    assert found.messages == len(sent)


def test_a_cut_recording_is_replayed_up_to_the_cut(logs, tmp_path):
    data = (logs / "recorded.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: int(0.9 * len(data))])
    found = replay(Twin("replay").open("plant", "plant"), cut)
    assert "breaks off" in found.fault
