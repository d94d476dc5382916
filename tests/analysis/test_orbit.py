"""The plant on its own, in calls whose steps need more room than there is at first."""

import numpy as np
import pytest

import rig
from rig.analysis.orbit import Orbit
from rig.errors import Chatter
from rig.motion.motion import SEGMENTS


def dithered(read=(), **changes):
    scene = rig.load("belt_dither", {"dither.enable": "true", **changes})
    assembly = scene.assemble()
    return Orbit(scene, assembly, assembly.system().start, "dopri5", 1e-12, read)


def test_a_call_of_more_steps_than_there_is_room_for_gets_more_room():
    found, single = dithered(), dithered()
    single.longest = 1
    events, each = [], []
    while found.motion.tick < 200:
        events += found.block()
    while single.motion.tick < found.motion.tick:
        each += single.block()
    assert len(found.motion.segments.start) > SEGMENTS == len(single.motion.segments.start)
    assert [event.what for event in events] == [event.what for event in each]
    times = [[event.tick + event.place for event in some] for some in (events, each)]
    assert times[0] == pytest.approx(times[1], abs=1e-8)
    assert found.motion.x == pytest.approx(single.motion.x, rel=1e-9, abs=1e-12)
    assert found.motion.terms() == pytest.approx(single.motion.terms(), rel=1e-9, abs=1e-12)


def test_what_is_written_down_has_no_gap_where_room_was_made():
    found = dithered()
    one = found.round(0.2)
    start, length, _ = one.dense.segments(0)
    assert len(found.motion.segments.start) > SEGMENTS
    assert start[1:] == pytest.approx((start + length)[:-1], abs=1e-12)
    assert (start + length)[-1] == pytest.approx(0.2, abs=1e-12)
    assert len(one.states) == 201
    assert np.all(np.diff([t for t, _ in one.events]) >= 0.0)


def test_what_stops_a_run_for_another_reason_stops_it():
    """A dither of 150 Hz meets more than one event in a frame of 10 ms, and none or one in each of 1 ms."""
    dithered(**{"clock.events_per_frame": "1"}).round(0.2)
    with pytest.raises(Chatter):
        dithered(**{"clock.events_per_frame": "1", "clock.frame": "10 ms"}).round(0.2)


def test_outputs_that_alone_are_wanted_are_written_down_as_among_all_others():
    one, every = dithered(read=("velocity",)), dithered()
    found, all_of = one.round(0.05).dense, every.round(0.05).dense
    velocity = found.segments(one.outputs.index("velocity"))
    for a, b in zip(velocity, all_of.segments(every.outputs.index("velocity")), strict=True):
        assert np.array_equal(a, b)
    assert sorted(one.outputs) == sorted(every.outputs)
    with pytest.raises(IndexError):
        found.segments(1)
