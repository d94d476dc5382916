"""Lessons on the page: their list, their text as HTML, their figures, and jobs that run their commands.

A job has a folder of its own for each lesson, so that a command finds what the one before it has written. When it has
ended, the numbers of its report stand beside those that the page of the lesson expects.
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rig.errors import UsageError
from rig.lessons import FOLDER, SECTIONS, Lesson, compare, lesson, lessons, prepared, readable
from rig.web.jobs import Jobs

GERMAN = Path(__file__).parent / "page" / "german.json"
"""The catalogue of the page: sections of English texts with their translations."""
_SOLUTIONS = SECTIONS.index("Solutions")


def listed(_: dict[str, Any]) -> Any:
    """Number, title, time and scene of every lesson."""
    return [
        {"number": entry.number, "title": entry.title, "time": entry.facts["time"], "scene": entry.scene}
        for entry in lessons()
    ]


def text(body: dict[str, Any]) -> Any:
    """The text of a lesson as HTML, in German for "de". Raises UsageError for a number that no lesson has."""
    german = json.loads(GERMAN.read_text(encoding="utf-8")) if body.get("language") == "de" else {}
    known = {text: other for entries in german.values() for text, other in entries.items()}
    page = _chosen(body).file.read_text(encoding="utf-8")
    return {"html": html(page, known)}


def _chosen(body: dict[str, Any]) -> Lesson:
    number = body.get("number")
    if isinstance(number, bool) or not isinstance(number, int):
        raise UsageError(f'"number" is {number!r:.80}; expected the number of a lesson')
    return lesson(number)


def figure(name: str) -> Path:
    """The file of a figure. Raises UsageError for a name that is none of the lessons."""
    figures = {file.name: file for file in FOLDER.glob("*.png")}
    if name not in figures:
        raise UsageError(f"{name!r:.80}: no lesson has this figure")
    return figures[name]


class LessonJobs:
    """The commands of lessons as `jobs`."""

    def __init__(self, jobs: Jobs) -> None:
        self._jobs = jobs
        self._folders: dict[int, Path] = {}

    def run(self, body: dict[str, Any]) -> dict[str, Any]:
        """Start a command of a lesson: `number`, `command`. Raises UsageError for one that its page does not have."""
        chosen = _chosen(body)
        line: Any = body.get("command")
        lines = chosen.file.read_text(encoding="utf-8").splitlines()
        typed = shlex.split(line) if line in lines and line.startswith("rig ") else []
        command = next((command for command in chosen.commands if ["rig", *command.words] == typed), None)
        if command is None:
            raise UsageError(f"{line!r:.80} is no command of this lesson")
        if chosen.number not in self._folders:
            self._folders[chosen.number] = self._jobs.folder()
        folder = self._folders[chosen.number]
        words = prepared(command, folder)
        figure = None
        if "--figure" in words:
            figure = folder / words[words.index("--figure") + 1]

        def numbers(code: int, report: Any) -> list[dict[str, Any]]:
            rows = compare(command, code, report)
            return [{"quantity": row.expected.quantity, "value": row.text, "agrees": row.agrees} for row in rows]

        return self._jobs.start(line, words, figure, folder, numbers)


def html(page: str, known: Mapping[str, str]) -> str:
    """A page as HTML, its figures from /lessons/. Links to other pages of the site become plain text.

    A paragraph, heading or cell that is `known` (with spaces for ends of lines) is replaced; output stays as it is. The
    section Solutions is closed.
    """
    from markdown_it import MarkdownIt

    parser = MarkdownIt("commonmark", {"html": False}).enable("table")
    tokens = parser.parse(readable(page))
    for block in tokens:
        translation = known.get(block.content.replace("\n", " ")) if block.type == "inline" else None
        if translation:
            block.children = parser.parseInline(translation)[0].children
        block.children = [token for token in block.children or () if token.type not in ("link_open", "link_close")]
        for token in block.children:
            if token.type == "image":
                token.attrSet("src", f"/lessons/{token.attrGet('src')}")
    heads = [place for place, token in enumerate(tokens) if token.type == "heading_open" and token.tag == "h2"]
    begin = heads[_SOLUTIONS]
    end = heads[_SOLUTIONS + 1]
    spans = (tokens[:begin], tokens[begin : begin + 3], tokens[begin + 3 : end], tokens[end:])  # a heading: 3 tokens
    before, heading, solutions, after = (parser.renderer.render(span, parser.options, {}) for span in spans)
    return f"{before}<details><summary>{heading}</summary>{solutions}</details>{after}"
