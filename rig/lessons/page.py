"""The page of a lesson, in parts.

A page is Markdown with the sections Question, Experiment, Solutions and What to try next. A table at its head states
the time, what is needed before, what one learns and the scene. In Experiment a fence holds one command. A table behind
it states what its report (`--json`) must contain:

    | quantity | in the report | expected | tolerance |
    |---|---|---|---|
    | growth rate | `modes.0.growth` | 3.655 1/s | 0.1 % |

A fence of TOML that begins with a comment with the name of a file (`# mine.toml`) is that file, for the next command.

A place is a path of keys and indices. A tolerance is a number in the unit of the expected value, a share of it in %, or
`exact`. The place `exit code` is that of the command; without such a row it must be 0.

Runs a command of a lesson, and replaces the lines of the page by what it prints.
"""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from difflib import SequenceMatcher
from pathlib import Path
from typing import Any

from rig.errors import UsageError, WorkerError
from rig.machine.process import STEPS

FOLDER = Path(__file__).parent / "pages"
"""Folder of the pages and their figures."""
RECORDINGS = Path(__file__).parents[2] / "recordings"
"""Measured files in the folder of the project, from which commands of a lesson may read."""
SECTIONS = ("Question", "Experiment", "Solutions", "What to try next")

_NUMBER = re.compile(r"([-+]?\d[\d.]*(?:e[-+]?\d+)?)\s*(.*)")
COMMAND = re.compile(
    r"^```\n(rig .+)\n```\n"
    r"(?:\n```text\n((?:(?!```).*\n)+)```\n)?"
    r"(?:\n(\| quantity \|.*\n\|[-|]+\n(?:\|.*\n)+)(?:\n<!-- in the report:\n((?:(?!-->).*\n)+)-->\n)?)?",
    re.MULTILINE,
)
"""A command of a page, the lines that it prints, the rows of its table, and the places of their numbers."""


