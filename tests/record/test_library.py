"""Recordings are found, listed and noted; the recordings themselves stay as they are."""

import json
from pathlib import Path

import numpy as np
import pytest

from rig.errors import LogError, UsageError
from rig.record import user_notes
from rig.record.contents import contents
from rig.record.run import Run
from rig.record.run_list import runs
from rig.record.save_run import save

GOLDEN = Path(__file__).parents[2] / "recordings" / "golden" / "pendulum.mcap"
BEGAN = 1_700_000_000_000_000_000


def make(path, seconds=0.1, scene="belt", began_ns=BEGAN):
    time = np.arange(round(seconds * 1000) + 1) * 1e-3
    run = Run(
        scene=json.dumps({"name": scene, "title": "A belt"}),
        step_ns=1_000_000,
        frame_ns=1_000_000,
        time=time,
        signals={"velocity": np.cos(time)},
        units={"velocity": "m/s"},
        began_ns=began_ns,
    )
    save(run, path)
    return path


@pytest.fixture
def log(tmp_path):
    return make(tmp_path / "run.mcap")


def test_the_contents_are_what_was_recorded(log):
    found = contents(log)
    assert (found.scene, found.title, found.began_ns, found.seconds) == ("belt", "A belt", BEGAN, 0.1)
    assert found.timing == "simulated"
    assert len(found.digest) == 64
    live = contents(GOLDEN)
    assert (live.scene, live.seconds, live.timing) == ("pendulum", 9.0, "VALID")


@pytest.mark.parametrize("keep", [0, 4, 200, -40])
def test_a_file_that_was_cut_off_or_is_another_is_refused_with_the_reason(log, keep):
    log.write_bytes(log.read_bytes()[:keep])
    with pytest.raises(LogError, match=r"run\.mcap (is not an MCAP file|is cut off|was cut off)"):
        contents(log)


def test_runs_are_listed_by_age_those_that_cannot_be_read_last(tmp_path):
    make(tmp_path / "b.mcap", began_ns=BEGAN + 10**9)
    make(tmp_path / "day 2" / "a.mcap", began_ns=BEGAN)
    (tmp_path / "broken.mcap").write_bytes(b"no recording")
    found = runs(tmp_path)
    assert [one.path.name for one in found] == ["a.mcap", "b.mcap", "broken.mcap"]
    assert found[-1].fault == "is not an MCAP file"


def test_a_recording_that_is_being_written_is_listed_as_such(tmp_path, log):
    log.write_bytes(log.read_bytes()[:-5])
    found = runs(tmp_path)[0]
    assert found.fault.startswith("was cut off, or a run is writing it")
    assert (found.contents.scene, found.contents.seconds, found.contents.messages) == ("belt", None, None)
    assert runs(tmp_path) == [found]  # from the index


def test_a_damaged_recording_is_found_by_its_scene_and_its_notes(rig, tmp_path, log):
    began_ns = contents(log).began_ns
    log.write_bytes(log.read_bytes()[:-5])
    user_notes.add(log, "new pad", ["squeal"])
    assert runs(tmp_path)[0].contents.began_ns // 10**6 == began_ns // 10**6
    code, out, _ = rig("runs", tmp_path, "--scene", "belt", "--tag", "squeal")
    assert code == 0
    assert "it has no index yet; new pad #squeal" in " ".join(out.split())
    log.write_bytes(log.read_bytes()[:20])
    assert runs(tmp_path)[0].contents is None


def test_notes_stay_beside_an_unchanged_recording(log):
    before = log.read_bytes()
    user_notes.add(log, "new  pad\nsecond day", ["squeal", "#pad7"])
    user_notes.add(log, "", ["squeal"])
    found = user_notes.read(log)
    assert log.read_bytes() == before
    assert [(note.text, note.tags) for note in found.entries] == [
        ("new pad second day", ("squeal", "pad7")),
        ("", ("squeal",)),
    ]
    assert found.tags == ("squeal", "pad7")
    assert found.path.name == "run.notes.jsonl"
    assert runs(log.parent)[0].notes == found


@pytest.mark.parametrize(
    ("text", "tags", "says"),
    [("", [], "empty"), ("x" * 10_001, [], "10001"), ("x", ["two words"], "one word"), ("\x1b[31m", [], "control")],
)
def test_what_is_no_note_is_refused(log, text, tags, says):
    with pytest.raises(UsageError, match=says):
        user_notes.add(log, text, tags)
    assert not user_notes.path_of(log).exists()
