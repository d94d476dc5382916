"""The format of recordings: those of former versions open, those of newer ones are refused."""

from pathlib import Path

import numpy as np
import pytest

from rig.errors import LogError
from rig.record import reader
from rig.record.contents import contents
from rig.record.mcap_file import FORMAT
from rig.record.message_scan import Scan
from rig.record.recover import recover
from rig.record.run_list import runs
from rig.record.save_run import save
from rig.scenes import Scene

OLD = Path(__file__).parent / "format_1.mcap"
"""rig simulate belt_normal_force --duration 0.3, by the version before recordings stated their format."""
BUS = Path(__file__).parent / "format_1_bus.mcap"
"""rig run belt_normal_force --duration 0.1 --pace max, by the last version whose log times were the wall clock."""


def test_a_recording_of_the_first_format_opens():
    run = reader.open(OLD)
    assert (run.damage, run.sealed) == ("", True)
    assert run.time[-1] == pytest.approx(0.3)
    assert set(run.measurements) == {"vibrometer", "normal_force"}
    assert run.commands["nf"].tick.size == 300
    scene = Scene.from_json(run.scene_text())
    assert (scene.parameters.load.force, scene.controllers["nf"].gain) == (20.0, 200.0)


@pytest.mark.parametrize(("path", "end", "began"), [(OLD, 0.3, "1970"), (BUS, 0.1, "2026")])
def test_times_of_the_first_format_are_those_of_the_run(path, end, began, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[:-2000])
    recovered = Path(recover(cut).path)
    for file in (path, cut, recovered):
        run = reader.open(file)
        scan = Scan(file)
        assert max(record.t_ns for record in scan) <= scan.last_ns == pytest.approx(end * 1e9)
        assert np.datetime64(run.began_ns, "ns").astype("datetime64[Y]") == np.datetime64(began)
        if file != cut:
            assert abs(contents(file).began_ns - run.began_ns) < 10**9


def test_a_recording_states_its_format(run, tmp_path):
    save(run, tmp_path / "run.mcap")
    scan = Scan(tmp_path / "run.mcap")
    list(scan)
    assert scan.metadata["log"]["format"] == str(FORMAT)


def test_a_recording_of_a_newer_format_is_refused(run, tmp_path, monkeypatch):
    monkeypatch.setattr("rig.record.writer.FORMAT", FORMAT + 1)
    save(run, tmp_path / "run.mcap")
    with pytest.raises(LogError, match=rf"recording of format {FORMAT + 1}, written by a newer version .* install"):
        reader.open(tmp_path / "run.mcap")
    (listed,) = runs(tmp_path)
    assert (listed.contents, listed.fault.partition(",")[0]) == (None, f"is a recording of format {FORMAT + 1}")
