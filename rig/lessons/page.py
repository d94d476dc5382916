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
"""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

from rig.errors import UsageError

FOLDER = Path(__file__).parent / "pages"
"""Folder of the pages and their figures."""
SECTIONS = ("Question", "Experiment", "Solutions", "What to try next")
"""The sections of a page, in their order."""
COMMAND = re.compile(
    r"^```\n(rig .+)\n```\n"
    r"(?:\n```text\n((?:(?!```).*\n)+)```\n)?"
    r"(?:\n(\| quantity \|.*\n\|[-|]+\n(?:\|.*\n)+)(?:\n<!-- in the report:\n((?:(?!-->).*\n)+)-->\n)?)?",
    re.MULTILINE,
)
"""A command of a page, the lines that it prints, the rows of its table, and the places of their numbers."""
_FILE = re.compile(r"(?<=^```toml\n)# (\w+\.toml)\n(?:(?!```).*\n)+", re.MULTILINE)
"""A file that a page asks for, and its name."""
_NUMBER = re.compile(r"([-+]?\d[\d.]*(?:e[-+]?\d+)?)\s*(.*)")
"""A number of a table, and its unit."""
_FACTS = {"time", "needed before", "you learn", "scene"}
"""Rows of the table at the head of a page."""


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
    missing = _FACTS - facts.keys()
    if missing:
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
        words = tuple(shlex.split(match[1]))[1:]
        printed = tuple((match[2] or "").splitlines())
        rows = (match[3] or "").splitlines()[2:]
        places = (match[4] or "").split("\n")[:-1]
        if len(rows) != len(places):
            raise ValueError(
                f"{file}: {match[1]}: {len(rows)} rows, but {len(places)} places in the comment behind them"
            )
        expected = tuple(_expected(row, place, file) for row, place in zip(rows, places))
        files = tuple((toml[1], toml[0]) for toml in _FILE.finditer(text[end : match.start()]))
        parts.append(Command(words, expected, printed, files))
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
    name, value, tolerance = cells
    quantity = name.replace("`", "")
    number = _NUMBER.fullmatch(value)
    if tolerance == "exact":
        if number is None:
            return Expected(quantity, place, value.strip("`"), "", 0.0)
        return Expected(quantity, place, float(number[1]), number[2], 0.0)
    bound = _NUMBER.fullmatch(tolerance)
    if number is None or bound is None:
        raise ValueError(f"{file}: {row}: expected a number and a tolerance")
    share = bound[2] == "%"
    width = abs(float(number[1])) * float(bound[1]) / 100 if share else float(bound[1])
    if not share and bound[2] not in ("", number[2]):
        raise ValueError(f"{file}: {row}: the tolerance is in another unit than the value")
    return Expected(quantity, place, float(number[1]), number[2], width)
