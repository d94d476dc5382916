"""A recording into a controller once more: same bytes in, same answers out, or the first that is not."""

import threading
import time

import numpy as np
import pytest
from patience import PATIENCE_S
from recorded_loop import FEEDBACK, FRAMES, TUNED, TUNED_AFTER, answer, closing
from twin import Twin

from rig import bus
from rig.bus import encode, messages
from rig.errors import BusError
from rig.record.curves import derived
from rig.record.message_scan import Scan
from rig.record.recorded_setup import head, setup_of
from rig.record.replay import replay
from rig.record.writer import Writer

ON_BOTH = pytest.mark.parametrize("stage", ["twin", "zenoh"], indirect=True)


@pytest.fixture
def stage(request, runs):
    """A hub, and a way to start a controller that joins it."""
    twin = Twin("replay") if getattr(request, "param", "twin") == "twin" else None
    hub = twin.open("plant", "plant") if twin else bus.host(scene="replay")
    threads = []

    def start(name="feedback", **how):
        me = twin.open("controller", name) if twin else bus.join(role="controller", name=name)
        threads.append(threading.Thread(target=lambda: closing(me, how)))
        threads[-1].start()

    yield hub, start
    hub.close()
    for thread in threads:
        thread.join(PATIENCE_S)
        assert not thread.is_alive()


@ON_BOTH
@pytest.mark.parametrize("log", ["saved.mcap", "recorded.mcap"])
def test_the_same_controller_gives_the_same_bits(stage, loops, log):
    hub, start = stage
    start()
    found = replay(hub, loops / log, into=FEEDBACK)
    assert found.divergence is None
    assert found.compared == {"feedback": FRAMES if log == "recorded.mcap" else FRAMES * 4 // 5}  # some were clamped
    assert (found.unanswered, found.fault) == (0, "")
    assert found.steps >= FRAMES


def test_another_gain_parts_at_its_first_answer(stage, loops):
    hub, start = stage
    start(gain=np.nextafter(2.0, 3.0))
    found = replay(hub, loops / "recorded.mcap", into=FEEDBACK)
    where = found.divergence
    assert (where.topic, where.tick) == ("act/feedback", 0)
    assert where.recorded[1] == where.answered[1]
    assert where.recorded[0] != where.answered[0]
    assert "differs at tick 0, t = 0 s" in str(where)
    told = found.to_json()
    assert told["divergence"].keys() == {"topic", "tick", "time", "recorded", "answered"}
    assert not told["passed"]


def test_a_controller_that_leaves_ends_the_replay(stage, loops):
    hub, start = stage
    start(dies_at=100)
    with pytest.raises(BusError, match=r"feedback left at tick 100, t = 0\.1 s, without an answer"):
        replay(hub, loops / "recorded.mcap", into=FEEDBACK)


def test_a_controller_that_hangs_ends_the_replay(stage, loops, monkeypatch):
    monkeypatch.setattr("rig.record.replay.PATIENCE_S", 0.5)
    hub, start = stage
    start(silent_from=100)
    with pytest.raises(BusError, match=r"feedback did not answer the step of tick 100, t = 0\.1 s within 0\.5 s"):
        replay(hub, loops / "recorded.mcap", into=FEEDBACK)


def test_a_controller_that_never_comes_is_told(stage, loops):
    hub, _ = stage
    with pytest.raises(BusError, match="feedback did not join the replay"):
        replay(hub, loops / "recorded.mcap", into=FEEDBACK, wait=0.1)


class Threads:
    """The processes of a replay, as threads on the twin; a successor begins with an empty memory."""

    def __init__(self, twin):
        self.twin, self.started, self.me = twin, [], None

    def start(self, name):
        if self.me is not None:
            self.me.close()  # its thread hears nothing any more, and ends with the plant
        self.me = self.twin.open("controller", name)
        self.started.append(threading.Thread(target=closing, args=(self.me, {})))
        self.started[-1].start()

    def ended(self):
        return []


def lives(path, loops, joined, killed, successor, lost=()):
    """The recording without the commands while no controller was there; a new process joined at the last tick."""
    writer, state, number = Writer(path, setup_of(head(loops / "recorded.mcap")), "recorded"), 0.0, 0
    for record in Scan(loops / "recorded.mcap"):
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
        thread.join(PATIENCE_S)
    return found, threads


def part(loops, path, begin_ns):
    """The recording from `begin_ns` on."""
    writer = Writer(path, setup_of(head(loops / "recorded.mcap")), "recorded")
    for record in Scan(loops / "recorded.mcap"):
        if record.t_ns >= begin_ns and not derived(record.topic):
            writer.write(*record)
    writer.close({}, {})
    return path


def test_a_late_joiner_joins_late_again(loops, tmp_path):
    found, threads = replayed(lives(tmp_path / "late.mcap", loops, 150, FRAMES, FRAMES))
    assert (found.divergence, found.unanswered, found.silent) == (None, 0, {"feedback": 0})
    assert (found.compared, found.unknown_memory) == ({"feedback": FRAMES - 150}, ())
    assert len(threads.started) == 1


def test_a_killed_controller_and_its_successor_are_two_processes_again(loops, tmp_path):
    found, threads = replayed(lives(tmp_path / "killed.mcap", loops, 0, 100, 200))
    assert (found.divergence, found.unanswered, found.silent) == (None, 0, {"feedback": 0})
    assert found.compared == {"feedback": FRAMES - 100}
    assert len(threads.started) == 2


def test_steps_that_a_controller_lost_are_told_and_show(loops, tmp_path):
    found, _ = replayed(lives(tmp_path / "lost.mcap", loops, 0, FRAMES, FRAMES, lost=(120, 121)))
    assert (found.silent, found.unknown_memory) == ({"feedback": 2}, ())
    assert found.divergence.tick == 122  # its memory had not seen two steps
    assert "2 steps have no recorded command of feedback" in found.text()


def test_a_recording_that_begins_late_begins_at_once_and_lacks_the_memory_of_its_controllers(loops, tmp_path):
    path = part(loops, tmp_path / "late.mcap", 390_000_000)
    begun = time.monotonic()
    found = replay(Twin("replay").open("plant", "plant"), path, pace=0.01)
    assert found.steps == FRAMES - 390
    assert 0.88 < time.monotonic() - begun < 20.0  # 9 ms of simulated time; with the 390 ms before them, 40 s
    found, _ = replayed(path)
    assert found.unknown_memory == ("feedback",)
    assert found.divergence.tick == 390
    assert "feedback ran before the recording began" in found.text()


def test_listeners_get_the_recorded_bytes(loops):
    twin = Twin("replay")
    heard = twin.open("viewer", "v").subscribe("**", depth=10_000)
    found = replay(twin.open("plant", "plant"), loops / "recorded.mcap")
    sent = [(r.topic, r.payload, r.t_ns) for r in Scan(loops / "recorded.mcap") if not derived(r.topic)]
    got = [(m.topic, m.payload, m.t_ns) for m in heard.drain()]
    assert got[:-1] == sent
    assert got[-1][0] == "total/plant"
    assert found.messages == len(sent)
