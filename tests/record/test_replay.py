"""A recording into a controller once more: same bytes in, same answers out, or the first that is not."""

import threading
import time

import numpy as np
import pytest
from twin import Twin

from rig import bus
from rig.bus import encode, messages
from rig.bus.run_setup import fetch
from rig.errors import BusError
from rig.record import reader
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
    writer = Writer(folder / "recorded.mcap", reader.head(folder / "saved.mcap").setup(), "recorded")
    for k in range(FRAMES):
        now, latest = k * 1_000_000, np.array([fast[10 * k], slow[k]])
        writer.write("meas/slow", encode.block(k, now, 1_000_000, slow[k : k + 1]), now, k, now)
        writer.write("step", encode.step(k, now, latest, np.array([10, 1])), now, k, now)
        writer.write("act/feedback", encode.act(k, now, given[k]), now, k, now)
        if k == TUNED_AFTER:
            writer.write("event/feedback", messages.event(**run.events[0]), now, 0, now)
    writer.close({}, {})
    return folder


def control(me, gain=2.0, dies_at=FRAMES + 1, held_up_at=FRAMES + 1):
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
        if step.tick == dies_at:
            me.close()
            return
        if step.tick == held_up_at:
            time.sleep(0.1)
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
    found = replay(hub, logs / log, into=["feedback"])
    assert found.divergence is None
    assert found.compared == {"feedback": FRAMES if log == "recorded.mcap" else FRAMES * 4 // 5}  # some were clamped
    assert (found.unanswered, found.fault) == (0, "")
    assert found.steps >= FRAMES


def test_another_gain_parts_at_its_first_answer(stage, logs):
    hub, start = stage
    start(gain=np.nextafter(2.0, 3.0))
    found = replay(hub, logs / "recorded.mcap", into=["feedback"])
    where = found.divergence
    assert (where.topic, where.tick) == ("act/feedback", 0)
    assert where.recorded[1] == where.answered[1]
    assert where.recorded[0] != where.answered[0]
    assert "differs at tick 0, t = 0 s" in str(where)


def test_a_paced_replay_keeps_time_and_compares_too(stage, logs):
    hub, start = stage
    start()
    found = replay(hub, logs / "recorded.mcap", into=["feedback"], pace=2.0)
    assert found.divergence is None
    assert found.compared["feedback"] + found.unanswered == FRAMES
    assert found.compared["feedback"] > 0


def test_a_change_of_parameters_does_not_overtake_steps_that_wait(stage, logs):
    hub, start = stage
    start(held_up_at=TUNED_AFTER - 10)  # 5 ms before it is tuned
    found = replay(hub, logs / "recorded.mcap", into=["feedback"], pace=2.0)
    assert found.divergence is None
    assert (found.compared, found.unanswered) == ({"feedback": FRAMES}, 0)


def test_a_controller_that_leaves_ends_the_replay(stage, logs):
    hub, start = stage
    start(dies_at=100)
    with pytest.raises(BusError, match="feedback left at tick 100"):
        replay(hub, logs / "recorded.mcap", into=["feedback"])


def test_a_controller_that_never_comes_is_told(stage, logs):
    hub, _ = stage
    with pytest.raises(BusError, match="feedback did not join the replay"):
        replay(hub, logs / "recorded.mcap", into=["feedback"], wait=0.1)


def test_a_controller_that_the_recording_does_not_know_may_listen(stage, logs):
    hub, start = stage
    start(name="mine")
    found = replay(hub, logs / "recorded.mcap", into=["mine"])
    assert (found.steps, found.compared, found.unanswered, found.divergence) == (FRAMES, {"mine": 0}, 0, None)


@pytest.mark.parametrize(
    "data", ['{"set": {"gain": 9.0}}', '{"after_tick": 3}', '{"after_tick": "x", "set": 5}', "", "[]"]
)
def test_an_event_of_a_controller_that_says_too_little_is_passed_over(logs, tmp_path, data):
    start = reader.head(logs / "recorded.mcap")
    writer = Writer(tmp_path / "odd.mcap", start.setup(), "recorded")
    odd = messages.TYPES["Event"](source="feedback", kind="parameter", text="?", data=data).SerializeToString()
    writer.write("event/feedback", odd, 0, 0, 0)
    for record in reader.Scan(logs / "recorded.mcap"):
        writer.write(record.topic, record.payload, record.t_ns, record.seq, record.log_ns)
    writer.close({}, {})
    twin = Twin("replay")
    me = twin.open("controller", "feedback")
    thread = threading.Thread(target=lambda: _closing(me, {}))
    thread.start()
    with twin.open("plant", "plant") as hub:
        found = replay(hub, tmp_path / "odd.mcap", into=["feedback"])
    thread.join(5.0)
    assert (found.divergence, found.compared, found.fault) == (None, {"feedback": FRAMES}, "")


def test_listeners_get_the_recorded_bytes(logs):
    twin = Twin("replay")
    heard = twin.open("viewer", "v").subscribe("**", depth=10_000)
    found = replay(twin.open("plant", "plant"), logs / "recorded.mcap")
    sent = [
        (r.topic, r.payload, r.t_ns) for r in reader.Scan(logs / "recorded.mcap") if r.topic in ("step", "meas/slow")
    ]
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
