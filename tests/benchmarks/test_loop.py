"""`make bench`: what the loop over the bus costs beside a bare round trip."""

import pytest

from benchmarks.loop import beside_bare, over_bare


def test_each_run_is_compared_with_the_round_trips_before_and_after_it():
    assert over_bare([30.0, 40.0, 80.0], [10.0, 20.0, 60.0, 100.0]) == [2.0, 1.0, 1.0]


@pytest.mark.slow
def test_a_round_is_a_run_of_each_kind_between_round_trips():
    measured = beside_bare(rounds=1, lockstep_s=0.2, paced_s=0.3, bare_s=0.1)
    rows, ratios = measured["rounds_us"], measured["over_bare"]
    for kind, run, bare in (
        ("lockstep", "lockstep", "bare"),
        ("lockstep_back_to_back", "lockstep", "back_to_back"),
        ("paced", "paced", "bare"),
    ):
        assert (len(rows[run]), len(rows[bare])) == (1, 2)
        assert [ratios[kind]] == over_bare(rows[run], rows[bare])
        assert all(us > 10.0 for us in (*rows[run], *rows[bare]))  # no process answers another one in less
    assert 0.0 < measured["publish_us"] < 1e6
