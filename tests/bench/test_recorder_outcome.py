"""What becomes of the recorder is part of what becomes of the run: dead, out of room, or unable to tell."""

import os
import resource
import shutil
import signal
import time

import pytest

import rig
from rig import scenes
from rig.bench.again.verify import verify
from rig.bench.live import supervise
from rig.bench.live.outcome import Job, Outcome
from rig.bench.live.plant_process import warm
from rig.bench.live.timing import Timing
from rig.bus.run_setup import Setup
from rig.cli import app
from rig.machine.process import Child, end
from rig.record.recorder import Recording
from rig.record.writer import Writer

SCENE = "belt_normal_force"


@pytest.fixture(scope="module")
def scene():
    """Compiled before a run waits for it."""
    loaded = scenes.load(SCENE)
    warm(loaded)
    return loaded


def killed(recorder, path):
    recorder.send(signal.SIGKILL)


def full(recorder, path):
    """No file of the recorder may grow any more: as on a disk that has just been filled."""
    size = path.stat().st_size
    resource.prlimit(recorder.process.pid, resource.RLIMIT_FSIZE, (size, size))


@pytest.mark.alone  # strikes between the end of the plant and that of the recorder
@pytest.mark.parametrize(
    ("strikes", "told"), [(killed, "was killed by SIGKILL"), (full, "cannot be written: File too large")]
)
def test_a_recorder_that_fails_after_the_last_frame_fails_the_run(runs, scene, monkeypatch, strikes, told):
    waits = supervise.RunProcesses.wait_for_file

    def wait_for_file(team, recorder, interrupts):
        strikes(recorder, runs / "run.mcap")
        waits(team, recorder, interrupts)

    monkeypatch.setattr(supervise.RunProcesses, "wait_for_file", wait_for_file)
    lines = []
    outcome = supervise.run(scene, pace=None, duration=0.5, out=runs / "run.mcap", say=lines.append)
    assert outcome.exit_code == 1
    assert outcome.summary["verdict"] == "DEGRADED"
    assert "nothing lost" not in outcome.summary["reasons"]
    assert "the recording is not complete: recorder" in outcome.summary["reasons"][-1]
    assert told in outcome.text()
    assert outcome.to_json()["verdict"] == "DEGRADED"
    assert f"rig recover {runs / 'run.mcap'}" in outcome.text()
    assert rig.open(runs / "run.mcap").damage


class Slow:
    """A recorder that takes its time, and then ends."""

    name, code = "recorder", None

    def __init__(self, seconds):
        self.until, self.got = time.monotonic() + seconds, []

    def wait(self, seconds):
        time.sleep(min(seconds, 0.02))
        return time.monotonic() > self.until

    def send(self, number):
        self.got.append(number)
        self.until = 0.0


def test_a_recorder_that_finishes_its_file_slowly_is_told_and_can_be_interrupted(tmp_path, scene, monkeypatch):
    monkeypatch.setattr(supervise, "TELL_S", 0.1)
    monkeypatch.setattr(supervise, "Child", lambda *_: Slow(0.0))
    lines = []
    team = supervise.RunProcesses(tmp_path, Job(scene.to_json()), None, False, False, lines.append)
    team.name = "a run"
    team.wait_for_file(Slow(0.3), [])
    assert lines == ["waiting for the recorder, which finishes its file"]
    recorder = team.others["recorder", "recorder"] = Slow(30.0)
    team.wait_for_file(recorder, ["SIGINT", "SIGINT"])
    assert recorder.got == [signal.SIGTERM]


def test_a_disk_that_fills_up_while_it_runs_fails_the_run(runs, scene):
    going, struck = {}, []

    def say(text):
        if "begins with" in text and not struck:
            struck.append(text)
            recorder = going["team"].others["recorder", "recorder"]
            resource.prlimit(recorder.process.pid, resource.RLIMIT_FSIZE, (60_000, 60_000))

    class RunProcesses(supervise.RunProcesses):
        def __init__(self, *given):
            super().__init__(*given)
            going["team"] = self

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(supervise, "RunProcesses", RunProcesses)
        outcome = supervise.run(scene, duration=3.0, out=runs / "run.mcap", say=say, name="fills")
    assert struck
    assert outcome.exit_code in (1, 3)
    assert outcome.summary["verdict"] != "VALID"
    assert "nothing lost" not in outcome.summary["reasons"]
    assert "cannot be written: File too large; recorded up to t = " in outcome.text()
    assert rig.open(runs / "run.mcap").damage


def test_a_recorder_that_is_stopped_in_mid_run_fails_the_run(runs, scene, monkeypatch):
    teams, struck = [], []

    def say(text):
        if "begins with" in text and not struck:
            struck.append(text)
            teams[0].others["recorder", "recorder"].send(signal.SIGTERM)

    class RunProcesses(supervise.RunProcesses):
        def __init__(self, *given):
            super().__init__(*given)
            teams.append(self)

    monkeypatch.setattr(supervise, "RunProcesses", RunProcesses)
    outcome = supervise.run(scene, duration=1.5, out=runs / "run.mcap", say=say)
    assert struck
    assert outcome.exit_code in (1, 3)
    assert outcome.summary["verdict"] != "VALID"
    assert "the recording is not complete: the recorder was told to stop" in outcome.text()
    assert "rig recover" not in outcome.text()  # the file is whole as far as it goes


def removed(path):
    shutil.rmtree(path.parent)


def replaced(path):
    path.rename(path.with_name("moved.mcap"))
    path.write_bytes(b"")


def cut(path):
    os.truncate(path, 100)


