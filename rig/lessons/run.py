"""Runs the commands of a lesson, and replaces the lines that its page shows by what they print."""

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

from rig.errors import WorkerError
from rig.lessons.page import COMMAND, FOLDER, Command, Lesson
from rig.machine.process import STEPS

RECORDINGS = Path(__file__).parents[2] / "recordings"
"""Measured files in the folder of the project, from which commands of a lesson may read."""
LONGEST_S = 600.0
"""Longest time that a command may take [s]. # chosen"""
_DIGITS = re.compile(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?")
"""A number in a line that a command prints."""
_WRITES = ("--out", "--figure", "--csv", "--law")
"""Options of commands that write a file, and do not replace it without --force."""
_KEEP = ("branches", "cost", "map", "optimise", "study")
"""Commands that keep their results in a folder, and do not replace them without --force."""


@dataclass(frozen=True)
class Outcome:
    """What a command gave.

    `printed`: its standard output; `report`: that as JSON, None if it is none; `notes`: its standard error.
    """

    code: int
    report: Any
    notes: str
    printed: str


def prepared(command: Command, folder: Path) -> list[str]:
    """The words after `rig` that run `command` in `folder`, with the files that it reads; it replaces what it wrote."""
    for name, text in command.files:
        (folder / name).write_text(text, encoding="utf-8")
    recordings = folder / RECORDINGS.name
    if RECORDINGS.name in "".join(command.words) and not recordings.exists():
        recordings.symlink_to(RECORDINGS)
    words = [*command.words]
    writes = command.words[0] in _KEEP or any(word in _WRITES for word in command.words)
    if writes and "--force" not in words:
        words.append("--force")
    return words


def attempt(command: Command, folder: Path, as_json: bool = True) -> Outcome:
    """Run `command` in `folder`, with a report as JSON or as a reader sees it; files of an earlier run are replaced.

    The command is a process in a session of its own: on Ctrl-C it is asked to stop and has time to complete what it
    writes. Raises WorkerError after `LONGEST_S`.
    """
    words = prepared(command, folder)
    if as_json:
        words.append("--json")
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


def renewed(command: Command, printed: str) -> list[str]:
    """The lines of a page with the numbers that the command has printed; equal to the page's if these still hold.

    Raises ValueError for a line without one that differs from it in numbers only.
    """
    return [_renewed(line, printed, command) if line.strip() else line for line in command.printed]


def _renewed(line: str, printed: str, command: Command) -> str:
    words = line.split()
    texts = [_DIGITS.split(word) for word in words]
    patterns = [f"({_DIGITS.pattern.join(map(re.escape, text))})" for text in texts]
    form = re.compile(r"\s+".join("(.*)" if word == "..." else pattern for word, pattern in zip(words, patterns)))
    alike = [text for text in printed.splitlines() if form.fullmatch(text.strip())]
    if not alike:
        raise ValueError(f"{command.text}: prints no line such as: {line}")
    nearest = max(alike, key=lambda text: SequenceMatcher(None, words, text.split()).ratio())
    if "..." not in words:
        return line if nearest.split() == words else nearest.rstrip()
    match = form.fullmatch(nearest.strip())
    assert match is not None
    values = iter(match.groups())

    def of_now(word: re.Match[str]) -> str:
        value: str = next(values)
        return value if value and word[0] != "..." else word[0]

    return re.sub(r"\S+", of_now, line)


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
