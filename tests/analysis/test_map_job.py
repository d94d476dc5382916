"""The work of a map: parts, workers, interruptions, folders."""

import pickle
import signal
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import rig
from rig.analysis import map as maps
from rig.analysis.axis import Axis
from rig.analysis.map import row as of_map
from rig.analysis.map.job import RUNS, Job, Settings, Unit
from rig.analysis.map.row import Row, Track, units
from rig.analysis.map.steady_state import NAMES
from rig.analysis.pool import Store
from rig.errors import UsageError

POOL = import_module("rig.analysis.pool.carry_out")  # the package has a function of this name
FEW = "drive.speed=0.05:0.45:3"


@pytest.fixture(scope="module")
def job():
    """Four rows of three points: seconds of work."""
    return maps.job(rig.load("belt"), FEW, "load.force=15:30:4", runs=("up", "down"))


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


def test_numbers_do_not_depend_on_how_the_work_is_cut(job, whole, tmp_path):
    work = units(job)
    assert same(whole, {unit: work.compute(unit) for unit in reversed(range(work.total))})
    assert same(whole, computed(pickle.loads(pickle.dumps(job))))


def test_numbers_do_not_depend_on_the_number_of_workers(job, whole, tmp_path):
    told = []
    found = maps.chart(job, tmp_path, workers=2, progress=lambda done, total: told.append((done, total)))
    assert same(whole, Store(found.folder).load())
    assert told[0] == (0, 4)
    assert told[-1] == (4, 4)


def test_a_map_with_one_axis_is_cut_into_parts_that_find_what_the_whole_row_finds():
    """The carried runs are one unit, which holds the growth rates; near and far starts are cut into parts."""
    scene = rig.load("belt")
    axis = Axis.parse("drive.speed=0.1:0.5:12", scene)
    job = Job(scene, axis, None, Settings("displacement"))
    assert job.units == (
        Unit(0, 0, 12, ("up", "down")),
        Unit(0, 0, 10, ("near", "far"), curve=False),
        Unit(0, 10, 12, ("near", "far"), curve=False),
    )
    found = maps.gathered(job, computed(job), Path())
    row = Row(Track(scene, axis, job.settings), Unit(0, 0, 12, RUNS)).run()
    for name in ("high", "share", "spent"):
        assert np.array_equal(found.tables[name][:, 0], row[name], equal_nan=True)
    assert np.array_equal(found.state[:, 0], row["state"])
    assert np.array_equal(found.onsets[0], row["onset"])


def test_the_growth_rates_of_parts_are_those_of_the_whole_row():
    scene = rig.load("belt")
    axis = Axis.parse("drive.speed=0.1:0.5:30", scene)
    job = Job(scene, axis, None, Settings("displacement", runs=("near",)))
    assert [(u.first, u.last) for u in job.units if u.curve] == [(0, 25), (25, 30)]
    found = maps.gathered(job, computed(job), Path())
    row = Row(Track(scene, axis, job.settings), Unit(0, 0, 30, ("near",))).run()
    assert np.array_equal(found.growth[0], row["growth"])
    assert np.array_equal(found.onsets[0], row["onset"])


def test_a_broken_run_goes_on_where_it_was(job, whole, tmp_path, monkeypatch):
    store = maps.store_of(job, tmp_path)
    with store.open(units(job)):
        store.save({1: whole[1], 2: whole[2]})
    (store.folder / "000003.npz").write_bytes(b"half a file")
    asked = []

    def compute(job, unit):
        asked.append(job.units.index(unit))
        return whole[asked[-1]]

    monkeypatch.setattr(of_map, "compute", compute)
    found = maps.chart(job, tmp_path, workers=1)
    assert asked == [0, 3]
    assert same(whole, Store(found.folder).load())
    maps.chart(job, tmp_path, workers=1)
    assert asked == [0, 3]


def test_another_scene_axis_or_setting_is_another_folder(job, tmp_path):
    scene = rig.load("belt")
    others = [
        maps.job(rig.load("belt", {"body.damping": 2.5}), FEW, "load.force=15:30:4", runs=("up", "down")),
        maps.job(scene, FEW, "load.force=15:31:4", runs=("up", "down")),
        maps.job(scene, FEW, "load.force=15:30:4", runs=("up",)),
    ]
    folders = {maps.store_of(one, tmp_path).folder for one in (job, *others)}
    assert len(folders) == 4
    assert maps.store_of(maps.job(scene, FEW, "load.force=15:30:4", runs=("up", "down")), tmp_path).folder in folders


def test_the_batch_of_a_worker_that_is_killed_is_computed_by_another_one(job, whole, tmp_path, monkeypatch):
    started = []
    original = POOL.Child

    def child(*arguments, **named):
        started.append(original(*arguments, **named))
        return started[-1]

    monkeypatch.setattr(POOL, "Child", child)

    def kill(done, total):
        if done == 1:
            started[0].send(signal.SIGKILL)

    found = maps.chart(job, tmp_path, workers=2, progress=kill)
    assert started[0].code == -signal.SIGKILL
    assert all(one.code is not None for one in started)
    assert same(whole, Store(found.folder).load())


def test_a_row_that_ends_its_worker_twice_is_told_and_the_map_goes_on(job, tmp_path):
    work = units(job)
    row = work.given_up(2, "ended its worker twice: worker 1 was killed by SIGSEGV")
    found = maps.gathered(job, {unit: work.compute(unit) if unit != 2 else row for unit in range(4)}, tmp_path)
    assert NAMES[found.state[0, 2, 0]] == "stopped"
    assert "a run had to stop at 3 of 12 points" in found.text()
    assert "ended its worker twice: worker 1 was killed by SIGSEGV" in found.text()


def test_an_interruption_ends_the_workers(job, tmp_path, monkeypatch):
    started = []
    original = POOL.Child
    monkeypatch.setattr(POOL, "Child", lambda *a, **n: started.append(original(*a, **n)) or started[-1])

    def interrupt(done, total):
        if len(started) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        maps.chart(job, tmp_path, workers=2, progress=interrupt)
    assert all(one.code is not None for one in started)


def test_two_runs_of_one_map_keep_apart(job, tmp_path):
    with (
        maps.store_of(job, tmp_path).open(units(job)),
        pytest.raises(UsageError, match="another process computes this at the moment"),
    ):
        maps.chart(job, tmp_path)
