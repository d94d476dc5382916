"""Recordings that are continued by command: `rig simulate --from LOG@TIME`."""

import json

import pytest

import rig as lab


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "a@b.mcap"
    lab.simulate("belt_normal_force", 1.0).save(path)
    return path


def test_a_recording_is_continued_recorded_and_verified(rig, log, tmp_path):
    out = tmp_path / "other.mcap"
    given = ("-p", "drive.speed=0.1", "-p", "friction.mu_static=0.45", "--duration", "500 ms", "--out", out)
    code, text, err = rig("simulate", "--from", f"{log}@500ms", *given)
    assert code == 0, text + err
    assert "continues a@b.mcap from 0.5 s" in text
    run = lab.open(out)
    assert run.time[-1] == pytest.approx(1.0)
    assert (run.signals["surface_speed"][:501] == lab.open(log).signals["surface_speed"][:501]).all()
    assert run.signals["surface_speed"][-1] == 0.1
    assert run.provenance["ancestor"] == log.name
    assert {"commit", "kernel", "seed"} <= run.provenance.keys()
    code, text, _ = rig("verify", out, "--json")
    assert code == 0, text
    assert json.loads(text)["identical"]
    same = lab.fork(log, 0.5, {"drive.speed": 0.1, "friction.mu_static": "0.45"}, 0.5)
    assert (same.signals["velocity"] == run.signals["velocity"]).all()


def test_a_value_that_a_controller_overrules_is_reported(rig, log):
    code, _, err = rig("simulate", "--from", f"{log}@0.5s", "-p", "load.force=15", "--duration", "0.1")
    assert code == 0
    assert "warning: load.force follows nf" in err


@pytest.mark.parametrize(
    ("given", "code", "words"),
    [
        (("--from", "{log}@7s"), 2, "has no instant 7 s; name one after 0 s, up to its end at 1 s"),
        (("belt", "--from", "{log}"), 2, "SCENE cannot be given with it"),
        (("--from", "{log}", "-p", "clock.frame=2", "--duration", "1"), 2, "clock.frame: is fixed while the rig runs"),
    ],
)
def test_what_cannot_be_continued_is_refused(rig, log, given, code, words):
    found, out, err = rig("simulate", *(one.format(log=log) for one in given))
    assert found == code, out + err
    assert words in err
    assert "Traceback" not in err
