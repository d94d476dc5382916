"""`rig export`: what it writes and says, and what it refuses."""

import json
import shutil

import numpy as np
import pytest
from scipy.io import loadmat

import rig as laboratory
from rig.cli.recordings import NAMES
from rig.record.export import FORMATS

GOLDEN = "recordings/golden/pendulum.mcap"


@pytest.fixture
def log(request, tmp_path):
    path = tmp_path / "log.mcap"
    shutil.copy(request.config.rootpath / GOLDEN, path)
    return path


@pytest.mark.parametrize("to", NAMES)
def test_every_format_is_written_beside_the_recording(rig, log, to):
    assert NAMES == tuple(sorted(FORMATS))
    code, out, err = rig("export", log, "--to", to)
    assert code == 0
    assert "outputs of the plant were recorded at 200 Hz and not filtered" in err
    name = f"log-{to}" if FORMATS[to].folder else f"log{FORMATS[to].suffix}"
    assert {one.name for one in log.parent.iterdir()} == {"log.mcap", name}
    assert out.splitlines()[0] == f"{log.parent / name}:"
    if to == "wav":
        assert "  sensors_1000_Hz_vibrometer.wav: 9001 samples at 1000 Hz, full scale 0.1126 m/s" in out
    else:
        assert "  outputs: 1801 rows at 200 Hz, 11 columns and the time" in out
        assert "  commands_nf: 1000 rows, 4 columns and the time" in out


def test_chosen_signals_at_a_lower_rate(rig, log, tmp_path):
    out = tmp_path / "less.mat"
    code, text, err = rig(
        "export", log, "--to", "mat", "--only", "vibrometer, nf", "--rate", "100 Hz", "--out", out, "--json"
    )
    assert code == 0
    report = json.loads(text)
    assert [one["table"] for one in report["tables"]] == ["sensors_100_Hz", "commands_nf"]
    (note,) = report["notes"]
    assert note in err
    assert note.startswith("vibrometer: recorded at 1000 Hz, now at 100 Hz behind a low-pass filter")
    data = loadmat(out, simplify_cells=True)
    assert data["run"]["signals"] == note
    assert data["run"]["recording"] == "log.mcap"
    assert np.array_equal(data["sensors_100_Hz"]["time"], np.arange(901) / 100)
    sent = laboratory.open(log).commands["nf"]
    assert np.array_equal(data["commands_nf"]["load_force"], sent.values[:, 0])
    assert data["names"]["commands_nf"]["load_force"] == "load.force"
    assert data["units"]["commands_nf"]["load_force"] == "N"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--to", "xls"), "--to xls: expected csv, hdf5, mat, netcdf, parquet or wav"),
        (("--to", "csv", "--rate", "2 kHz"), "--rate 2000 Hz: the highest recorded rate is 1000 Hz"),
        (("--to", "mat", "--out", "log.mcap", "--force"), "--out log.mcap: is also the input file"),
        (("--to", "mat", "--out", "/dev/null", "--force"), "/dev/null cannot be written: it is not a regular file"),
    ],
)
def test_what_is_refused_leaves_nothing(rig, log, monkeypatch, options, said):
    monkeypatch.chdir(log.parent)
    monkeypatch.setenv("COLUMNS", "200")
    before = log.read_bytes()
    code, out, err = rig("export", "log.mcap", *options)
    assert code in (1, 2)
    assert not out
    assert said in err
    assert [one.name for one in log.parent.iterdir()] == ["log.mcap"]
    assert log.read_bytes() == before
