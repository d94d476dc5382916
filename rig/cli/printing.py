"""Printing: tables and lines for a reader, JSON for a program. Control characters are printed as escapes.

Files that a command writes for its user: nothing that is there is overwritten unless the user says --force.

What the command reads is never overwritten.
"""

from __future__ import annotations

import json
import shutil
import sys
import textwrap
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from rig.errors import UsageError
from rig.machine.files import FIGURES, figure_format, recording_name, takes, unused
from rig.machine.process import listened, tell
from rig.printable import columns, printable, utf8
from rig.results import plain

if TYPE_CHECKING:
    from rig.analysis.pool import Store
    from rig.scenes.scene import Scene


PROGRESS_S = 5.0
"""Shortest time between two lines of progress without a terminal [s]."""
# Suffixes that name a file: no folder of results has one of them
_FILES = {*FIGURES, ".csv", ".html", ".json", ".mcap", ".nc", ".parquet", ".txt", ".xml"}
_TAKEN = "rig.cli.printing"
_READ = "what is read"
_WIDTH = 160  # columns without a terminal
_BESIDE = 30  # fewest columns for a text beside its row; with less it stands below
_BELOW = 4


def line(text: str = "") -> None:
    """Print one line on standard output."""
    sys.stdout.write(f"{printable(text)}\n")


def note(text: str) -> None:
    """Print one line on standard error."""
    sys.stderr.write(f"{printable(text)}\n")
    sys.stderr.flush()


def warnings(scene: Scene) -> None:
    """Print the warnings of `scene` on standard error; every command that builds its rig prints the same."""
    from rig.bench.run.before import findings

    levels = ("error", "warning") if scene.clock.unstable == "run" else ("warning",)  # an error refuses the run itself
    for finding in findings(scene):
        if finding.level in levels:
            note(f"warning: {finding.what}\n  {finding.remedy}")


def run_warnings(scene: Scene, duration: float | None) -> None:
    """Print the warnings of `scene` and of a run of `duration` s (None: as long as its protocol)."""
    from rig.bench.run.before import meets_edge
    from rig.controllers.device import Device, too_slow

    warnings(scene)
    if why := meets_edge(scene, duration):
        note(f"warning: {why}")
    for section in scene.controllers.values():
        if not isinstance(section, Device) or section.address.has_rate:
            continue
        slow = too_slow(section, 1.0)
        if slow:
            note(f"warning: {slow}; a USB port without a UART (CDC) ignores the rate, rig tool device measures it")


def report(values: Any) -> None:
    """Print a report as JSON; NaN and infinity become null."""
    line(json.dumps(plain(values), indent=2, ensure_ascii=False))


def reported(as_json: bool, values: Callable[[], Any], show: Callable[[], None]) -> None:
    """Print a report as JSON, or show it to a reader. The page that has started the command as a job gets it too."""
    if listened():
        tell("report", plain(values()))
    if as_json:
        report(values())
    else:
        show()


