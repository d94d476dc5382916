"""The pace that holds on a machine: what a run takes, and what its user is told before the start."""

import pytest

from rig import scenes
from rig.bench.live import supervise
from rig.bench.live.frame_cost import FrameCost, kept_pace
from rig.bench.live.outcome import AUTO, Job
from rig.errors import UsageError

SLOW = FrameCost((3e6,) * 10, 1.0)
"""Frames of 1 ms that take 3 ms."""


@pytest.fixture(scope="module")
def belt():
    return scenes.load("belt")


def test_a_pace_that_does_not_hold_is_told_before_the_start_and_kept(belt):
    pace, told = kept_pace(belt, 1.0, SLOW, adapts=False)
    assert pace == 1.0
    assert "a frame of 1 ms is 315% busy on this machine, and frames will be late; a pace of 0.28 holds" in told
    assert "--pace 0.28, or --pace auto" in told
    assert "frames may be late" in kept_pace(belt, 0.3, SLOW, adapts=False)[1]
    assert kept_pace(belt, 0.28, SLOW, adapts=False) == (0.28, "")
    part = FrameCost(SLOW.means_ns, 0.25, whole=False)
    assert "in the first 0.25 s of the run" in kept_pace(belt, 1.0, part, adapts=False)[1]


def test_an_automatic_pace_is_real_time_or_what_holds_within_the_limit_of_the_scene(belt):
    assert kept_pace(belt, 1.0, SLOW, adapts=True)[0] == 0.28
    assert kept_pace(belt, 1.0, FrameCost((1e5,), 1.0), adapts=True)[0] == 1.0
    limited = scenes.load("belt", {"clock.pace_limit": 0.5})
    fast = scenes.load("belt", {"clock.pace_limit": 2.0})
    jobs = [Job.at(AUTO, scene) for scene in (belt, limited, fast)]
    assert [(job.pace, job.adapts) for job in jobs] == [(1.0, True), (0.5, True), (1.0, True)]
    assert Job.from_json(jobs[1].to_json()) == jobs[1]
    assert (Job.at(None, belt).pace, Job.at(3.0, limited).adapts) == (None, False)


def test_a_run_says_that_its_pace_does_not_hold_and_an_automatic_one_takes_what_does(runs):
    heavy = scenes.load("plate_cea", {"clock.pace_limit": 1000})
    said = []
    outcome = supervise.run(heavy, pace=1000.0, duration=0.05, record=False, say=said.append)
    assert outcome.summary["pace"] == 1000.0
    assert [line for line in said if line.startswith("warning: at a pace of 1000 ")]
    said.clear()
    outcome = supervise.run(heavy, pace=AUTO, duration=0.05, record=False, say=said.append)
    assert 0.0 < outcome.summary["pace"] <= 1.0
    assert said[0].startswith(f"pace {outcome.summary['pace']:g}: ")


def test_an_automatic_pace_is_asked_for_by_its_word_alone():
    from rig.cli.options import live_pace, pace

    assert (live_pace("auto", False), live_pace("max", False), live_pace("0.5", True)) == (AUTO, None, 0.5)
    with pytest.raises(UsageError, match=r'--pace is .fast.; expected a number, "auto" or "max"'):
        live_pace("fast", False)
    with pytest.raises(UsageError, match=r"--pace is .auto.; expected a number, or .max."):
        pace("auto")  # a recording is played at a stated pace
