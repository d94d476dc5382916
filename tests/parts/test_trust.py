"""Code that comes with a recording, or over the bus, runs only where the user says so."""

import json
from dataclasses import replace
from hashlib import sha256

import pytest

import rig as lab
from rig.analysis.recorded.series import drive, vibration
from rig.errors import PartError, Untrusted
from rig.record.save_run import save
from rig.scenes.scene import Scene


@pytest.fixture
def log(rig, folder, strangers):
    """A recording of a scene with parts, for a process that trusts none of them."""
    path = folder / "run.mcap"
    code, _, err = rig("simulate", folder / "scene.toml", "--duration", "0.3", "--out", path)
    assert code == 0, err
    strangers()
    return path


@pytest.fixture
def scene(folder):
    """The scene as a recording contains it."""
    return json.loads(lab.load(folder / "scene.toml").to_json())


def tampered(log, path, change):
    """The recording with another scene."""
    run = lab.open(log)
    raw = json.loads(run.scene)
    change(raw)
    save(replace(run, scene=json.dumps(raw)), path)
    return path


def test_without_trust_there_are_data_and_no_code_runs_with_it_everything_works(log):
    run = lab.open(log)
    assert json.loads(run.scene)["plant"] == "example_plant.py"
    assert len(run.measurements["geophone"].v) == 301
    assert run.signals["velocity"].size
    assert run.events
    assert vibration(run) == "meas/vibrometer"
    with pytest.raises(Untrusted, match=r"example_plant\.py"):
        drive(run)
    with pytest.raises(Untrusted) as told:
        Scene.from_json(run.scene)
    for kind in ("plant", "effect", "sensor", "controller"):
        assert f"example_{kind}.py (SHA-256 " in str(told.value)
    assert "--trust" in str(told.value)
    run = lab.open(log, trust=True)
    assert drive(run) == "truth/surface_speed"
    assert Scene.from_json(run.scene).assemble().title == "block on a soft table"


def test_commands_that_need_the_code_ask_for_trust(rig, log, strangers):
    code, _, err = rig("analyse", "amplitude", log)
    assert code == 2
    assert "example_plant.py (SHA-256" in err
    assert "--trust" in err
    strangers()
    code, out, err = rig("analyse", "amplitude", log, "--trust")
    assert code == 0, out + err
    code, out, err = rig("analyse", "spectrum", log, "--signal", "geophone")  # data are analysed without
    assert code == 0, err
    assert "geophone" in out


def test_what_is_not_known_without_the_code_is_told(rig, log):
    """The comparison lacks a measure; which channel is a vibration is only asked where there are several."""
    code, out, _ = rig("diff", log, log)
    assert code == 0
    assert out.count("the stick share is missing: this needs to run code") == 2
    assert "stick share" not in rig("diff", log, log, "--trust")[1]


def test_source_that_does_not_have_its_hash_is_refused(rig, log, tmp_path):
    def change(raw):
        raw["parts"][0]["source"] += "\nprint('hello')\n"

    path = tampered(log, tmp_path / "bent.mcap", change)
    code, _, err = rig("verify", path, "--trust")
    assert code == 2
    assert "part example_plant.py: its source has the SHA-256" in err
    assert "is not run" in err
    with pytest.raises(PartError):
        lab.open(path, trust=True)


def test_a_recording_never_makes_a_file_run(scene, folder):
    scene |= {"parts": [], "plant": str(folder / "example_plant.py")}
    with pytest.raises(PartError, match="the recording lacks the source of"):
        Scene.from_json(json.dumps(scene))


def test_trust_is_a_matter_of_the_text(log, strangers):
    lab.open(log, trust=True)
    raw = json.loads(lab.open(log).scene)
    raw["parts"][0]["source"] += "\n"
    raw["parts"][0]["sha256"] = sha256(raw["parts"][0]["source"].encode()).hexdigest()
    with pytest.raises(Untrusted, match=r"example_plant\.py") as told:
        Scene.from_json(json.dumps(raw))
    assert "example_sensor.py" not in str(told.value)


def test_a_report_without_trust_says_what_it_does_not_show(rig, log, strangers):
    page = log.with_suffix(".html")
    assert rig("report", log)[0] == 0
    told = page.read_text(encoding="utf-8")
    assert "The run was not drawn" in told
    assert "--trust" in told
    assert "<img" not in told
    strangers()
    assert rig("report", log, "--trust", "--force")[0] == 0
    told = page.read_text(encoding="utf-8")
    assert "The run was not drawn" not in told
    assert "<img" in told
