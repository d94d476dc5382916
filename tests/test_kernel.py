"""Compiled code: where it is kept, what a start says about it."""

import os
import subprocess
import sys

CODE = """
from rig.kernel import kernel

@kernel
def twice(x):
    return 2 * x

print(twice({}))
"""
TOLD = "compiling kernels, once for each kind of rig: half a minute to two minutes\n"


def run(folder, values="1.0", **environment):
    (folder / "made.py").write_text(CODE.format(values))
    path = os.pathsep.join([str(folder), *sys.path])
    return subprocess.run(
        [sys.executable, "-m", "made"],
        capture_output=True,
        text=True,
        timeout=60,
        env={**os.environ, "PYTHONPATH": path, "RIG_OWN_PROCESS": "1", **environment},
    )


def test_compiling_is_told_once_and_only_when_it_happens(tmp_path):
    kept = str(tmp_path / "kept")
    cold, warm = run(tmp_path, "1.0), twice(1", RIG_KERNELS=kept), run(tmp_path, "1.0), twice(1", RIG_KERNELS=kept)
    assert (cold.stdout, cold.stderr) == ("2.0 2\n", TOLD)
    assert (warm.stdout, warm.stderr) == ("2.0 2\n", "")


def test_a_place_that_cannot_be_written_costs_time_only(tmp_path):
    (tmp_path / "file").write_text("")
    kept = tmp_path / "file" / "kept"
    for _ in range(2):
        found = run(tmp_path, RIG_KERNELS=str(kept))
        assert found.stdout == "2.0\n", found.stderr
        assert f"at every start, for {kept} cannot be written" in found.stderr
        assert "RIG_KERNELS=/some/folder" in found.stderr
    assert not list(tmp_path.rglob("*.nbi"))  # nothing that an edit elsewhere would not renew
