"""`make bench`: what the loop over the bus costs beside a bare round trip."""

import math
import statistics

from rig.qualify.benchmarks.loop import beside_bare


def test_each_run_is_compared_with_the_round_trips_before_and_after_it():
    found = beside_bare(rounds=2, lockstep_s=0.2, paced_s=0.3)
    for kind in ("lockstep", "paced"):
        rows, bare = found["rows"][kind], found["bare"][kind]
        assert len(rows) == len(bare) - 1 == 2
        ratios = [row / ((before + after) / 2) for row, before, after in zip(rows, bare, bare[1:])]
        assert math.isclose(found[f"{kind}_ratio"], statistics.median(ratios))
        assert all(one > 10.0 for one in (*rows, *bare))  # us: no process answers another one in less
    assert 0.0 < found["publish"] < 1e6
