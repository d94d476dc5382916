"""On a system without locks of files, unix sockets and real-time scheduling: all but live runs works."""

import os
import subprocess
import sys

import pytest

BARE = """
import os, signal, socket, sys
import platformdirs  # knows its systems, and has to see which one this is
for module in ("fcntl", "resource", "pwd", "grp", "termios"):
    sys.modules[module] = None
hidden = {
    os: "sched_getaffinity sched_setscheduler sched_param SCHED_FIFO SCHED_OTHER getuid geteuid getloadavg fork mkfifo "
        "O_CLOEXEC pread pwrite",
    socket: "AF_UNIX", signal: "SIGHUP SIGKILL SIGXCPU",
}
for module, names in hidden.items():
    for name in names.split():
        delattr(module, name)
from rig.cli import app
app.run(sys.argv[1:])
"""


@pytest.fixture
def bare(tmp_path):
    """Runs a command on such a system: exit code, standard output, standard error."""

    def call(*arguments):
        found = subprocess.run(
            [sys.executable, "-c", BARE, *map(str, arguments)],
            capture_output=True,
            text=True,
            timeout=300,
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        )
        return found.returncode, found.stdout, found.stderr

    return call


def test_a_simulation_is_recorded_and_drawn(bare, tmp_path):
    code, out, err = bare("simulate", "belt", "--duration", 1, "--out", "log.mcap", "--figure", "figure.png")
    assert code == 0, err
    assert "log.mcap" in out
    assert (tmp_path / "figure.png").stat().st_size > 10_000


@pytest.mark.slow
def test_recordings_and_studies_work(bare, tmp_path):
    for arguments, told in [
        (("simulate", "belt", "--duration", 1, "--out", "log.mcap"), "log.mcap"),
        (("verify", "log.mcap"), "verified"),
        (("modes", "belt"), "flutter"),
        (("cycle", "belt"), "Floquet multipliers"),
        (("map", "belt", "--x", "drive.speed=0.05 m/s:0.1 m/s:2", "--workers", 1, "--out", "speeds"), "speeds"),
    ]:
        code, out, err = bare(*arguments)
        assert code == 0, err
        assert told in out


def test_live_runs_are_refused_before_anything_starts(bare):
    code, _, err = bare("run", "belt", "--duration", 1)
    assert code == 2, err
    assert "live runs need file locks and unix sockets, which this system does not have" in err
    assert "Traceback" not in err
