"""The pool of worker processes: nothing is lost or computed in vain, whatever happens to a worker."""

import re
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
from pool_works import counts, trial

from rig.analysis.pool import Store, carry_out
from rig.errors import UsageError, WorkerError

SUPPORT = Path(__file__).parents[1] / "support"


@pytest.fixture(autouse=True)
def path(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(SUPPORT))


def done(work, root, workers=2, progress=None, apart=False):
    store = Store.of(work, root)
    with store.open(work):
        return carry_out(work, store, workers, progress, apart)


def squares(found):
    return {unit: float(arrays["square"][0]) for unit, arrays in sorted(found.items())}


def test_each_unit_is_computed_once_and_the_rest_after_an_interruption(tmp_path):
    work = trial(str(tmp_path), total=30)

    def interrupt(count, total):
        assert total == 30
        if count >= 10:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        done(work, tmp_path, 1, interrupt)
    kept = Store.of(work, tmp_path).load()
    assert 10 <= len(kept) < 30
    told = []
    found = done(work, tmp_path, 1, lambda *now: told.append(now))
    assert told[0] == (len(kept), 30)
    assert told[-1] == (30, 30)
    assert squares(found) == {unit: unit**2 for unit in range(30)}
    assert set(counts(tmp_path).values()) == {1}


def test_a_unit_that_ends_its_worker_is_tried_once_more_and_then_given_up(tmp_path):
    """Some die once or each time, one prints half a line, one reads: others are there, dead ones not stored."""
    does = {"2": "once", "5": "kill", "6": "talk", "7": "read"}
    work = trial(str(tmp_path), total=9, does=does)
    found = done(work, tmp_path)
    expected = {unit: float(unit**2) for unit in range(9) if unit != 5}
    assert {unit: v for unit, v in squares(found).items() if unit in expected} == expected
    assert re.fullmatch(r"ended its worker twice: worker \d+ was killed by SIGKILL", str(found[5]["name"]))
    assert counts(tmp_path)[5] == 2
    assert squares(Store.of(work, tmp_path).load()) == expected


def test_a_fault_ends_the_work_and_what_is_finished_stays(tmp_path):
    work = trial(str(tmp_path), total=6, does={"4": "fault"})
    with pytest.raises(WorkerError, match=r"worker \d: nothing is as it should be. Finished results are kept in"):
        done(work, tmp_path, 1, apart=True)
    kept = squares(Store.of(work, tmp_path).load())
    with pytest.raises(UsageError):
        done(work, tmp_path, 1)
    assert kept.items() <= squares(Store.of(work, tmp_path).load()).items()
    assert all(kept[unit] == unit**2 for unit in kept)


def test_workers_end_when_their_parent_is_killed_and_the_same_call_continues(tmp_path):
    """kill -9, in the middle of long units: none is computed again of the batches that were saved, and none is lost."""
    work = trial(str(tmp_path), total=4, does={"2": "long", "3": "long"})
    code = f"""
from pathlib import Path
from pool_works import trial
from rig.analysis.pool import Store, carry_out
work = trial({str(tmp_path)!r}, total=4, does={{"2": "long", "3": "long"}})
store = Store.of(work, Path({str(tmp_path)!r}))
with store.open(work):
    carry_out(work, store, 2)
"""
    process = subprocess.Popen([sys.executable, "-c", code])
    until = time.monotonic() + 60.0
    while counts(tmp_path).keys() != {0, 1, 2, 3}:
        assert time.monotonic() < until
        time.sleep(0.02)
    workers = psutil.Process(process.pid).children()
    process.kill()
    process.wait(10.0)
    assert len(workers) == 2
    assert not psutil.wait_procs(workers, 10.0)[1]
    assert squares(Store.of(work, tmp_path).load()) == {0: 0.0, 1: 1.0}
    assert squares(done(work, tmp_path)) == {unit: unit**2 for unit in range(4)}
    assert counts(tmp_path) == {0: 1, 1: 1, 2: 2, 3: 2}


def test_a_folder_without_results_is_taken_away_after_an_error(tmp_path):
    work = trial(str(tmp_path), total=3)
    for wrong in (0, 257):
        with pytest.raises(UsageError, match=r"workers = .*: must be a whole number from 1 to 256"):
            done(work, tmp_path / "new" / "studies", wrong)
        assert not (tmp_path / "new").exists()
