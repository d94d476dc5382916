"""Runs a command of a lesson, and compares its report and its output with the numbers and lines of the page."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from difflib import SequenceMatcher
from pathlib import Path
from typing import Any

from rig.child_process import STEPS
from rig.errors import WorkerError
from rig.lessons.page import COMMAND, EXIT_CODE, FOLDER, Command, Expected, Lesson

LONGEST_S = 600.0
"""Longest time that a command may take [s]."""
_DIGITS = re.compile(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?")
_WRITES = ("--out", "--figure", "--csv")


@dataclass(frozen=True)
class Outcome:
    """What a command gave.

    `printed`: its standard output; `report`: that as JSON, None if it is none; `notes`: its standard error.
    """

    code: int
    report: Any
    notes: str
    printed: str


@dataclass(frozen=True)
class Found:
    """A number of a report beside the one that the page expects. `value`: None if the report has no such place."""

    expected: Expected
    value: Any
    agrees: bool

    @property
    def text(self) -> str:
        """The value with its unit, for a reader."""
        if self.value is None:
            return "nothing"
        shown = f"{self.value:.6g}" if isinstance(self.value, float) else str(self.value)
        return f"{shown} {self.expected.unit}".strip()


def attempt(command: Command, folder: Path, as_json: bool = True) -> Outcome:
    """Run `command` in `folder`, with a report as JSON or as a reader sees it; files of an earlier run are replaced.

    The command is a process in a session of its own: on Ctrl-C it is asked to stop and has time to complete what it
    writes. Raises WorkerError after `LONGEST_S`.
    """
    words = [*command.words, "--json"] if as_json else [*command.words]
    if any(word in _WRITES for word in words) and "--force" not in words:
        words.append("--force")
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "rig", *words],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        printed, notes = process.communicate(timeout=LONGEST_S)
    except subprocess.TimeoutExpired:
        _end(process)
        raise WorkerError(f"{command.text}: no end within {LONGEST_S:g} s, and therefore stopped") from None
    except KeyboardInterrupt:
        _end(process)
        raise
    try:
        report = json.loads(printed)
    except ValueError:
        report = None
    return Outcome(process.returncode, report, notes, printed)


def _end(process: subprocess.Popen[str]) -> None:
    """End a command and wait for it: by Ctrl-C first, so that it keeps what it has done."""
    for number, patience in STEPS:
        process.send_signal(number)
        try:
            process.communicate(timeout=patience)
        except subprocess.TimeoutExpired:
            continue
        return


def compare(command: Command, outcome: Outcome) -> list[Found]:
    """The expected numbers beside those that were found; the exit code 0 is expected unless the page says otherwise."""
    expected = list(command.expected)
    if EXIT_CODE not in (one.place for one in expected):
        expected.insert(0, Expected("exit code", EXIT_CODE, 0.0, "", 0.0))
    return [_found(one, outcome) for one in expected]


def _found(expected: Expected, outcome: Outcome) -> Found:
    value = outcome.code if expected.place == EXIT_CODE else at(outcome.report, expected.place)
    if isinstance(value, bool):
        value = "yes" if value else "no"
    if isinstance(expected.value, str) or not isinstance(value, int | float):
        return Found(expected, value, value == expected.value)
    return Found(expected, value, abs(value - expected.value) <= expected.tolerance)


def at(report: Any, place: str) -> Any:
    """What a report has at a place such as `modes.0.growth`; None if there is no such place."""
    for step in place.split("."):
        try:
            report = report[int(step)] if isinstance(report, list) else report[step]
        except (KeyError, IndexError, TypeError, ValueError):
            return None
    return report


def renewed(command: Command, printed: str) -> list[str]:
    """The lines of a page with the numbers that the command has printed; equal to the page's if these still hold.

    Raises ValueError for a line without one that differs from it in numbers only.
    """
    return [_renewed(line, printed, command) if line.strip() else line for line in command.printed]


def _renewed(line: str, printed: str, command: Command) -> str:
    words = line.split()
    texts = [_DIGITS.split(word) for word in words]
    patterns = [f"({_DIGITS.pattern.join(map(re.escape, text))})" for text in texts]
    form = re.compile(r"\s+".join("(.*)" if word == "..." else each for word, each in zip(words, patterns)))
    alike = [(each, match) for each in printed.splitlines() if (match := form.fullmatch(each.strip()))]
    if not alike:
        raise ValueError(f"{command.text}: prints no line such as: {line}")
    whole, nearest = max(alike, key=lambda pair: SequenceMatcher(None, words, pair[0].split()).ratio())
    if "..." in words:
        new = iter(nearest.groups())
        return re.sub(r"\S+", lambda word: value if (value := next(new)) and word[0] != "..." else word[0], line)
    return line if whole.split() == words else whole.rstrip()


def renew(lesson: Lesson) -> None:
    """Run the commands of a lesson again, and replace the lines that its page shows and its figures."""
    commands = iter(lesson.commands)

    def again(match: re.Match[str]) -> str:
        command = next(commands)
        lines = renewed(command, attempt(command, folder, as_json=False).printed)
        return match[0].replace(match[2], "\n".join(lines) + "\n", 1) if lines else match[0]

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        page = COMMAND.sub(again, lesson.file.read_text(encoding="utf-8"))
        for figure in folder.glob("*.png"):
            shutil.copyfile(figure, FOLDER / figure.name)
    lesson.file.write_text(page, encoding="utf-8")
