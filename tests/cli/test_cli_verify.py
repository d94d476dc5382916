"""A recording that is made, checked, tampered with, and played into a controller once more, all by commands."""

import json

import numpy as np
import pytest

import rig as lab
from rig.cli import app
from rig.record.save_run import save

SCENE = "belt_normal_force"


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "run.mcap"
    with pytest.raises(SystemExit) as left:
        app.run(["simulate", SCENE, "-p", "controllers.nf.enable_at=0.2", "--duration", "0.5", "--out", str(path)])
    assert not left.value.code
    return path


def flipped(run):
    run.signals["velocity"][300] = np.nextafter(run.signals["velocity"][300], 1.0)


def lossy(run):
    run.summary["lost"] = {"applied/nf to recorder": 3, "step to recorder": 5}


def elsewhere(run):
    run.provenance["kernel"] = "0" * 16
    run.signals["velocity"] *= 1.0 + 1e-12


def holed(run):
    kind, (t_ns, v) = type(run.measurements["vibrometer"]), run.measurements["vibrometer"]
    run.measurements["vibrometer"] = kind(np.delete(t_ns, 100), np.delete(v, 100))


@pytest.mark.parametrize(
    ("change", "code", "said", "unsaid"),
    [
        (flipped, 1, "velocity differs at t = 0.3 s: ", "np."),  # a number, not its type
        (lossy, 1, "3 messages of the commands of nf were lost", "5 messages"),
        (elsewhere, 0, "events and mode sets were not compared: it was recorded with another kernel", "differs at"),
        (holed, 1, "1 sample of vibrometer is missing", "differs at"),
    ],
)
def test_what_is_not_as_it_was_simulated_is_found(rig, log, tmp_path, change, code, said, unsaid):
    run = lab.open(log)
    change(run)
    save(run, tmp_path / "changed.mcap")
    found, out, _ = rig("verify", tmp_path / "changed.mcap")
    assert found == code
    assert said in out
    assert unsaid not in out


@pytest.mark.usefixtures("runs")
def test_a_changed_gain_differs_where_it_first_acts_and_the_timing_error_is_stated(rig, log):
    change = "controllers.nf.gain=150 N*s/m"
    code, out, err = rig("live", "replay", log, "--into", "nf", "--pace", "5", "-p", change, "--json")
    told = json.loads(out)
    assert code == 1, out + err
    assert told["compared"] == {"nf": 500}
    assert (told["divergence"]["topic"], told["divergence"]["tick"]) == ("act/nf", 200)  # enabled at 0.2 s
    (recorded,), (answered,) = told["divergence"]["recorded"], told["divergence"]["answered"]
    assert (answered - 20.0) / (recorded - 20.0) == pytest.approx(150.0 / 200.0)
    assert told["timing"]["mean"] <= told["timing"]["worst"]


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (["-p", "drive.speed=1"], "-p drive.speed: the plant is recorded"),
        (["--into", "nf", "-p", "controllers.nf.gian=1"], "gian: no such parameter; near: gain"),
        (["--into", "nf", "--into", "nf"], "two controllers have the same name"),
        (["--into", "{drives}"], "drives drive.speed, the recorded nf drives load.force: their commands cannot be"),
        (["--into", "{half}"], "has a period of 500000 ns; the recording has frames of 1000000 ns"),
    ],
)
@pytest.mark.usefixtures("runs")
def test_what_a_replay_cannot_do_is_told_before_it_begins(rig, log, tmp_path, given, told):
    changes = {
        "drives": ("load.force", "drive.speed"),
        "half": ("1_000_000", "500_000"),
    }
    for name, (old, new) in changes.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "nf.py").write_text(MINE.replace(old, new))
    files = {name: tmp_path / name / "nf.py" for name in changes}
    code, _, err = rig("live", "replay", log, "--pace", "max", *(one.format(**files) for one in given))
    assert code == 2
    assert told in err


MINE = """
class Controller:
    reads, drives, period_ns = ("vibrometer",), ("load.force",), 1_000_000

    def start(self):
        return None

    def update(self, state, t_ns, values):
        if t_ns == 300_000_000: LAST
        return None, (20.0 - 200.0 * values[0] * (t_ns >= 200_000_000),)
"""


@pytest.mark.usefixtures("runs")
def test_a_controller_that_dies_in_a_replay_is_named_with_its_end(rig, log, tmp_path):
    file = tmp_path / "nf.py"
    file.write_text(MINE.replace("LAST", "1 / 0"))
    code, _, err = rig("live", "replay", log, "--into", file, "--pace", "20")
    assert code == 2
    assert "nf left at tick 300, t = 0.3 s, without an answer to its step" in err
    assert f"nf ended with code 1: controller nf failed at t = 0.3 s: {file}: ZeroDivisionError" in err


CHANGED_BY_THE_PROTOCOL = """
format = 1
based_on = "belt_normal_force"
title = "A gain that the protocol changes"

[controllers.nf]
enable_at = ["0.05 s", "chosen"]

[[protocol]]
step = "hold"
time = ["0.2 s", "chosen"]

[[protocol]]
step = "set"
target = "controllers.nf.gain"
to = [150, "chosen"]

[[protocol]]
step = "hold"
time = ["0.2 s", "chosen"]
"""


@pytest.mark.usefixtures("runs")
def test_a_change_by_the_protocol_is_made_again_in_a_replay(rig, tmp_path):
    (tmp_path / "changed.toml").write_text(CHANGED_BY_THE_PROTOCOL)
    assert rig("simulate", tmp_path / "changed.toml", "--out", tmp_path / "changed.mcap")[0] == 0
    code, out, err = rig("live", "replay", tmp_path / "changed.mcap", "--into", "nf", "--pace", "max", "--json")
    assert code == 0, out + err
    assert (json.loads(out)["compared"], json.loads(out)["divergence"]) == ({"nf": 400}, None)
    assert rig("verify", tmp_path / "changed.mcap")[0] == 0
