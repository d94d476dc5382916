"""The lessons on the page: their list, their text as HTML, their figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rig.errors import UsageError
from rig.lessons import FOLDER, lesson, lessons, readable


def listed(_: dict[str, Any]) -> Any:
    """Number, title, time and scene of every lesson."""
    return [
        {"number": one.number, "title": one.title, "time": one.facts["time"], "scene": one.scene} for one in lessons()
    ]


def text(body: dict[str, Any]) -> Any:
    """The text of a lesson as HTML. Raises UsageError for a number that no lesson has."""
    number = body.get("number")
    if isinstance(number, bool) or not isinstance(number, int):
        raise UsageError(f'"number" is {number!r:.80}; expected the number of a lesson')
    return {"html": html(lesson(number).file.read_text(encoding="utf-8"))}


def figure(name: str) -> Path:
    """The file of a figure. Raises UsageError for a name that is none of the lessons."""
    for file in FOLDER.glob("*.png"):
        if file.name == name:
            return file
    raise UsageError(f"{name!r:.80}: no lesson has this figure")


def html(page: str) -> str:
    """A page as HTML, its figures from /lessons/. Links to other pages of the site become plain text."""
    from markdown_it import MarkdownIt

    parser = MarkdownIt("commonmark", {"html": False}).enable("table")
    tokens = parser.parse(readable(page))
    for block in tokens:
        block.children = [one for one in block.children or () if one.type not in ("link_open", "link_close")]
        for one in block.children:
            if one.type == "image":
                one.attrSet("src", f"/lessons/{one.attrGet('src')}")
    return str(parser.renderer.render(tokens, parser.options, {}))
