"""The pace that holds on a machine: what a run takes, and what its user is told before the start."""

import pytest

from rig import scenes
from rig.bench.live import supervise
from rig.bench.live.frame_cost import BESIDE_NS, MOST, FrameCost, kept_pace
from rig.bench.live.outcome import AUTO, Job
from rig.bench.live.pace import length
from rig.bench.live.rehearsal import rehearse
from rig.errors import UsageError

SLOW = FrameCost((3e6,) * 10, 1.0)
"""Frames of 1 ms that take 3 ms."""


@pytest.fixture(scope="module")
def belt():
    return scenes.load("belt")


def test_a_frame_is_busy_with_its_own_time_and_that_of_its_messages(belt):
    assert SLOW.busy(belt, 1.0) == pytest.approx((3e6 + BESIDE_NS) / 1e6)
    assert SLOW.busy(belt, 0.1) == pytest.approx((3e6 + BESIDE_NS) / 1e7)


@pytest.mark.parametrize("name", ["belt", "plate", "brake_active", "belt_normal_force"])
@pytest.mark.parametrize("frame_ns", [100.0, 4e4, 1.4e6, 7.7e7])
def test_the_pace_that_holds_is_the_largest_of_two_digits(name, frame_ns):
    scene, cost = scenes.load(name), FrameCost((frame_ns,), 1.0)
    pace = cost.holding(scene, 20.0)
    assert cost.busy(scene, pace) <= MOST
    assert pace == 20.0 or float(f"{pace:.2g}") == pace
    assert pace == 20.0 or cost.busy(scene, 1.11 * pace) > MOST or length(scene, 1.11 * pace) > length(scene, pace)


def test_a_burst_that_may_be_late_does_not_slow_the_rest(belt):
    burst = (*(1e5,) * 200, 5e6)
    assert FrameCost(burst, 20.0).busy(belt, 1.0) < MOST
    assert FrameCost((*burst, 5e6, 5e6), 20.0).busy(belt, 1.0) > 1.0


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


def test_a_rehearsal_measures_each_part_of_the_run_without_what_it_builds(belt):
    rehearsal = rehearse(belt, Job(belt.to_json(), duration=3.0))
    cost = rehearsal.cost
    assert len(rehearsal.sets) > 1
    assert (cost.whole, cost.seconds, len(cost.means_ns)) == (True, 3.0, 25)  # twice as far apart after two seconds
    assert 1e3 < min(cost.means_ns) < 1e6  # a mode set takes longer to build


def test_in_lockstep_a_frame_waits_for_every_controller(tmp_path):
    (tmp_path / "slow.py").write_text(
        "import time\n\n\nclass Controller:\n"
        "    reads, drives, period_ns = ('vibrometer',), ('load.force',), 1_000_000\n\n"
        "    def start(self):\n        return 0\n\n"
        "    def update(self, state, t_ns, values):\n"
        "        end = time.thread_time_ns() + 2_000_000\n"
        "        while time.thread_time_ns() < end:\n            pass\n"
        "        return state, (20.0,)\n"
    )
    scene = scenes.load("belt", {"controllers.slow.kind": str(tmp_path / "slow.py")})
    paced, in_lockstep = (
        rehearse(scene, Job(scene.to_json(), duration=0.2, lockstep=lockstep)).cost.frame_ns(scene)
        for lockstep in (False, True)
    )
    assert paced < 1e6 < 2e6 < in_lockstep


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
