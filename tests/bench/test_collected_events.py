"""A run in large pieces has every event of a run frame by frame, once, however little room there is for them."""

from pathlib import Path

import pytest

import rig
from rig.bench.run.runner import PlantRunner
from rig.motion import motion

P1 = Path(__file__).parents[1] / "problems" / "p1.toml"
FRAMES = 4000


def ran(piece):
    runner = PlantRunner(rig.load(str(P1), {"clock.events_per_frame": 4}), truthful=True)
    calls = 0
    while runner.tick < FRAMES:
        runner.frames(min(piece, FRAMES - runner.tick))
        calls += 1
    return runner, calls


def test_events_are_those_of_a_run_frame_by_frame(monkeypatch):
    (one, _), (many, few) = ran(1), ran(FRAMES)
    monkeypatch.setattr(motion, "COLLECTED", 0)  # room for the events of two frames
    crowded, more = ran(FRAMES)
    assert few < more
    assert len(one.truth.events()) == one.motion.counts()["events"] == 38
    for other in (many, crowded):
        assert one.truth.events() == other.truth.events()
        assert (one.motion.x == other.motion.x).all()


def test_a_call_that_is_interrupted_before_it_begins_repeats_no_event(monkeypatch):
    runner, _ = ran(FRAMES)
    count = len(runner.truth.events())
    assert count

    class Interrupted:
        @property
        def handle(self):
            raise KeyboardInterrupt

    monkeypatch.setattr(runner.motion, "mode_sets", Interrupted())
    with pytest.raises(KeyboardInterrupt):
        runner.frames(10)
    assert len(runner.truth.events()) == count
