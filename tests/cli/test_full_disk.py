"""A file that does not fit on the disk: each command names it, and nothing of it is left."""

from pathlib import Path

import numpy as np
import pytest
from full_disk import largest_file

from rig.record.run import Run, Samples
from rig.record.save_run import save

GOLDEN = Path(__file__).parents[2] / "recordings" / "golden"
LARGEST = 4096
"""Size at which a file cannot grow any more [bytes]."""
COMMANDS = [
    *(("export", "--to", to, "--out") for to in ("csv", "hdf5")),
    ("report", "--out"),
    ("analyse sound", "--signal", "fast", "--out"),
    ("analyse spectrum", "--figure"),
]


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Recordings: one that is fast enough for `rig analyse sound`, and a golden one for all other commands."""
    t_ns = np.arange(8001, dtype=np.int64) * 100_000
    tone = Samples(t_ns, np.sin(2.0 * np.pi * 1000.0 * t_ns * 1e-9))
    fast = tmp_path_factory.mktemp("fast") / "fast.mcap"
    save(
        Run(
            scene="{}",
            step_ns=100_000,
            frame_ns=1_000_000,
            time=t_ns * 1e-9,
            signals={"x": tone.v},
            units={"x": "m", "meas/fast": "m/s"},
            measurements={"fast": tone},
        ),
        fast,
    )
    return {"analyse sound": fast}


@pytest.fixture
def full(logs):
    """Files of this process and its children stay small, as if the disk were full: LARGEST, or what a test asks for."""
    with largest_file(LARGEST) as change:
        yield change


@pytest.mark.usefixtures("full")
@pytest.mark.parametrize("command", COMMANDS, ids=lambda one: f"{one[0]} {one[1]} {one[-1]}")
def test_a_file_that_does_not_fit_is_named_and_goes(rig, logs, tmp_path, command):
    name, *options = command
    path = tmp_path / {"report": "file.html", "analyse spectrum": "file.png"}.get(name, "file")
    code, out, err = rig(*name.split(), logs.get(name, GOLDEN / "pendulum.mcap"), *options, path)
    assert code == 1
    assert str(path) in err
    assert "cannot be written" in err
    assert "Traceback" not in out + err
    assert not [*tmp_path.iterdir()]


def test_of_a_note_that_does_not_fit_no_part_stays(rig, tmp_path, full):
    log, notes = tmp_path / "log.mcap", tmp_path / "log.notes.jsonl"
    earlier = b'{"date": "2026-11-25", "text": "the first"}\n'
    full(1 << 20)
    log.write_bytes((GOLDEN / "belt.mcap").read_bytes())
    notes.write_bytes(earlier)
    full(len(earlier) + 10)
    code, _, err = rig("note", log, "a new pad")
    assert code == 1
    assert "log.notes.jsonl cannot be written: File too large" in err
    assert notes.read_bytes() == earlier
