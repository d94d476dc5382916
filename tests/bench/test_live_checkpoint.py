"""A live run records checkpoints: it is continued from one of them, with the bits of a simulation from the begin on."""

import numpy as np

import rig
from rig import scenes
from rig.bench.again import fork as forks
from rig.bench.again.verify import verify
from rig.bench.live import supervise
from rig.bench.live.plant_process import warm
from rig.record.compare import compare
from rig.record.save_run import save


def test_a_live_run_is_continued_from_a_checkpoint(runs, monkeypatch):
    # a fast sensor makes short steps, so that the run has a checkpoint after 2 s
    scene = scenes.load("belt_normal_force", {"controllers.nf.enable_at": "1 s", "sensors.vibrometer.rate": "50 kHz"})
    warm(scene)
    log = runs / "run.mcap"
    assert supervise.run(scene, pace=None, duration=2.1, out=log).exit_code == 0
    live = rig.open(log)
    (tick, state), *more = live.checkpoints.items()
    assert not more
    assert len(state) < 0.02 * log.stat().st_size

    changes = {"drive.speed": "0.09 m/s"}
    found = forks.fork(log, 2.05, changes, 200_000_000)
    assert found.provenance["checkpoint_ns"] == str(tick * live.frame_ns)
    monkeypatch.setattr(forks, "nearest", lambda *given: None)
    other = forks.fork(log, 2.05, changes, 200_000_000)
    assert "checkpoint_ns" not in other.provenance
    rows = np.searchsorted(other.time, found.time - 1e-10)
    assert all((found.signals[name] == v[rows]).all() for name, v in other.signals.items())
    assert all((found.measurements[name].v == one.v).all() for name, one in other.measurements.items())
    assert all((found.commands[name].values == one.values).all() for name, one in other.commands.items())
    assert np.array_equal(found.mode, other.mode[rows])
    assert compare(live, found, end=2.05).agree

    save(found, runs / "second.mcap")
    again = verify(runs / "second.mcap")
    assert again.passed, again.text()
    assert again.identical
    gap = rig.open(runs / "second.mcap")
    lost = np.arange(gap.time.size) != int(np.searchsorted(gap.time, 1.0))
    gap.time, gap.mode = gap.time[lost], gap.mode[lost]
    gap.signals = {name: v[lost] for name, v in gap.signals.items()}
    save(gap, runs / "gap.mcap")
    assert f"1 sample of the output {next(iter(gap.signals))} is missing" in verify(runs / "gap.mcap").faults
