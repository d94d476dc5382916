"""Exit codes: one rule for all commands, as docs/commands.md states it."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from rig import scenes
from rig.bench.live.outcome import Job, Outcome
from rig.bench.live.plant_process import carry_out
from rig.cli.app import program
from rig.errors import ExitCode

ROOT = Path(__file__).parents[2]
REQUIRED = {
    "map": ["--x", "drive.speed=0:1:5"],
    "fmu": ["--out", "plant.fmu"],
    "optimise": ["--over", "load.force=10:20", "--minimise", "cycle.amplitude"],
}
"""Options without which a command does not begin."""


def test_the_page_of_the_commands_states_all_codes():
    section = (ROOT / "docs" / "commands.md").read_text().partition("## Exit codes")[2].partition("\n## ")[0]
    assert [int(code) for code in re.findall(r"^\| (\d+) \|", section, re.MULTILINE)] == list(ExitCode)


SCENES = [name for name, of in program.commands.items() if any(p.name == "scene" and p.nargs == 1 for p in of.params)]


@pytest.mark.parametrize("command", SCENES)
def test_a_scene_that_is_not_there_is_a_mistake(rig, command, tmp_path):
    code, _, err = rig(command, tmp_path / "none.toml", *REQUIRED.get(command, []))
    assert code == ExitCode.MISTAKE
    assert "none.toml" in err


@pytest.mark.parametrize("duration", [None, 60.0])
def test_an_interrupted_run_is_complete_only_if_it_has_no_end_of_its_own(tmp_path, monkeypatch, duration):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    endless = tmp_path / "endless.toml"
    endless.write_text(
        'based_on = "belt_c"\nprotocol = [{ step = "repeat", times = "forever", '
        'steps = [{ step = "hold", time = "1 s" }] }]\n'
    )
    job = Job(scenes.load(endless).to_json(), run="ends", pace=None, duration=duration)
    summary = carry_out(job, lambda _: None, lambda _: os.kill(os.getpid(), signal.SIGINT))
    outcome = Outcome(summary)
    assert summary["ended"] == "stopped by SIGINT"
    assert outcome.exit_code == (ExitCode.DONE if duration is None else ExitCode.INTERRUPTED)
    assert outcome.without_recording("the disk is full").exit_code == ExitCode.FAILED


@pytest.mark.skipif(os.name != "posix", reason="closes descriptors as a shell does")
@pytest.mark.parametrize(("command", "code", "closed"), [(["list"], 0, (1,)), (["list", "nowhere"], 2, (0, 1, 2))])
def test_closed_streams_are_no_fault(tmp_path, command, code, closed):
    rest = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    shell = f"exec {sys.executable} -m rig {' '.join(command)} {' '.join(f'{number}>&-' for number in closed)}"
    done = subprocess.run(shell, shell=True, cwd=tmp_path, text=True, timeout=60, **rest)
    assert "Traceback" not in done.stdout + done.stderr
    assert done.returncode == code


@pytest.mark.skipif(os.name != "posix", reason="this system has no such limit")
def test_too_few_open_files_are_named_with_what_to_do(tmp_path):
    shell = f"ulimit -n 12; exec {sys.executable} -m rig map belt --x drive.speed=0.05:0.06:2"
    done = subprocess.run(shell, shell=True, cwd=tmp_path, capture_output=True, text=True, timeout=100)
    assert "Traceback" not in done.stderr
    assert done.returncode == 0 or "ulimit -n 1024" in done.stderr
