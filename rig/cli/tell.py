"""How the commands print: tables and lines for a reader, JSON for a program."""

from __future__ import annotations

import contextlib
import json
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rig.scenes.scene import Scene


def line(text: str = "") -> None:
    """One line on standard output."""
    sys.stdout.write(f"{text}\n")


def note(text: str) -> None:
    """One line beside the output, on standard error."""
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()


def warnings(scene: Scene) -> None:
    """What speaks against running `scene`, beside the output: every command that builds its rig says the same."""
    from rig.bench.findings import findings

    levels = ("error", "warning") if scene.clock.unstable == "run" else ("warning",)  # an error refuses the run itself
    for one in findings(scene):
        if one.level in levels:
            note(f"warning: {one.what}\n  {one.remedy}")


def run_warnings(scene: Scene, duration: float | None) -> None:
    """The same, and what speaks against a run of `duration` s, or as long as its protocol."""
    from rig.bench.edge import meets_edge

    warnings(scene)
    if found := meets_edge(scene, duration):
        note(f"warning: {found}")


def report(found: Any) -> None:
    """A report as JSON; what is no number is null."""
    line(json.dumps(_plain(found), indent=2, ensure_ascii=False))


def _plain(found: Any) -> Any:
    if isinstance(found, dict):
        return {str(key): _plain(value) for key, value in found.items()}
    if isinstance(found, list | tuple):
        return [_plain(value) for value in found]
    if isinstance(found, float):
        return found if math.isfinite(found) else None
    if hasattr(found, "tolist"):
        return _plain(found.tolist())
    return found if found is None or isinstance(found, str | int | bool) else str(found)


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """A table; it takes the width of the terminal."""
    from rich.console import Console
    from rich.table import Table

    made = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False, header_style="dim")
    for column in columns:
        made.add_column(column, overflow="fold")
    for row in rows:
        made.add_row(*(cell if isinstance(cell, str) else number(cell) for cell in row))
    console = Console()
    if not console.is_terminal:
        console = Console(width=160)
    console.print(made, markup=False, highlight=False)


def number(value: object) -> str:
    """A number as a reader likes it."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


class Status:
    """A line that is written again and again on a terminal, and now and then elsewhere."""

    def __init__(self) -> None:
        self._terminal = sys.stderr.isatty()
        self._width = 0

    def show(self, text: str) -> None:
        """Put `text` in place of the line before."""
        if self._terminal:
            sys.stderr.write(f"\r{text.ljust(self._width)}")
            self._width = len(text)
            sys.stderr.flush()

    def done(self) -> None:
        """Leave the line."""
        if self._terminal and self._width:
            sys.stderr.write(f"\r{' ' * self._width}\r")
            sys.stderr.flush()


@contextlib.contextmanager
def bar(what: str) -> Iterator[Callable[[int, int], object]]:
    """A progress bar with an estimate of what is left, on standard error."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    estimate = TimeRemainingColumn(elapsed_when_finished=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), estimate)
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=None)

        def show(done: int, total: int) -> None:
            if bar.tasks[0].total is None:  # the estimate is that of what is done from here on
                bar.reset(task, completed=done, total=total)
            bar.update(task, completed=done)

        yield show