@pytest.mark.parametrize(
    ("strikes", "told"), [(removed, "removed or replaced"), (replaced, "removed or replaced"), (cut, "cut")]
)
def test_a_recording_that_vanishes_in_mid_run_fails_the_run(runs, scene, monkeypatch, strikes, told):
    path = runs / "folder" / "run.mcap"
    path.parent.mkdir()

    class Struck(Child):
        def new_words(self):
            words = super().new_words()
            if ("file", str(path)) in words:
                strikes(path)
            return words

    monkeypatch.setattr(supervise, "Child", Struck)
    outcome = supervise.run(scene, duration=1.5, out=path, say=lambda _: None)
    assert outcome.exit_code in (1, 3)
    assert outcome.summary["verdict"] != "VALID"
    assert "nothing lost" not in outcome.summary["reasons"]
    assert f"{path} was {told} while it was written" in outcome.text()


@pytest.mark.parametrize(
    ("lies", "told"),
    [
        ({}, ""),
        ({"seconds": 0.044}, "it ends at t = 0.044 s, the run at 0.2 s"),
        ({"files": ["elsewhere.mcap"]}, "elsewhere.mcap was removed or replaced"),
        ({"files": [__file__]}, "was removed or replaced"),
        ({"files": [os.devnull]}, ""),
        ({"totals": False}, "was told to stop before"),
        (None, "recorder ended with code 0"),
    ],
)
def test_file_and_account_of_the_recorder_are_compared_with_the_run(runs, scene, monkeypatch, lies, told):
    class Liar(Child):
        def new_words(self):
            words = super().new_words()
            return [(kind, value | (lies or {}) if kind == "recording" else value) for kind, value in words
                    if kind != "recording" or lies is not None]  # fmt: skip

    monkeypatch.setattr(supervise, "Child", Liar)
    outcome = supervise.run(scene, pace=None, duration=0.2, out=runs / "run.mcap", say=lambda _: None)
    assert outcome.exit_code == (1 if told else 0)
    assert told in outcome.text()
    assert bool(told) == any("recording is not complete" in reason for reason in outcome.summary["reasons"])


def test_the_file_of_another_run_is_not_told_as_the_recording_of_this_one(runs, scene):
    path = runs / "theirs.mcap"
    theirs = Writer(path, Setup("theirs", scene.to_json(), scene.frame_ns, scene.step_ns, {}, {}), "recorded")
    outcome = supervise.run(scene, pace=None, duration=0.2, out=path, replace=True, say=lambda _: None)
    theirs.abandon()
    assert outcome.exit_code == 1
    assert "another run is writing it" in outcome.text()
    assert outcome.log == ""
    assert "rig recover" not in outcome.text()


def test_a_recorder_that_does_not_know_what_a_killed_controller_had_sent_has_finished_its_file(
    runs, scene, monkeypatch
):
    """What to do next must be possible: there is nothing to recover, and verify says what is not known."""
    teams, successors = [], []

    def say(text):
        if "begins with" in text:
            teams[0].others["controller", "nf"].send(signal.SIGKILL)
        if "left: controller nf" in text and not successors:
            successors.append(Child("controller nf", ["rig.controllers.runtime.process", "nf", "--run", teams[0].name]))

    class RunProcesses(supervise.RunProcesses):
        def __init__(self, *given):
            super().__init__(*given)
            teams.append(self)

    monkeypatch.setattr(supervise, "RunProcesses", RunProcesses)
    path = runs / "run.mcap"
    outcome = supervise.run(scene, duration=6.0, out=path, say=say)
    assert end(successors, 5.0) == []
    assert outcome.exit_code in (1, 3)
    assert "the recording is not complete: recorder" in outcome.text()
    assert "unknown how many of nf from before a restart" in outcome.text()
    assert "rig recover" not in outcome.text()
    assert f"rig verify {path}" in outcome.text()
    found = verify(path)
    assert found.passed, found.text()
    assert found.notes == ("unknown how many messages of nf are missing from before a restart",)


def test_a_loss_that_nobody_knows_is_not_called_none():
    verdict = Timing(1e6).verdict(0.01, 0.05, {}, ["recorder r did not report what it received"], False, ["recorder r"])
    assert verdict.word == "DEGRADED"
    assert "nothing lost" not in verdict.reasons
    assert "unknown losses on the way to recorder r" in verdict.reasons


def test_a_recorder_tells_what_it_does_not_know():
    assert "none lost" in Recording("a.mcap", "a", "the plant left", totals=True).text()
    assert "unknown how many lost at the end" in Recording("a.mcap", "a", "the plant left").text()
    late = Recording("a.mcap", "a", "the plant left", late={"step": 7}, gaps={"state": 3}, totals=True).text()
    assert "3 lost, 7 sent before it began to listen" in late


@pytest.mark.parametrize(
    ("told", "code"),
    [
        ({"ended": "the plant left", "totals": True}, 0),
        ({"ended": "the plant left"}, 1),  # the plant's last word did not come: what is missing at the end is unknown
        ({"ended": "the recorder was told to stop"}, 0),
        ({"ended": "the recorder was told to stop", "gaps": {"state": 3}}, 1),
    ],
)
def test_a_recorder_that_does_not_know_the_end_does_not_call_its_file_whole(monkeypatch, told, code):
    found = Recording("a.mcap", "a", **told)
    monkeypatch.setattr("rig.record.recorder.record", lambda *_, **__: found)
    with pytest.raises(SystemExit) as left:
        app.run(["record", "--run", "a"])
    assert (left.value.code or 0) == code


def test_an_incomplete_recording_does_not_hide_a_worse_verdict():
    told = {"verdict": "INVALID", "reasons": ["nothing lost", "late"], "exit_code": 3}
    outcome = Outcome(told).without_recording("dead")
    assert (outcome.summary["verdict"], outcome.exit_code) == ("INVALID", 3)
    assert outcome.summary["reasons"] == ["late", "the recording is not complete: dead"]
