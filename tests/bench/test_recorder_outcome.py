"""A recorder that runs out of room is part of what becomes of the run."""

import resource

import pytest

import rig
from rig import scenes
from rig.bench.live import supervise
from rig.bench.live.plant_process import warm

SCENE = "belt_normal_force"


@pytest.fixture(scope="module")
def scene():
    """Compiled before a run waits for it."""
    loaded = scenes.load(SCENE)
    warm(loaded)
    return loaded


def test_a_disk_that_fills_up_in_mid_run_fails_the_run(runs, scene, monkeypatch):
    teams = []

    class RunProcesses(supervise.RunProcesses):
        def __init__(self, *given):
            super().__init__(*given)
            teams.append(self)

    def say(line):
        if "begins with" in line:  # from then on no file may grow beyond 60 kB: as on a disk that fills up
            recorder = teams[0].others["recorder", "recorder"]
            resource.prlimit(recorder.process.pid, resource.RLIMIT_FSIZE, (60_000, 60_000))

    monkeypatch.setattr(supervise, "RunProcesses", RunProcesses)
    outcome = supervise.run(scene, out=runs / "run.mcap", say=say, duration=1.0)
    assert outcome.exit_code in (1, 3)
    assert outcome.summary["verdict"] != "VALID"
    assert "nothing lost" not in outcome.summary["reasons"]
    assert "cannot be written: File too large; recorded up to t = " in outcome.text()
    assert rig.open(runs / "run.mcap").damage
    assert "rig recover" in outcome.text()