def table(name: str, titles: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print a table in the width of the terminal; at most 160 columns without a terminal."""
    texts = [_texts(row) for row in rows]
    lines = [text.removeprefix("  ") for text in columns([titles, *texts], "<" * len(titles))]
    if not sys.stdout.isatty() and max(map(len, lines)) <= width():
        for text in (name, *lines) if name else lines:
            line(text)
        return
    from rich.console import Console  # 30 ms: only where it sets or folds text
    from rich.table import Table

    grid = Table(box=None, pad_edge=False, header_style="dim")
    for title in titles:
        grid.add_column(title, overflow="fold")
    for row in texts:
        grid.add_row(*row)
    console = Console()
    if not console.is_terminal:
        console = Console(width=width())
    if name:
        console.print(name, style="bold", markup=False, highlight=False)
    console.print(grid, markup=False, highlight=False)


def _texts(row: Sequence[object]) -> list[str]:
    return [printable(cell if isinstance(cell, str) else number(cell)) for cell in row]


def width() -> int:
    """Columns of the terminal; 160 without one."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else _WIDTH


def paragraph(text: str) -> None:
    """Print a text as it is; where its lines are wider than the terminal, its paragraphs are folded."""
    lines = text.splitlines()
    if max(map(len, lines), default=0) > width():
        lines = []
        for part in text.split("\n\n"):
            lines += [*textwrap.wrap(part, width()), ""]
        lines.pop()
    for text_line in lines:
        line(text_line)


def described(title: str, rows: Iterable[Sequence[str]], align: str = "") -> None:
    """Print rows of cells in columns, the last of which is a text that is folded to the width of the terminal.

    `align`: "<" or ">" for each of the other columns.
    """
    table = [[*map(printable, row)] for row in rows]
    if title:
        line(title)
    if not table:
        return
    cells = [row[:-1] for row in table]
    begins = [*columns(cells, align or "<" * len(cells[0]))]
    edge = max(map(len, begins)) + 2
    beside = width() - edge >= _BESIDE
    for begin, (*_, text) in zip(begins, table):
        if beside:
            first, *more = textwrap.wrap(text, width() - edge) or [""]
            line(f"{begin:<{edge}}{first}".rstrip())
            for rest in more:
                line(" " * edge + rest)
        else:
            for folded in textwrap.wrap(begin, width(), subsequent_indent=" " * _BELOW, drop_whitespace=False):
                line(folded.rstrip())
            for rest in textwrap.wrap(text, width() - _BELOW):
                line(" " * _BELOW + rest)


def pairs(rows: Iterable[tuple[str, str]]) -> None:
    """Print labelled lines."""
    for text in columns(rows, "<<"):
        line(text)


def number(value: object) -> str:
    """A number with six significant digits, a truth value as yes or no."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


@contextmanager
def status(text: str = "") -> Iterator[Callable[[str], None]]:
    """A line of progress on a terminal, replaced by each text that it gets; without a terminal a line now and then."""
    terminal = sys.stderr.isatty()
    width = 0
    last = time.monotonic()

    def show(text: str) -> None:
        nonlocal width, last
        if not terminal and text and time.monotonic() - last >= PROGRESS_S:
            last = time.monotonic()
            note(text)
        if terminal:
            sys.stderr.write(f"\r{printable(text).ljust(width)}")
            sys.stderr.flush()
            width = len(printable(text))

    show(text)
    try:
        yield show
    finally:
        if width:
            show("")
            sys.stderr.write("\r")


@contextmanager
def bar(what: str) -> Iterator[Callable[[int, int], object]]:
    """A progress bar with the remaining time, on standard error; without a terminal a line now and then."""
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
    counts = (MofNCompleteColumn(), TimeElapsedColumn(), estimate)
    with Progress(
        TextColumn("{task.description}"), BarColumn(), *counts, console=Console(stderr=True), transient=True
    ) as bar:
        task = bar.add_task(what, total=None)

        def show(done: int, total: int) -> None:
            if bar.tasks[0].total is None:  # estimate from now on: parts that were kept from before took no time
                bar.reset(task, completed=done, total=total)
            bar.update(task, completed=done)

        yield show


@contextmanager
def kept(store: Store, what: str, total: int = 0) -> Iterator[None]:
    """Print on Ctrl-C how many results of a work are kept, of `total` if that is known; `what` they are."""
    try:
        yield
    except KeyboardInterrupt:
        of = f" of {total}" if total else ""
        ready = len(store.load())
        if ready:
            note(f"interrupted: {ready}{of} {what} are kept in {store.folder}; the same command continues from there")
        else:
            note(f"interrupted before any of the {what} was finished")
        raise


def _lines(what: str) -> Callable[[int, int], object]:
    """Progress as lines, at most one in `PROGRESS_S`, and one at the end: short work prints none."""
    last = time.monotonic()
    told = False
    first = (-1, 0.0)

    def show(done: int, total: int) -> None:
        nonlocal last, told, first
        now = time.monotonic()
        if first[0] < 0:  # parts that were kept from before took no time
            first = done, now
        if now - last >= PROGRESS_S or (told and done == total):
            last = now
            told = done < total
            computed = done - first[0]
            left = f", about {_span((now - first[1]) * (total - done) / computed)} left" if computed and told else ""
            note(f"{what}: {done} of {total}{left}")

    return show


def about(what: str, usual: int) -> Callable[[int], str]:
    """Progress of work whose size is known roughly, in words: how much of `usual` is done and what time is left."""
    began: list[tuple[int, float]] = []  # the first call, and the first after it: kernels are ready from then on

    def told(done: int) -> str:
        now = time.monotonic()
        if len(began) < 2 and (not began or done > began[0][0]):
            began.append((done, now))
        if done >= usual:
            return f"{done} {what} computed; usual are {usual}"
        first, since = began[-1]
        left = ""
        if done > first:
            left = f", about {_span((now - since) / (done - first) * (usual - done))} left"
        return f"{done} of about {usual} {what} computed{left}"

    return told


def _span(seconds: float) -> str:
    """A remaining time in words."""
    for size, unit in ((86400.0, "d"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"


def named(what: str, path: Path) -> None:
    """Raise UsageError for a name that is empty; as a path it is the same as "."."""
    if path == Path():
        raise UsageError(f"{what}: the name is empty, or it is this folder; name a file")


def new(context: typer.Context, option: typer.CallbackParam, path: Path | None) -> Path | None:
    """Check the file that an option names before its command computes anything."""
    if path is not None:
        name = option.opts[0]
        writable(context, name, path, {"--figure": figure_format, "--page": page_name}.get(name))
    return path


def page_name(path: Path) -> None:
    """Check the name of a page. Raises UsageError."""
    if path.suffix.lower() not in (".html", ".htm"):
        raise UsageError(f"{path}: the name of a page ends in .html")


def new_recording(context: typer.Context, option: typer.CallbackParam, path: Path | None) -> Path | None:
    """Like `new`, for a recording."""
    if path is not None:
        writable(context, option.opts[0], path, recording_name)
    return path


def new_folder(option: typer.CallbackParam, path: Path) -> Path:
    """Refuse the name of a file where an option names a folder."""
    if path.suffix.lower() in _FILES and not path.is_dir():
        raise UsageError(
            f"{option.opts[0]} {path}: the results are a folder of several files; name it without {path.suffix}"
        )
    return path


def reads(context: typer.Context, path: Path) -> None:
    """Note that the command reads `path`. Raises UsageError where an option has named it as a file to write."""
    _claim(context, _READ, path)


def _claim(context: typer.Context, what: str, path: Path) -> None:
    """Note what a file is for. Raises UsageError if it is for something else too.

    An option may come before or after the argument that names what is read.
    """
    taken: list[tuple[str, Path]] = context.meta.setdefault(_TAKEN, [])
    for other, file in taken:
        if what != other and _same(path, file):
            if _READ in (what, other):
                option, written = (other, file) if what == _READ else (what, path)
                raise UsageError(f"{option} {written}: is also the input file; name another one")
            raise UsageError(f"{what} {path}: is also the file of {other}; name another one")
    taken.append((what, path))


def _same(path: Path, other: Path) -> bool:
    try:
        return path.resolve() == other.resolve() or path.samefile(other)
    except OSError:  # no such file, or a name that is too long
        return False


def writable(context: typer.Context, option: str, path: Path, check: Callable[[Path], object] | None = None) -> None:
    """Raise UsageError unless the command can write the file of an option; `check`: of its name.

    It cannot if the file has something in it, unless --force is given, if another process is writing it, if it is an
    input file, if its folder does not exist (it may be a slip of the keyboard), if its name is not UTF-8, or if the
    place cannot be written.
    """
    named(option, path)
    if not utf8(path):
        told = f"{option} {printable(str(path))}"
        raise UsageError(f"{told}: the name is not UTF-8; give the file or its folder another name")
    _claim(context, option, path)
    try:
        if path.is_dir():
            raise UsageError(f"{option} {path} is a folder; name a file")
        takes(path)
        if not path.parent.exists():
            raise UsageError(f"{option} {path}: there is no folder {path.parent}; make it, or name another one")
        if not path.exists():
            path.open("xb").close()  # nothing else tells whether the place can be written
            path.unlink()
        elif path.stat().st_size and not context.params.get("force"):
            raise UsageError(f"{option} {path} exists; name another file, or add --force to replace it")
        else:
            unused(path)
    except OSError as fault:
        raise UsageError(f"{option} {path} cannot be written: {fault.strerror}") from None
    try:
        if check:
            check(path)
    except UsageError as fault:
        raise UsageError(f"{option} {fault}") from None


def refuse(folder: Path, names: Iterable[str], force: bool) -> None:
    """Raise UsageError if `folder` has files of these names, unless `force`."""
    existing = [name for name in names if (folder / name).exists()]
    if existing and not force:
        raise UsageError(f"{folder}: has {', '.join(existing)}; name another folder, or add --force to replace them")
