"""The lessons: every number comes out, and `rig lesson` prints them."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import psutil
import pytest
from patience import wait_for

from rig import scenes
from rig.cli import app
from rig.cli.lesson import for_a_terminal
from rig.lessons import FOLDER, attempt, compare, lesson, lessons, renew, renewed
from rig.lessons.page import Command, read

ROOT = Path(__file__).parents[2]
ALL = lessons()
QUICK = 1


@pytest.fixture(autouse=True)
def _found_by_commands(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH")))))


def every_number(one, folder):
    """Run the commands of a lesson in their order; returns how many numbers were compared."""
    count = 0
    for command in one.commands:
        outcome = attempt(command, folder)
        for found in compare(command, outcome.code, outcome.report):
            assert found.agrees, f"{command.text}: {found.expected}, found {found.value}\n{outcome.notes}"
            count += 1
        if "--figure" in command.words:
            assert (folder / command.words[command.words.index("--figure") + 1]).stat().st_size > 1000
    return count


def every_line(one, folder):
    """The lines that the page shows are in the output of the commands."""
    for command in one.commands:
        new = renewed(command, attempt(command, folder, as_json=False).printed)
        assert new == list(command.printed), command.text


def test_numbers_and_lines_of_a_short_lesson_come_out(tmp_path):
    assert every_number(lesson(QUICK), tmp_path) >= 10
    every_line(replace(lesson(QUICK), experiment=lesson(QUICK).commands[:1]), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("one", ALL, ids=lambda one: one.file.stem)
def test_all_numbers_of_a_lesson_come_out_within_two_minutes(one, tmp_path):
    begin = time.monotonic()
    assert every_number(one, tmp_path) >= 5
    assert time.monotonic() - begin < 120
    every_line(one, tmp_path)


NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


@pytest.mark.parametrize(
    "file",
    [NOTEBOOKS[0], *(pytest.param(one, marks=pytest.mark.slow) for one in NOTEBOOKS[1:])],
    ids=lambda one: one.stem,
)
def test_the_code_of_a_notebook_runs_and_no_output_is_kept(file, tmp_path):
    cells = [cell for cell in json.loads(file.read_text())["cells"] if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] for cell in cells)
    code = "\n".join("".join(cell["source"]) for cell in cells)
    assert code.count("assert ") >= 1
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "MPLBACKEND": "agg"},
    )
    assert done.returncode == 0, done.stderr


SLOW_TO_END = """
import signal, time
def end(number, frame):
    time.sleep(0.5)  # it completes its recording
    open("kept", "w").close()
    raise SystemExit(130)
signal.signal(signal.SIGINT, end)
open("begun", "w").close()
time.sleep(60.0)
"""


def test_ctrl_c_waits_until_a_command_has_kept_what_it_has_done(tmp_path, monkeypatch):
    """Only this process gets the signal, as from a terminal: commands are in a session of their own."""
    (tmp_path / "rig.py").write_text(SLOW_TO_END)  # stands for `python -m rig`
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))

    def interrupt():
        wait_for((tmp_path / "begun").exists)
        os.kill(os.getpid(), signal.SIGINT)

    before = set(psutil.Process().children())
    watch = threading.Thread(target=interrupt)
    watch.start()
    with pytest.raises(KeyboardInterrupt):
        attempt(Command(("simulate",), ()), tmp_path)
    watch.join()
    assert (tmp_path / "kept").exists()
    assert set(psutil.Process().children()) <= before


PAGE = """# T

| subject | content |
|---|---|
| time | 1 minute |
| needed before | nothing |
| you learn | x |
| scene | `belt` |

## Question

Why?

## Experiment

```
rig modes belt
```

```text
  mode     growth 1/s  ...
  flutter         3.6  ...
  ...
  normal_force = 21 N
```

| quantity | expected | tolerance |
|---|---|---|
| growth rate | 3.6 1/s | 0.01 |
| stable | yes | exact |

<!-- in the report:
modes.0.growth
stable
-->

## Solutions

x

## What to try next

y
"""


def test_a_wrong_number_does_not_agree(tmp_path):
    file = tmp_path / "01_t.md"
    file.write_text(PAGE)
    (command,) = read(file).commands
    outcome = attempt(command, tmp_path)
    code, growth, stable = compare(command, outcome.code, outcome.report)
    assert code.agrees
    assert (growth.agrees, stable.agrees, stable.value) == (False, False, "no")
    assert growth.value == pytest.approx(3.6553, abs=1e-3)
    renew(read(file))
    assert read(file).commands[0].printed == (
        "  mode     growth 1/s  ...",
        "  flutter         3.65529  ...",
        "  ...",
        "  normal_force = 20 N",
    )
    assert file.read_text().replace("3.65529  ", "3.6  ").replace("20 N", "21 N") == PAGE


def test_solutions_are_printed_on_request(capsys):
    one = lesson(QUICK)
    first = one.solutions.splitlines()[0]
    for options in ([], ["--json"], ["--solutions"]):
        with pytest.raises(SystemExit):
            app.run(["lesson", str(QUICK), *options])
        assert (first in capsys.readouterr().out) is (options == ["--solutions"])


@pytest.mark.parametrize("one", ALL, ids=lambda one: one.file.stem)
def test_links_of_a_page_lead_somewhere_in_a_terminal(one, tmp_path, monkeypatch):
    """From a folder of the source: to files. From a wheel, which has the lessons alone: a command of the page does."""
    shown = for_a_terminal(one.file.read_text())
    assert "](" not in shown
    assert "in the source" not in shown
    for file in re.findall(r"`(/\S+)`", shown):
        assert Path(file).is_file()
    for scene in re.findall(r"`rig explain (\S+)`", one.next):
        assert scene in scenes.names()
    monkeypatch.setattr("rig.lessons.FOLDER", tmp_path / "rig" / "lessons" / "pages")
    for line in for_a_terminal(one.next).splitlines():
        assert "in the source of friction-rig" not in line or re.search(r"`rig (explain \w+|\w+ --help)`", line), line
