"""Judgement of the time windows of a map: cycle, sliding, undecided."""

import numpy as np
import pytest

from rig.analysis.map.steady_state import NAMES, Judge, Window, extremes, sticking


def window(travel, slip=1.0, share=0.0, moving=True):
    return Window(-travel, travel, travel, travel, slip, share, 5 if share else 0, 0.3, moving)


def judged(windows, near=False):
    judge = Judge(0.01, near)
    return [NAMES[judge.take(w)] for w in windows]


def test_a_cycle_must_agree_twice():
    assert judged([window(1.0, share=0.3), window(1.0, share=0.3)]) == ["undecided"] * 2
    assert judged([window(1.0, share=0.3)] * 3)[-1] == "stick-slip"
    assert judged([window(1.0 - 1e-3 * k, share=0.3) for k in range(9)])[-1] == "undecided"
    assert judged([window(1.0)] * 3)[-1] == "vibration"


def test_a_near_start_that_hardly_moves_is_not_yet_a_vibration():
    assert judged([window(1.0, slip=0.01)] * 9, near=True)[-1] == "undecided"
    assert judged([window(1.0, slip=0.001), window(0.9, slip=0.0009)], near=True)[-1] == "sliding"


@pytest.mark.parametrize(
    ("travel", "verdict"),
    [
        (1.0 + 0.3 * np.sin(3.0 * np.arange(40.0)), "stick-slip"),
        (1.0 - 0.01 * np.arange(40.0), "undecided"),
        (1.0 + 1.0 / (2.0 + np.arange(40.0)), "undecided"),
    ],
)
def test_at_the_end_of_the_time_a_drift_is_undecided_and_irregular_motion_is_not(travel, verdict):
    judge = Judge(0.01, near=False)
    for value in travel:
        judge.take(window(float(value), share=0.3))
    assert NAMES[judge.at_last()] == verdict


def over_sectors(windows):
    judge = Judge(0.01, near=False, pushed=True)
    return [NAMES[judge.take(w)] for w in windows]


def test_over_sectors_a_cycle_must_live_through_five_turns():
    sticks, slides = window(1.0, share=0.3), window(1.0)
    assert over_sectors([sticks] * 5) == ["undecided"] * 4 + ["stick-slip"]
    assert over_sectors([sticks, sticks, slides, slides])[-1] == "sliding"
    assert over_sectors([window(1.0, slip=0.1), window(1.0, slip=0.2)])[-1] == "undecided"


def test_extremes_are_read_between_samples_but_not_beside_a_corner():
    t = np.arange(0.0, 3.0, 0.01)
    assert extremes(np.sin(2.0 * np.pi * (t + 0.0031))) == pytest.approx((-1.0, 1.0), abs=1e-6)
    corner = np.minimum(np.abs(np.mod(t + 0.0031, 1.0) - 0.5), 0.3)
    assert extremes(corner)[1] == 0.3
    assert 0.0 <= extremes(corner)[0] <= 0.01


def test_the_share_of_sticking_is_that_of_whole_cycles():
    times = np.array([0.5, 1.0, 2.5, 3.0, 4.5, 5.0])  # sticks from 0.5 to 1, 2.5 to 3, 4.5 to 5
    stuck = np.array([False, True, False, True, False, True])
    found = sticking(times, stuck, after=False, span=5.2)
    assert (found.share, found.begins, found.period) == (0.25, 3, 2.0)
    assert sticking(np.zeros(0), np.zeros(0, dtype=bool), after=True, span=2.0).share == 1.0
