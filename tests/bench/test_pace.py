"""Pacing, on a clock that obeys the test."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.bench.live.machine_load import advice
from rig.bench.live.pace import Pacer

MS = 1_000_000


class FakeClock:
    """Waits take no time and end exactly at the deadline, plus `oversleep`."""

    def __init__(self):
        self.time = 5_000_000_123
        self.oversleep = 0

    def now(self):
        return self.time

    def until(self, deadline):
        self.time = max(self.time, deadline) + self.oversleep
        return self.time

    def work(self, ns):
        self.time += ns


def paced(policy="catch-up", pace=1.0, frame_ns=MS, **more):
    clock = FakeClock()
    pacer = Pacer(frame_ns, pace, policy, clock, **more)
    pacer.anchor()
    return clock, pacer


def test_deadlines_do_not_drift():
    clock, pacer = paced(pace=3.0)
    begin = clock.now()
    clock.oversleep = 40_000
    for _ in range(30_001):
        _, late = pacer.wait()
        clock.work(17_000)
    assert late == 40_000
    assert clock.now() - begin == 10_000 * MS + 40_000 + 17_000


@given(
    policy=st.sampled_from(["catch-up", "skip", "slow"]),
    spans=st.lists(st.integers(0, 300 * MS), min_size=1, max_size=40),
)
def test_time_is_never_lost_unsaid(policy, spans):
    clock, pacer = paced(policy)
    begin = clock.now()
    for span in spans:
        pacer.wait()
        clock.work(span)
    while True:
        now, late = pacer.wait()
        if late <= MS:
            break
    owed = now - begin - late - pacer.frame * MS
    told = sum(one.late_ns if policy == "slow" else one.frames * MS for one in pacer.given_up)
    assert owed == told
    assert 0 <= late <= MS


@pytest.mark.parametrize(
    ("policy", "given_up", "then", "stopped"),
    [("skip", 2, 4 * MS, False), ("slow", 2, int(4.4 * MS), False), ("stop", 0, int(3.4 * MS), True)],
)
def test_an_overrun_is_handled_by_the_policy(policy, given_up, then, stopped):
    clock, pacer = paced(policy)
    start, _ = pacer.wait()
    clock.work(int(3.4 * MS))
    assert pacer.wait()[1] == int(2.4 * MS)
    assert pacer.wait()[0] - start == then
    assert (pacer.frames_given_up, pacer.stopped) == (given_up, stopped)


BUSY = {"others": 0.62, "host": 0.05}


def test_a_busy_machine_is_told_in_one_line():
    text = advice("INVALID", 0.2, BUSY)
    assert "\n" not in text
    assert "other programs took 62%" in text
    assert "the host of this machine took 5%" in text
    assert "run again" in text

    assert "host" not in advice("INVALID", 0.2, {"others": 0.62, "host": 0.001})  # rounds to nothing
    assert "not busy" in advice("DEGRADED", 0.03, {"others": 0.05, "host": 0.0})
