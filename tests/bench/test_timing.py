"""Time keeping: lateness, causes, verdict."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.bench.live.timing import Spread, Timing, TimingVerdict

MS = 1_000_000


def kept(lateness, waited=None, spans=(0, 20_000, 10_000, 0), cpu=40_000, stolen=0):
    """A Timing with one row for each lateness [ns]; `stolen`: what the host took meanwhile [ns]."""
    timing = Timing(MS)
    for i, late in enumerate(lateness):
        begin = i * MS + late
        timing.rows.append((begin, late, True if waited is None else waited[i], *spans, i * cpu))
    timing.fold(stolen)
    return timing


@given(st.lists(st.integers(1, 10**11), min_size=1, max_size=300), st.floats(0.01, 1.0))
def test_quantiles_are_right_to_five_per_cent(values, share):
    spread = Spread()
    array = np.array(values)
    spread.add(array[: len(array) // 2])
    spread.add(array[len(array) // 2 :])
    exact = np.quantile(array, share, method="inverted_cdf")
    assert exact / 1.05 <= spread.quantile(share) <= exact * 1.05
    assert spread.worst == array.max()
    assert spread.mean == pytest.approx(array.mean())


@pytest.mark.parametrize(
    ("late", "word"), [(0, "VALID"), (10, "VALID"), (11, "DEGRADED"), (50, "DEGRADED"), (51, "INVALID")]
)
def test_the_verdict_follows_the_share_of_late_frames(late, word):
    timing = kept([2 * MS] * late + [0] * (1000 - late))
    assert timing.verdict(0.01, 0.05).word == word


def test_a_loss_or_a_fault_degrades():
    timing = kept([0] * 1000)
    assert timing.verdict(0.01, 0.05, {"act/nf": 0}) == TimingVerdict(
        "VALID", ("0.00% of 1000 frames late by more than one frame", "nothing lost")
    )
    assert timing.verdict(0.01, 0.05, {"meas/laser": 2}).word == "DEGRADED"
    assert "lost 2 of meas/laser" in timing.verdict(0.01, 0.05, {"meas/laser": 2}).reasons
    assert timing.verdict(0.01, 0.05, faults=["the controller nf died"]).word == "DEGRADED"
    assert timing.verdict(0.01, 0.05, {"meas/laser": 2}).exit_code == 0
    assert timing.verdict(0.01, 0.05, broken=True).exit_code == 3
    assert kept([2 * MS] * 100).verdict(0.01, 0.05, {"meas/laser": 2}).exit_code == 3


@pytest.mark.parametrize(
    ("waited", "spans", "cpu", "stolen", "cause"),
    [
        (True, (0, 20_000, 10_000, 0), 40_000, 0, "wake"),
        (True, (0, 20_000, 10_000, 0), 40_000, 2 * MS - 1, "wake"),
        (True, (0, 20_000, 10_000, 0), 40_000, 2 * MS, "host"),
        (False, (0, 5 * MS, 10_000, 0), 5 * MS, 0, "plant"),
        (False, (0, 5 * MS, 10_000, 0), 5 * MS, 20 * MS, "plant"),  # it computed all the time
        (False, (0, 5 * MS, 10_000, 0), 1 * MS, 0, "preempted"),
        (False, (0, 5 * MS, 10_000, 0), 1 * MS, 10 * MS, "host"),
        (False, (0, 20_000, 5 * MS, 0), 1 * MS, 0, "publish"),  # a put that waits is no computation
        (False, (0, 20_000, 10_000, 5 * MS), 5 * MS, 0, "serve"),
        (False, (5 * MS, 20_000, 10_000, 0), 5 * MS, 0, "receive"),
    ],
)
def test_an_overrun_has_a_cause(waited, spans, cpu, stolen, cause):
    timing = kept([0, 4 * MS], waited=[True, waited], spans=spans, cpu=cpu, stolen=stolen)
    assert {name for name, count in timing.overruns.items() if count} == {cause}
    assert timing.worst_cause == cause