_FILE = re.compile(r"(?<=^```toml\n)# (\w+\.toml)\n(?:(?!```).*\n)+", re.MULTILINE)
LONGEST_S = 600.0
"""Longest time that a command may take [s]."""
_DIGITS = re.compile(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?")
_WRITES = ("--out", "--figure", "--csv", "--law")
_KEEP = ("branches", "cost", "map", "optimise", "study")
"""Commands that keep their results in a folder, and do not replace them without --force."""


@dataclass(frozen=True)
class Expected:
    """One expected number of a report. `tolerance` is in the unit of `value`; 0 means equal."""

    quantity: str
    place: str
    value: float | str
    unit: str
    tolerance: float


@dataclass(frozen=True)
class Command:
    """A command of a lesson, without `rig`, what its report must contain, and lines that it prints."""

    words: tuple[str, ...]
    expected: tuple[Expected, ...]
    printed: tuple[str, ...] = ()
    files: tuple[tuple[str, str], ...] = ()
    """Name and text of the files that the page asks for before the command."""

    @property
    def text(self) -> str:
        """The command as it is typed."""
        return "rig " + shlex.join(self.words)


@dataclass(frozen=True)
class Lesson:
    """A lesson. `facts`: the rows of the table at the head; `experiment`: texts and commands in their order."""

    number: int
    file: Path
    title: str
    facts: dict[str, str]
    question: str
    experiment: tuple[str | Command, ...]
    solutions: str
    next: str

    @property
    def commands(self) -> list[Command]:
        """The commands, in their order."""
        return [part for part in self.experiment if isinstance(part, Command)]

    @property
    def asked(self) -> str:
        """The questions alone, without what they are about."""
        sentences = re.split(r"(?<=[.?]) ", " ".join(self.question.split()))
        return " ".join(sentence for sentence in sentences if sentence.endswith("?"))

    @property
    def scene(self) -> str:
        """The scene to start with."""
        return self.facts["scene"].strip("`")


def lessons() -> list[Lesson]:
    """All lessons, by number."""
    return [read(file) for file in sorted(FOLDER.glob("[0-9][0-9]_*.md"))]


def lesson(number: int) -> Lesson:
    """The lesson of this number. Raises UsageError if there is none."""
    files = {int(file.name[:2]): file for file in FOLDER.glob("[0-9][0-9]_*.md")}
    if number not in files:
        raise UsageError(f"{number}: no lesson has this number; there are {len(files)}: rig lesson")
    return read(files[number])


def read(file: Path) -> Lesson:
    """Read the page of a lesson. Raises ValueError for a page that does not have the parts of one."""
    head, *sections = re.split(r"^## (.+)\n", file.read_text(encoding="utf-8"), flags=re.MULTILINE)
    parts = dict(zip(sections[::2], map(str.strip, sections[1::2])))
    if tuple(parts) != SECTIONS:
        raise ValueError(f"{file}: has the sections {', '.join(parts)}; expected {', '.join(SECTIONS)}")
    title = re.match(r"# (.+)\n", head)
    if title is None:
        raise ValueError(f"{file}: begins without a title")
    rows = [_cells(line) for line in head.splitlines() if line.startswith("| ") and line.strip("| ")]
    facts = dict(row for row in rows[1:] if len(row) == 2)  # without the heads of the columns
    if missing := {"time", "needed before", "you learn", "scene"} - facts.keys():
        raise ValueError(f"{file}: the table at the head has no row {', '.join(sorted(missing))}")
    experiment = _parts(parts["Experiment"] + "\n", file)
    return Lesson(
        int(file.name[:2]), file, title[1], facts, parts["Question"], experiment, parts["Solutions"], parts[SECTIONS[3]]
    )


def readable(page: str) -> str:
    """The text of a page without its comments, which are for the tests."""
    return re.sub(r"<!--.*?-->\n*", "", page, flags=re.DOTALL)


def _parts(text: str, file: Path) -> tuple[str | Command, ...]:
    parts: list[str | Command] = []
    end = 0
    for match in COMMAND.finditer(text):
        parts.append(text[end : match.start()].strip())
        words, printed = tuple(shlex.split(match[1]))[1:], tuple((match[2] or "").splitlines())
        rows, places = (match[3] or "").splitlines()[2:], (match[4] or "").split("\n")[:-1]
        if len(rows) != len(places):
            raise ValueError(
                f"{file}: {match[1]}: {len(rows)} rows, but {len(places)} places in the comment behind them"
            )
        expected = tuple(_expected(row, place, file) for row, place in zip(rows, places))
        written = tuple((made[1], made[0]) for made in _FILE.finditer(text[end : match.start()]))
        parts.append(Command(words, expected, printed, written))
        end = match.end()
    parts.append(text[end:].strip())
    left = "\n".join(part for part in parts if isinstance(part, str))
    if re.search(r"^(```\nrig |\| quantity|<!--)", left, re.MULTILINE):
        raise ValueError(f"{file}: a fence must hold one command, and the table of its numbers must follow it")
    return tuple(part for part in parts if part)


def _cells(row: str) -> list[str]:
    return [cell.strip() for cell in row.strip().strip("|").split("|")]


def _expected(row: str, place: str, file: Path) -> Expected:
    cells = _cells(row)
    if len(cells) != 3:
        raise ValueError(f"{file}: {row}: expected three columns")
    quantity, value, tolerance = cells[0].replace("`", ""), *cells[1:]
    if tolerance == "exact":
        number = _NUMBER.fullmatch(value)
        return Expected(
            quantity, place, float(number[1]) if number else value.strip("`"), number[2] if number else "", 0.0
        )
    number, bound = _NUMBER.fullmatch(value), _NUMBER.fullmatch(tolerance)
    if number is None or bound is None:
        raise ValueError(f"{file}: {row}: expected a number and a tolerance")
    share = bound[2] == "%"
    width = abs(float(number[1])) * float(bound[1]) / 100 if share else float(bound[1])
    if not share and bound[2] not in ("", number[2]):
        raise ValueError(f"{file}: {row}: the tolerance is in another unit than the value")
    return Expected(quantity, place, float(number[1]), number[2], width)


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
    if not (measured := folder / RECORDINGS.name).exists() and RECORDINGS.name in "".join(command.words):
        measured.symlink_to(RECORDINGS)
    writes = command.words[0] in _KEEP or any(word in _WRITES for word in command.words)
    return [*command.words, *(["--force"] if writes and "--force" not in command.words else [])]


def attempt(command: Command, folder: Path, as_json: bool = True) -> Outcome:
    """Run `command` in `folder`, with a report as JSON or as a reader sees it; files of an earlier run are replaced.

    The command is a process in a session of its own: on Ctrl-C it is asked to stop and has time to complete what it
    writes. Raises WorkerError after `LONGEST_S`.
    """
    words = [*prepared(command, folder), *(["--json"] if as_json else [])]
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
