"""The pool on a real dask cluster on loopback: nothing is lost or counted twice when a worker or the scheduler dies."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pool_works import counts, trial

import rig as lab
from rig.analysis.pool import Store, carry_out, cluster
from rig.analysis.pool.cluster import compare_sources
from rig.analysis.pool.work import sources
from rig.analysis.studies import prepared, study
from rig.errors import UsageError, WorkerError

pytest.importorskip("distributed")
pytestmark = [
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]
SUPPORT = Path(__file__).parents[1] / "support"
ROOT = Path(lab.__file__).parents[1]


class Processes:
    """A scheduler and workers in processes of their own, on loopback."""

    def __init__(self, folder):
        self.folder, self.started = folder, []
        self.scheduler()

    def _start(self, module, *arguments):
        words = [sys.executable, "-m", f"distributed.cli.{module}", *map(str, arguments), "--host", "127.0.0.1"]
        with (self.folder / f"{len(self.started)}.txt").open("w") as said:
            process = subprocess.Popen(
                words,
                stdout=said,
                stderr=said,
                cwd=self.folder,
                env={**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{SUPPORT}"},
            )
        self.started.append(process)
        return process

    def scheduler(self):
        file = self.folder / f"scheduler-{len(self.started)}.json"
        process = self._start("dask_scheduler", "--port", 0, "--no-dashboard", "--scheduler-file", file)
        until = time.monotonic() + 60.0
        while not file.exists() or not file.read_text().strip().endswith("}"):
            assert process.poll() is None, (self.folder / f"{len(self.started) - 1}.txt").read_text()
            assert time.monotonic() < until
            time.sleep(0.05)
        self.address = json.loads(file.read_text())["address"]
        return process

    def worker(self):
        options = ("--nthreads", 1, "--no-dashboard", "--local-directory", self.folder, "--death-timeout", 60)
        return self._start("dask_worker", self.address, *options, "--no-nanny")

    def end(self):
        for process in self.started:
            process.kill()
            process.wait(10.0)


@pytest.fixture
def processes(tmp_path):
    found = Processes(tmp_path)
    yield found
    found.end()


def done(work, root, where, progress=None, workers=None):
    store = Store.of(work, root)
    with store.open(work):
        return carry_out(work, store, workers, progress, cluster=where)


def squares(found):
    return {unit: float(arrays["square"][0]) for unit, arrays in sorted(found.items())}


def test_a_worker_that_is_killed_costs_nothing_and_values_have_the_same_bits(processes, tmp_path):
    """Two workers, one of which is killed in mid-work; then a study of four points."""
    victim, _ = processes.worker(), processes.worker()
    work = trial(str(tmp_path), total=30, seconds=0.05)

    def kill(count, total):
        if count >= 8:
            victim.kill()

    assert squares(done(work, tmp_path, processes.address, kill)) == {unit: unit**2 for unit in range(30)}
    assert victim.wait(10.0) == -signal.SIGKILL
    points = prepared(lab.load("belt"), {"load.force": [10.0, 20.0]}, ["cycle.amplitude", "run.rms"], duration=0.2)
    there = study(points, tmp_path / "there", cluster=processes.address)
    here = study(points, tmp_path / "here", workers=1)
    assert np.array_equal(there.values, here.values)
    assert "processors" not in there.provenance


def test_no_scheduler_is_told_within_a_bound(tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "ANSWER", 1.0)
    begin = time.monotonic()
    with pytest.raises(UsageError, match=r"--cluster tcp://127\.0\.0\.1:9: no scheduler answers within 1 s"):
        done(trial(str(tmp_path)), tmp_path, "tcp://127.0.0.1:9")
    assert time.monotonic() - begin < 20.0


@pytest.mark.parametrize(
    ("where", "workers", "told"),
    [
        ("tcp://127.0.0.1:65536", None, "expected the address of a scheduler"),
        ("tcp://127.0.0.1:9", 2, "has its workers; leave --workers 2 out"),
    ],
)
def test_what_is_no_cluster_is_refused(where, workers, told):
    with pytest.raises(UsageError, match=told):
        cluster.check(where, workers)


def test_certificates_that_are_missing_are_told(tmp_path):
    with pytest.raises(UsageError, match=r"names no certificates: state distributed\.comm\.tls\.ca-file"):
        done(trial(str(tmp_path)), tmp_path, "tls://127.0.0.1:9")


@pytest.mark.slow
def test_a_worker_that_dies_while_it_is_asked_for_its_sources_is_no_other_version():
    from distributed.comm import CommClosedError

    answers = {"tls://a:1": sources(), "tls://b:1": CommClosedError("in <TLS>: Stream is closed")}
    client = SimpleNamespace(run=lambda function, on_error: answers)
    compare_sources(client, "tls://hub:8786")
    answers["tls://c:1"] = "friction-rig 0.1.0, sources 000000000000"
    with pytest.raises(
        UsageError, match=r"tls://hub:8786: these workers have other sources [^b]*tls://c:1: friction-rig 0"
    ):
        compare_sources(client, "tls://hub:8786")


def test_a_scheduler_that_is_killed_is_told_and_the_same_call_continues(processes, tmp_path):
    scheduler = processes.started[0]
    first = [processes.worker(), processes.worker()]
    work = trial(str(tmp_path), total=24, seconds=0.2)

    def kill(count, total):
        if count >= 6:
            scheduler.kill()

    with pytest.raises(WorkerError, match=r"Finished results are kept in .*; the same command continues"):
        done(work, tmp_path, processes.address, kill)
    for process in first:
        process.wait(90.0)
    saved = {unit: counts(tmp_path)[unit] for unit in Store.of(work, tmp_path).load()}
    assert 6 <= len(saved) < 24
    processes.scheduler()
    processes.worker()
    assert squares(done(work, tmp_path, processes.address)) == {unit: unit**2 for unit in range(24)}
    assert {unit: counts(tmp_path)[unit] for unit in saved} == saved
