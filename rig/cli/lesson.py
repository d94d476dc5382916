"""rig lesson: lists the lessons, or guides through one of them."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.cli import printing
from rig.cli.options import Json
from rig.errors import ExitCode

if TYPE_CHECKING:
    from rig.lessons import Command, Lesson

RESULTS = Path("lessons")
"""Folder for what the commands of lessons write, one folder per lesson in it."""


def lesson(
    number: Annotated[
        int | None, typer.Argument(metavar="N", help="Number of the lesson. Default: list all lessons.")
    ] = None,
    as_json: Json = False,
) -> None:
    """List the lessons, or guide you through lesson N.

    In a terminal: asks the question, waits for your answer, offers to run each
    command and compares the numbers. What the commands write is in the folder
    lessons/N. Without a terminal: prints the page.
    """
    from rig.lessons import lesson as of
    from rig.lessons import lessons

    if number is None:
        _list(lessons(), as_json)
        return
    chosen = of(number)
    if as_json:
        printing.report(_card(chosen) | {"page": chosen.file.read_text(encoding="utf-8")})
    elif sys.stdin.isatty() and sys.stdout.isatty():
        _walk(chosen)
    else:
        for text in for_a_terminal(chosen.file.read_text(encoding="utf-8")).splitlines():
            printing.line(text)


def _card(lesson: Lesson) -> dict[str, Any]:
    return {
        "number": lesson.number,
        "title": lesson.title,
        **lesson.facts,
        "scene": lesson.scene,
        "question": lesson.question,
    }


def _list(all_of_them: list[Lesson], as_json: bool) -> None:
    if as_json:
        printing.report([_card(lesson) for lesson in all_of_them])
        return
    rows = [(lesson.number, lesson.title, lesson.facts["time"], lesson.asked) for lesson in all_of_them]
    printing.table("", ("lesson", "title", "time", "question"), rows)
    printing.line("\nnext: rig lesson 1")


class _Left(Exception):
    """The user wants to stop."""


def _walk(lesson: Lesson) -> None:
    """Show the parts of a lesson one by one. Exits with 1 if a number did not agree."""
    _show(f"# Lesson {lesson.number}: {lesson.title}")
    _show("\n\n".join(f"{name}: {lesson.facts[name]}" for name in ("time", "needed before", "you learn")))
    _show(f"## Question\n\n{lesson.question}")
    disagreed = 0
    try:
        own = _ask("Think first, then type your answer. Enter: continue, q: quit", "q", free=True)
        for part in lesson.experiment:
            if isinstance(part, str):
                _show(part)
            else:
                disagreed += _offer(part, lesson)
        _ask("\nEnter: show the solutions, q: quit", "q")
        if own:
            printing.line(f"Your answer was: {own}\n")
        _show(f"## Solutions\n\n{lesson.solutions}")
        _show(f"## What to try next\n\n{lesson.next}")
    except _Left:
        pass
    if disagreed:
        printing.note(f"{disagreed} numbers did not agree with the page")
        raise typer.Exit(ExitCode.FAILED)


def _offer(command: Command, lesson: Lesson) -> int:
    """Run a command if the user wants to; returns how many numbers did not agree."""
    from rig.lessons import attempt, compare

    printing.line(f"\n    {command.text}\n")
    if _ask("Enter: run it, s: skip it, q: quit", "sq") == "s":
        _print(command)
        if rows := [(expected.quantity, expected.text) for expected in command.expected]:
            printing.table("", ("quantity", "expected"), rows)
            printing.line()
        return 0
    folder = RESULTS / str(lesson.number)
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with printing.status("running ... (Ctrl-C stops it)"):
            outcome = attempt(command, folder)
    except KeyboardInterrupt:
        printing.note(f"interrupted; what the command has written is in {folder}")
        raise
    if outcome.notes:
        printing.note(outcome.notes.rstrip())
    _print(command)
    comparisons = compare(command, outcome)
    compared = [(each.expected.quantity, each.expected.text, each.text, each.agrees) for each in comparisons]
    printing.table("", ("quantity", "expected", "found", "agrees"), compared)
    printing.line()
    if "--figure" in (words := [*command.words]):
        printing.line(f"figure: {folder / words[words.index('--figure') + 1]}\n")
    return sum(not each.agrees for each in comparisons)


def _print(command: Command) -> None:
    """The lines of its output that the page shows."""
    if command.printed:
        printing.line("\n".join(["It prints, among other lines (as on the page):\n", *command.printed, ""]))


def _ask(text: str, answers: str, free: bool = False) -> str:
    """Wait for Enter or one of the letters; with `free` for any text. Raises _Left for q, and where the input ends."""
    from rig.scenes.faults import shortened

    while True:
        try:
            answer = input(f"{text} > ").strip()
        except UnicodeDecodeError:
            answer = "?"
        except EOFError:
            printing.line()
            raise _Left from None
        if answer.lower() in ("q", "quit"):
            raise _Left
        if free:
            return answer
        if answer.lower() in ("", *answers):
            return answer.lower()
        printing.line(f"{shortened(answer)}: is none of these answers")


def _show(text: str) -> None:
    """Print Markdown in the width of the terminal."""
    from rich.console import Console
    from rich.markdown import Markdown

    Console(width=min(Console().width, 100)).print(Markdown(for_a_terminal(text), hyperlinks=False))
    printing.line()


def for_a_terminal(text: str) -> str:
    """Text of a page with the files of figures and of linked pages instead of links.

    Only an installation from a folder of the source has the other pages; without them a link tells where they are.
    """
    from rig.lessons import FOLDER, readable

    docs = FOLDER.resolve().parent

    def place(link: re.Match[str]) -> str:
        page = (FOLDER.resolve() / link[2]).resolve()
        inside = page.relative_to(docs) if page.is_relative_to(docs) else page.name
        return (
            f"{link[1]} (`{page}`)" if page.is_file() else f"{link[1]} (`docs/{inside}` in the source of friction-rig)"
        )

    text = re.sub(r"!\[(.+?)\]\((.+?)\)", lambda figure: f"{figure[1]}: `{FOLDER / figure[2]}`", readable(text))
    return re.sub(r"\[(.+?)\]\(([^():]+)\)", place, text)


COMMANDS: Mapping[str, tuple[Any, str]] = {"lesson": (lesson, "rig lesson 1")}
