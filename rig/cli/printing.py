"""Printing: tables and lines for a reader, JSON for a program. Control characters are printed as escapes."""

from __future__ import annotations

import contextlib
import json
import math
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from rig.printable import printable

if TYPE_CHECKING:
    from rig.analysis.pool import Store
    from rig.scenes.scene import Scene

PROGRESS_S = 5.0
"""Shortest time between two lines of progress without a terminal [s]."""


def line(text: str = "") -> None:
    """Print one line on standard output."""
    sys.stdout.write(f"{printable(text)}\n")


def note(text: str) -> None:
    """Print one line on standard error."""
    sys.stderr.write(f"{printable(text)}\n")
    sys.stderr.flush()


def warnings(scene: Scene) -> None:
    """Print the warnings of `scene` on standard error; every command that builds its rig prints the same."""
    from rig.bench.build_findings import findings

    levels = ("error", "warning") if scene.clock.unstable == "run" else ("warning",)  # an error refuses the run itself
    for one in findings(scene):
        if one.level in levels:
            note(f"warning: {one.what}\n  {one.remedy}")


def run_warnings(scene: Scene, duration: float | None) -> None:
    """Print the warnings of `scene` and of a run of `duration` s (None: as long as its protocol)."""
    from rig.bench.slider_edge import meets_edge

    warnings(scene)
    if found := meets_edge(scene, duration):
        note(f"warning: {found}")


def report(found: Any) -> None:
    """Print a report as JSON; NaN and infinity become null."""
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
    """Print a table in the width of the terminal; 160 columns without a terminal."""
    from rich.console import Console
    from rich.table import Table

    made = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False, header_style="dim")
    for column in columns:
        made.add_column(column, overflow="fold")
    for row in rows:
        made.add_row(*(printable(cell if isinstance(cell, str) else number(cell)) for cell in row))
    console = Console()
    if not console.is_terminal:
        console = Console(width=160)
    console.print(made, markup=False, highlight=False)


def number(value: object) -> str:
    """A number with six significant digits, a truth value as yes or no."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


class Status:
    """A progress line on a terminal; nothing is written without a terminal."""

    def __init__(self) -> None:
        self._terminal = sys.stderr.isatty()
        self._width = 0

    def show(self, text: str) -> None:
        """Replace the line by `text`."""
        if self._terminal:
            text = printable(text)
            sys.stderr.write(f"\r{text.ljust(self._width)}")
            self._width = len(text)
            sys.stderr.flush()

    def done(self) -> None:
        """Clear the line."""
        if self._terminal and self._width:
            sys.stderr.write(f"\r{' ' * self._width}\r")
            sys.stderr.flush()


@contextlib.contextmanager
def bar(what: str) -> Iterator[Callable[[int, int], object]]:
    """A progress bar with rate and remaining time, on standard error; without a terminal a line now and then."""
    if not sys.stderr.isatty():
        yield _lines(what)
        return
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
    counts = (MofNCompleteColumn(), TextColumn("{task.fields[rate]}"), TimeElapsedColumn(), estimate)
    columns = (TextColumn("{task.description}"), BarColumn(), *counts)
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=None, rate="")
        rate = Rate()

        def show(done: int, total: int) -> None:
            if bar.tasks[0].total is None:  # estimate from now on: parts that were kept from before took no time
                bar.reset(task, completed=done, total=total, rate="")
            bar.update(task, completed=done, rate=rate.text(done))

        yield show


@contextlib.contextmanager
def kept(store: Store, what: str, total: int = 0) -> Iterator[None]:
    """Print on Ctrl-C how many results of a work are kept, of `total` if that is known; `what` they are."""
    try:
        yield
    except KeyboardInterrupt:
        of, ready = f" of {total}" if total else "", len(store.load())
        note(f"interrupted: {ready}{of} {what} are kept in {store.folder}; the same command continues from there"
             if ready else f"interrupted before any of the {what} was finished")  # fmt: skip
        raise


class Rate:
    """The speed of a work since its first report: parts that were kept from before took no time."""

    def __init__(self) -> None:
        self._first, self._begin = -1, 0.0

    def per_second(self, done: int) -> float:
        """Parts per second, after `done` of them; 0 before anything is finished."""
        now = time.monotonic()
        if self._first < 0:
            self._first, self._begin = done, now
        return (done - self._first) / (now - self._begin) if done > self._first and now > self._begin else 0.0

    def text(self, done: int) -> str:
        """The speed in words; per minute below one per second."""
        rate = self.per_second(done)
        if not rate:
            return ""
        return f"{rate:.3g}/s" if rate >= 1.0 else f"{60.0 * rate:.3g}/min"


def _lines(what: str) -> Callable[[int, int], object]:
    """Progress as lines, at most one in `PROGRESS_S`, and one at the end: short work prints none."""
    last, told = time.monotonic(), False
    rate = Rate()

    def show(done: int, total: int) -> None:
        nonlocal last, told
        speed = rate.per_second(done)
        if time.monotonic() - last >= PROGRESS_S or (told and done == total):
            last, told = time.monotonic(), done < total
            left = f", {rate.text(done)}, about {_span((total - done) / speed)} left" if speed and done < total else ""
            note(f"{what}: {done} of {total}{left}")

    return show


def _span(seconds: float) -> str:
    """A remaining time in words."""
    for size, unit in ((86400.0, "d"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"
