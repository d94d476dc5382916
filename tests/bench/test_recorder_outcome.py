"""What becomes of the recorder is part of what becomes of the run: dead, out of room, or unable to tell."""

import resource
import shutil

import pytest

import rig
from rig import scenes
from rig.bench.live import supervise
from rig.bench.live.plant_process import warm
from rig.cli import app
from rig.machine.process import Child
from rig.record.recorder import Recording

SCENE = "belt_normal_force"


@pytest.fixture(scope="module")
def scene():
    """Compiled before a run waits for it."""
    loaded = scenes.load(SCENE)
    warm(loaded)
    return loaded


@pytest.fixture
def struck(runs, scene, monkeypatch):
    """Runs `scene`; `strike(line, processes)` gets each line. It may do something to a process."""

    def run(strike, path, **more):
        teams = []

        class RunProcesses(supervise.RunProcesses):
            def __init__(self, *given):
                super().__init__(*given)
                teams.append(self)

        monkeypatch.setattr(supervise, "RunProcesses", RunProcesses)
        return supervise.run(scene, out=path, say=lambda line: strike(line, teams[0]), **more)

    return run


def incomplete(outcome, told):
    assert outcome.exit_code in (1, 3)
    assert outcome.summary["verdict"] != "VALID"
    assert "nothing lost" not in outcome.summary["reasons"]
    assert told in outcome.text()


def full(recorder):
    """No file of the recorder may grow beyond 60 kB any more: as on a disk that fills up."""
    resource.prlimit(recorder.process.pid, resource.RLIMIT_FSIZE, (60_000, 60_000))


def test_a_disk_that_fills_up_in_mid_run_fails_the_run(runs, struck):
    def begun(line, team):
        if "begins with" in line:
            full(team.others["recorder", "recorder"])

    outcome = struck(begun, runs / "run.mcap", duration=1.0)
    incomplete(outcome, "cannot be written: File too large; recorded up to t = ")
    assert rig.open(runs / "run.mcap").damage
    assert "rig recover" in outcome.text()


def test_a_recording_that_vanishes_in_mid_run_fails_the_run(runs, scene, monkeypatch):
    path = runs / "folder" / "run.mcap"
    path.parent.mkdir()

    class Struck(Child):
        def new_words(self):
            words = super().new_words()
            if ("file", str(path)) in words:
                shutil.rmtree(path.parent)
            return words

    monkeypatch.setattr(supervise, "Child", Struck)
    outcome = supervise.run(scene, duration=1.0, out=path, say=lambda _: None)
    incomplete(outcome, f"{path} was removed or replaced while it was written")


@pytest.mark.parametrize(
    ("told", "code", "text"),
    [
        ({"ended": "the plant left", "totals": True}, 0, "none lost"),
        ({"ended": "the plant left"}, 1, "unknown how many lost at the end"),  # the plant's last word did not come
        ({"ended": "the recorder was told to stop"}, 0, ""),
        (
            {"ended": "the recorder was told to stop", "gaps": {"state": 3}, "late": {"step": 7}},
            1,
            "3 lost and an unknown number at the end, 7 sent before it began to listen",
        ),
    ],
)
def test_a_recorder_that_does_not_know_the_end_does_not_call_its_file_whole(monkeypatch, told, code, text):
    recording = Recording("a.mcap", "a", **told)
    monkeypatch.setattr("rig.record.recorder.record", lambda *_, **__: recording)
    with pytest.raises(SystemExit) as left:
        app.run(["live", "record", "--run", "a"])
    assert (left.value.code or 0) == code
    assert text in recording.text()
