"""A free run and its recorder: nothing is lost however slow the disk; a recorder that hangs does not hang the run."""

import threading
import time

import pytest
from patience import wait_for
from plant_in_thread import Bench

import rig
from rig import scenes
from rig.bench.live import housekeeping
from rig.record import recorder as recorders
from rig.record.writer import Writer

SECONDS = 6.0


@pytest.fixture(scope="module")
def scene():
    return scenes.load("belt", {"sensors.laser": "none", "sensors.accelerometer": "none"})


def recorded(bench, path, writer):
    """A recorder in a thread, with a ring that drops what it has no room for, as that of the process."""
    session = bench.twin.open("recorder", "recorder")

    def run():
        described = recorders.run_setup.fetch(session, 5.0)
        heard = session.subscribe("**", depth=housekeeping.WAITING)
        plant = session.watch("plant/*")
        plant.wait_for("plant", "plant", 5.0)
        made = writer(path, described, "recorded", True)
        session.announce()
        told.append(recorders.RunRecorder(session, described, heard, plant, made).run(threading.Event()))
        session.close()

    told = []
    bench.thread(run)
    return told


def test_a_free_run_waits_for_a_recorder_with_a_slow_disk(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(housekeeping, "WAITING", 100)
    monkeypatch.setattr(housekeeping, "MOST_WAITING", 8)
    monkeypatch.setattr(recorders, "TURN", 200)
    monkeypatch.setattr(recorders, "TELL_S", 0.02)
    lines = []

    class SlowDisk(Writer):
        """It hangs until the plant waits for it, and is slow from then on."""

        def flush_if_due(self):
            wait_for(lambda: lines)
            time.sleep(0.02)
            super().flush_if_due()

    with Bench(scene, pace=None, duration=SECONDS, expect=(("recorder", "recorder"),)) as bench:
        told = recorded(bench, tmp_path / "run.mcap", SlowDisk)
        bench.begin(lines.append)
        bench.finish()
    assert bench.summary["lost"] == {}
    assert told[0].lost == 0
    assert lines.count("the recorder is slower than the plant, which waits for it from time to time") == 1
    run = rig.open(tmp_path / "run.mcap")
    assert run.measurements["vibrometer"].v.size == SECONDS * 1000 + 1
    assert not run.damage


def test_a_recorder_that_hangs_is_not_waited_for_for_long(scene, monkeypatch):
    monkeypatch.setattr(housekeeping, "MOST_WAITING", 5)
    monkeypatch.setattr(housekeeping, "PATIENCE_S", 0.2)
    monkeypatch.setattr("rig.bench.live.plant.ANSWERS_S", 0.2)
    lines, seconds = [], 60.0  # many looks of the plant at its recorders, on the fastest machine too
    with Bench(scene, pace=None, duration=seconds, expect=(("recorder", "recorder"),)) as bench:
        bench.twin.open("recorder", "recorder").announce()
        bench.begin(lines.append)
        bench.finish()
    assert bench.summary["seconds"] == seconds
    assert sum("has written nothing for" in line for line in lines) == 1
    assert bench.summary["unknown"] == ["recorder recorder"]
