"""The zip file of a bug report: what is needed to understand a problem, and nothing of the user."""

import getpass
import platform
import zipfile
from functools import partial
from pathlib import Path

import pytest

from rig.bench.live.supervise import RunLog
from rig.qualify.doctor import doctor


@pytest.fixture
def state(tmp_path, monkeypatch):
    """A machine, a user and a state folder of this test alone."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(platform, "node", lambda: "laboratory-7.example.org")
    monkeypatch.setattr(getpass, "getuser", lambda: "kroeger")
    monkeypatch.setattr(Path, "home", lambda: Path("/home/kroeger"))
    return tmp_path


def test_a_bundle_has_versions_doctor_and_the_last_run_and_no_name_of_the_user(rig, state, monkeypatch):
    monkeypatch.setenv("RIG_KERNELS_OF_MINE", "/home/kroeger/kernels")
    monkeypatch.setenv("SECRET", "my password")
    monkeypatch.setattr("rig.qualify.doctor.doctor", partial(doctor, 0.2))
    log = RunLog(lambda text: None, {"secret_pad": "SCENE"})
    for line in (
        "run secret_pad-20261123-190238",
        "the recording is /home/kroeger/pads/customer.mcap, written on laboratory-7 by kroeger",
        "timing VALID: nothing lost, 0.1 m/s, 30 / 39 / 66 us, rig verify customer.mcap",
    ):
        log.say(line)
    log.write()
    code, _, err = rig("doctor", "belt", "--bundle", state / "report.zip")
    assert code in (0, 1), err  # what the doctor says of this machine
    with zipfile.ZipFile(state / "report.zip") as archive:
        files = {name: archive.read(name).decode() for name in archive.namelist()}
    assert sorted(files) == ["README.txt", "doctor.txt", "environment.txt", "last_run.log", "versions.txt"]
    assert all(name in err for name in files)
    assert str(state / "report.zip") in err
    together = "\n".join(files.values())
    for name in ("kroeger", "laboratory-7", "example.org", "customer", "secret_pad", "password", "SECRET", "/home"):
        assert name not in together, name
    assert "timing VALID: nothing lost, 0.1 m/s, 30 / 39 / 66 us, rig verify FILE.mcap" in files["last_run.log"]
    assert "run SCENE-20261123-190238" in files["last_run.log"]
    assert "RIG_KERNELS_OF_MINE=FOLDER" in files["environment.txt"].splitlines()
    assert f"Python {platform.python_version()}" in files["versions.txt"]
    assert "numba 0." in files["versions.txt"]
    assert "belt  " in files["doctor.txt"]


def test_a_bundle_is_not_written_over_a_file(rig, state):
    (state / "report.zip").write_text("something")
    code, _, err = rig("doctor", "belt", "--bundle", state / "report.zip")
    assert code == 2
    assert "exists; name another file, or add --force to replace it" in err
    assert (state / "report.zip").read_text() == "something"
