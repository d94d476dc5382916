"""The work of a map: parts, workers, interruptions, folders."""

import math
import pickle

import numpy as np
import pytest

import rig
from rig.analysis import map as maps
from rig.analysis.map.job import RUNS
from rig.analysis.map.result import REGIONS
from rig.analysis.map.row import units
from rig.analysis.map.steady_state import NAMES
from rig.analysis.pool import Store

FEW = "drive.speed=0.05:0.45:3"


@pytest.fixture(scope="module")
def job():
    """Four rows of three points: seconds of work."""
    return maps.job(rig.load("belt"), FEW, "load.force=15:30:4", runs=("up", "down"), longest=3.0)


@pytest.fixture(scope="module")
def whole(job):
    """Its units in one batch, in this process."""
    return computed(job)


def computed(job):
    work = units(job)
    return {unit: work.compute(unit) for unit in range(work.total)}


def same(a, b):
    def equal(one, other):
        return np.array_equal(one, other, equal_nan=one.dtype.kind == "f")

    return a.keys() == b.keys() and all(equal(a[u][n], b[u][n]) for u in a for n in a[u])


def test_numbers_do_not_depend_on_the_order_of_the_work_nor_on_the_workers(job, whole, tmp_path):
    work = units(pickle.loads(pickle.dumps(job)))
    assert same(whole, {unit: work.compute(unit) for unit in reversed(range(work.total))})
    told = []
    found = maps.chart(job, tmp_path, workers=2, progress=lambda *now: told.append(now))
    assert same(whole, Store(found.folder).load())
    assert (told[0], told[-1]) == ((0, 4), (4, 4))


def test_a_row_that_ends_its_worker_twice_is_told_and_the_map_goes_on(job, tmp_path):
    work = units(job)
    row = work.given_up(2, "ended its worker twice: worker 1 was killed by SIGSEGV")
    found = maps.gathered(job, {unit: work.compute(unit) if unit != 2 else row for unit in range(4)}, tmp_path)
    assert NAMES[found.state[0, 2, 0]] == "stopped"
    assert "a run had to stop at 3 of 12 points" in found.text()
    assert "ended its worker twice: worker 1 was killed by SIGSEGV" in found.text()


RPM = math.pi / 30.0


def ends(found, row=0):
    """Of the vibration, on the run-up [rpm]."""
    return found.ends[RUNS.index("up"), row] / RPM


@pytest.fixture(scope="module")
def uniform(tmp_path_factory):
    folder = tmp_path_factory.mktemp("maps")
    return rig.map("lever", "drive.speed=0.5 rpm:6 rpm:12", folder=folder, workers=1, runs=("up", "down"))


def test_regions_of_the_uniform_disc(uniform):
    """At 20 N: sliding stable above 2.03444 rpm, stick-slip up to its grazing fold."""
    expected = ["III" if v < 2.03444 else "II" if v < 5.585 else "I" for v in uniform.job.x.shown_values]
    assert [REGIONS[r] for r in uniform.regions[0]] == expected
    assert uniform.onsets[0] / RPM == pytest.approx([2.03444], abs=1e-4)
    assert ends(uniform) == pytest.approx(5.6082372, abs=1e-7)


@pytest.mark.slow
def test_a_sector_ends_stick_slip_earlier_and_leaves_the_loss_of_sliding(tmp_path):
    """45 degrees of another surface at 20 N: 3.37 rpm instead of 5.585 rpm, 2.08 rpm instead of 2.03 rpm."""
    found = rig.map("lever_sector", "drive.speed=1.5 rpm:4.5 rpm:7", folder=tmp_path, workers=1, runs=("up", "down"))
    assert [REGIONS[r] for r in found.regions[0]] == ["III", "III", "II", "II", "I", "I", "I"]
    assert ends(found) == pytest.approx(3.37, abs=0.1)
    assert found.onsets[0] / RPM == pytest.approx([2.03444], abs=1e-4)
