"""Designs whose controllers act: their worst rigs run in lockstep, with the controller as a process."""

from pathlib import Path

import pytest
from robust_scenes import LOOPED

import rig as lab
from rig.analysis import robust
from rig.analysis.robust import design, in_time, knocked
from rig.analysis.robust.growth import LOOP
from rig.bench.again.verify import verify


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch, runs):
    """Recordings go to a folder of the test, runs are live in one; audits have 100 rigs, the box is not examined."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(design, "AUDIT", 100)
    monkeypatch.setattr(robust, "proved", lambda *asked: None)


def proved(over, **more):
    return lab.optimise("belt_normal_force", over, LOOP, workers=1, prove=True, **more)


def test_the_worst_rig_of_a_loop_decays_in_lockstep_as_its_eigenvalue(monkeypatch):
    """The controller is told neither of friction nor of the speed of the worst rig."""
    monkeypatch.setattr(in_time, "least_knocks", lambda growth, cases, *_: [knocked.Least(0.0, 0.0, "")] * len(cases))
    found = proved(None, against=LOOPED, overrides={"controllers.nf.gain": 613.456})
    assert [run.how for run in found.timed] == ["lockstep", "lockstep"]
    assert [run.rig for run in found.timed] == ["nominal", "worst"]
    worst = found.timed[1]
    assert worst.expected == pytest.approx(-11.9547, abs=1e-3)
    assert worst.growth == pytest.approx(worst.expected, rel=2e-3)
    assert found.timed[0].agrees
    assert verify(Path(worst.recording)).identical
    recorded = lab.open(worst.recording)
    assert any("controllers believe friction.mu_static = 0.5" in event["text"] for event in recorded.events)
    assert sorted(path.name for path in Path("recordings/runs").iterdir()) == sorted(
        Path(run.recording).name for run in found.timed
    )


@pytest.mark.slow
def test_the_least_knock_of_a_loop_is_found_by_whole_runs():
    """The designs beside each other; the limit of the displacement, 0.05 m, decides."""
    over = {"controllers.nf.gain": (0.0, 900.0), "controllers.nf.compensation": (0.0, 0.02)}
    found = proved(over, against=LOOPED)
    runs = {(run.design, run.rig): run for run in found.timed}
    assert len(runs) == 4
    assert all(run.how == "lockstep" for run in runs.values())
    for run in (runs["robust", "worst"], runs["nominal optimum", "worst"]):
        assert run.growth == pytest.approx(run.expected, rel=0.01)
        assert run.least.size > 0.0
        assert "bisection of whole runs; beyond it a limit of the scene ends the run" in run.least.how
