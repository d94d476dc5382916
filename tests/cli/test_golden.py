"""The golden recordings hold: every one is whole, stands in the table, and comes out the same when simulated again."""

from pathlib import Path

import numpy as np
import pytest

import rig
from rig.bench.verify import verify

FOLDER = Path(__file__).parents[2] / "recordings" / "golden"
GOLDEN = sorted(FOLDER.glob("*.mcap"))
MB = 1 << 20


def test_they_are_small_and_stand_in_the_table():
    table = (FOLDER.parent / "README.md").read_text()
    assert GOLDEN
    assert all(path.stat().st_size < MB for path in GOLDEN)
    assert sum(path.stat().st_size for path in GOLDEN) < 5 * MB
    assert all(f"`golden/{path.name}`" in table for path in GOLDEN)


@pytest.mark.parametrize("path", GOLDEN, ids=lambda path: path.stem)
def test_a_golden_recording_holds(path):
    found = verify(path)
    assert found.passed, found.text()
    assert found.compared > 10_000


def test_the_pendulum_shows_the_cycle_and_its_break_down():
    run = rig.open(FOLDER / "pendulum.mcap")
    v, t = run.signals["velocity"], run.time
    cycle, after = v[(t > 6.0) & (t < 8.0)], v[t > 8.8]
    assert np.ptp(cycle) == pytest.approx(0.06 + 0.1012989, rel=0.01)  # limit cycle of characteristic A
    assert np.ptp(after) < 0.01
    assert run.summary["verdict"] == "VALID"
