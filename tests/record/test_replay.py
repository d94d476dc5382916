"""A recording into a controller once more: same bytes in, same answers out, or the first that is not."""

import threading
import time

import numpy as np
import pytest
from recorded_loop import FEEDBACK, FRAMES, TUNED_AFTER, Feedback, closing
from twin import Twin

from rig import bus
from rig.bus import messages
from rig.errors import BusError
from rig.record.replay import replay


class Mine(Feedback):
    """It answers every other step."""

    period_ns = 2_000_000


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
        thread.join(5.0)
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


@ON_BOTH
def test_an_operator_is_told_that_the_plant_of_a_replay_is_recorded(stage, loops):
    hub, start = stage
    answers = []

    def ask(me):
        answers.append(me.ask("param/plant", {"list": True}, 3.0))
        for body in ({"set": {"load": 1}}, {"get": ["load"]}):
            with pytest.raises(BusError) as refused:
                me.ask("param/plant", body, 3.0)
            answers.append(str(refused.value))

    start(at_first=ask)
    replay(hub, loops / "recorded.mcap", into=FEEDBACK)
    listed, *refusals = answers
    assert listed == {"values": {}, "units": {}}
    for text in refusals:
        assert "load: this run is a replay, and its plant is recorded." in text
        assert "can be tuned: feedback" in text


def test_an_answer_that_a_controller_could_not_send_is_told(stage, loops):
    hub, start = stage

    def refuse(me):
        said = messages.event(3_000_000, 3, me.name, "not finite", "an answer of feedback is not finite")
        me.publisher(f"event/{me.name}").put(said, 3_000_000)

    start(at_first=refuse)
    found = replay(hub, loops / "recorded.mcap", into=FEEDBACK)
    assert found.not_finite == ("t = 0.003 s: an answer of feedback is not finite",)
    assert found.not_finite[0] in found.text()


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


@pytest.mark.parametrize("pace", [2.0, None])
def test_a_controller_slower_than_the_pace_makes_the_replay_late_and_loses_nothing(stage, loops, pace):
    hub, start = stage
    start(held_up_at=TUNED_AFTER - 10)  # sleeps 0.1 s before it is tuned
    found = replay(hub, loops / "recorded.mcap", into=FEEDBACK, pace=pace)
    assert found.divergence is None
    assert (found.compared, found.unanswered) == ({"feedback": FRAMES}, 0)
    if pace is None:
        assert found.timing is None
    else:
        assert found.timing.worst > 0.09
        assert 0.0 <= found.timing.p50 <= found.timing.p99 <= found.timing.worst
        assert "timing error of the steps: mean" in found.text()


@ON_BOTH
def test_a_controller_that_leaves_ends_the_replay(stage, loops):
    hub, start = stage
    start(dies_at=100)
    with pytest.raises(BusError, match=r"feedback left at tick 100, t = 0\.1 s, without an answer"):
        replay(hub, loops / "recorded.mcap", into=FEEDBACK)


def test_a_controller_that_hangs_ends_the_replay(stage, loops, monkeypatch):
    monkeypatch.setattr("rig.record.replay.PATIENCE_S", 0.5)
    hub, start = stage
    start(silent_from=100)
    begun = time.monotonic()
    with pytest.raises(BusError, match=r"feedback did not answer the step of tick 100, t = 0\.1 s within 0\.5 s"):
        replay(hub, loops / "recorded.mcap", into=FEEDBACK)
    assert 0.5 < time.monotonic() - begun < 10.0


def test_a_controller_that_never_comes_is_told(stage, loops):
    hub, _ = stage
    with pytest.raises(BusError, match="feedback did not join the replay"):
        replay(hub, loops / "recorded.mcap", into=FEEDBACK, wait=0.1)


def test_a_controller_that_the_recording_does_not_know_may_listen(stage, loops):
    hub, start = stage
    start(name="mine")
    found = replay(hub, loops / "recorded.mcap", into={"mine": Mine()})
    assert (found.steps, found.compared, found.unanswered, found.divergence) == (FRAMES, {"mine": 0}, 0, None)
