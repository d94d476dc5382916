"""rig lesson: lists the lessons, or prints one of them."""

from __future__ import annotations

import re
import sys
from typing import TYPE_CHECKING, Annotated, Any

from rig.cli import printing
from rig.cli.build import Made, Told
from rig.parameters import Argument, Option

if TYPE_CHECKING:
    from rig.lessons import Lesson


def lesson(
    number: Annotated[int | None, Argument("N", "Number of the lesson. Default: list all lessons.")] = None,
    solutions: Annotated[bool, Option("", "Print the solutions too.")] = False,
) -> Told:
    """List the lessons, or print lesson N without its solutions.

    `rig web` shows them with a button for each command.
    """
    from rig.lessons import lesson as of
    from rig.lessons import lessons

    if number is None:
        return _list(lessons())
    chosen = of(number)
    page = chosen.file.read_text(encoding="utf-8")
    if not solutions:
        page = page.replace(chosen.solutions, f"They are printed by `rig lesson {number} --solutions`.")
    return Told(_card(chosen) | {"page": page}, show=lambda: _show(for_a_terminal(page)))


def _show(text: str) -> None:
    """Print Markdown, in a terminal in its width."""
    if not sys.stdout.isatty():
        printing.line(text)
        return
    from rich.console import Console
    from rich.markdown import Markdown

    Console(width=min(Console().width, 100)).print(Markdown(text, hyperlinks=False))


def _card(lesson: Lesson) -> dict[str, Any]:
    return {
        "number": lesson.number,
        "title": lesson.title,
        **lesson.facts,
        "scene": lesson.scene,
        "question": lesson.question,
    }


def _list(all_of_them: list[Lesson]) -> Told:
    def show() -> None:
        rows = [(lesson.number, lesson.title, lesson.facts["time"], lesson.asked) for lesson in all_of_them]
        printing.table("", ("lesson", "title", "time", "question"), rows)
        printing.line("\nnext: rig lesson 1")

    return Told([_card(lesson) for lesson in all_of_them], show=show)


def for_a_terminal(text: str) -> str:
    """Text of a page with the files of figures and of linked pages instead of links.

    Only an installation from a folder of the source has the other pages; without them a link tells where they are.
    """
    from rig.lessons import FOLDER, readable

    docs = FOLDER.resolve().parent

    def place(link: re.Match[str]) -> str:
        page = (FOLDER.resolve() / link[2]).resolve()
        inside = page.relative_to(docs) if page.is_relative_to(docs) else page.name
        if page.is_file():
            return f"{link[1]} (`{page}`)"
        return f"{link[1]} (`docs/{inside}` in the source of friction-rig)"

    text = re.sub(r"!\[(.+?)\]\((.+?)\)", lambda figure: f"{figure[1]}: `{FOLDER / figure[2]}`", readable(text))
    return re.sub(r"\[(.+?)\]\(([^():]+)\)", place, text)


COMMANDS = {"lesson": Made(lesson, "rig lesson 1")}
