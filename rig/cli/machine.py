"""Commands that measure methods (cost, torture), this machine (doctor, warmup, clean) and the figures of papers."""

from __future__ import annotations

import contextlib
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from rig.cli import printing
from rig.cli.build import Answer, Made, Told
from rig.cli.options import Budget, accuracy, at, share, ticket_file
from rig.cli.printing import refuse
from rig.errors import UsageError
from rig.machine.files import write_file
from rig.parameters import Argument, Option

if TYPE_CHECKING:
    from rig.papers.entry import Comparison
    from rig.qualify.cost.table import Row
    from rig.qualify.torture import Cell
    from rig.scenes.scene import Scene


def cost(
    scene: Scene,
    metric: Annotated[
        str, Option("MEASURE", "Error measure for the recommendation. Default: worst, the largest of all measures.")
    ] = "worst",
    target: Annotated[float, Option("ERROR", "Target relative error.")] = 1e-3,
    budget: Budget = None,
    out: Path = Path("cost"),
    *,
    force: bool,
) -> Answer:
    """Measure error against compute time for each method and step, and recommend a setting.

    The errors are those of physical measures, such as period and amplitude.
    Writes a table (CSV, Parquet) and figures. `rig run SCENE --accuracy 1e-4`
    uses the table.
    """
    wanted = accuracy(target, "--target")
    most = share(budget)
    from rig.qualify.cost import cost as measure
    from rig.qualify.cost import folder_of, recommended
    from rig.qualify.cost.report import CostReport
    from rig.qualify.cost.table import front
    from rig.view.palette import put

    printing.warnings(scene)
    folder = folder_of(scene, at(out))
    refuse(folder, ("cost.png",), force)  # drawn last: a table without is not
    try:
        with printing.bar("settings") as progress:
            measured = measure(scene, out, progress)
    except KeyboardInterrupt:
        printing.note(f"interrupted; the results so far are in {folder}")
        raise
    by = measured.metric(metric)
    pick: Row | None = None
    why = ""
    try:
        pick = recommended(measured.rows, by, wanted, most)
    except UsageError as error:
        why = str(error)

    result = CostReport(measured, by, pick, most)

    def show() -> None:
        printing.line(result.text())
        recommendation = why if pick is None else pick.text(by)
        printing.line(f"\nrecommended for a relative error of {wanted:g}: {recommendation}")

    report = result.to_json() | {"folder": str(folder)}
    report |= {"recommended": None if pick is None else pick.flat(), "why": why}

    def then() -> Iterator[str]:
        if front(measured.rows, by):
            put(result.plot(), folder / "cost.png")
        yield f"{folder}: {', '.join(sorted(path.name for path in folder.iterdir()))}"

    return Answer(Told(report, show=show), pick is not None, then=then)


def torture(
    quick: Annotated[bool, Option("", "Short runs, about a minute. The default.")] = False,
    full: Annotated[bool, Option("", "Every step and every case, over the whole duration.")] = False,
    case: Annotated[
        list[str] | None,
        Option(
            "ID", "Run only this case (a name as in the table that is printed), or the case in this file. Repeatable."
        ),
    ] = None,
    out: Annotated[Path, Option("FOLDER", "Folder for the figure, JSON and JUnit files.")] = Path("torture"),
    *,
    force: bool,
) -> Answer:
    """Run hard cases by methods by steps. Each cell is green, amber or red with one reason.

    Exit code 1: a default method is not green. The other methods are for
    comparison, and some of them fail.
    """
    if quick and full:
        raise UsageError("--quick or --full, not both")
    at(out)
    from rig.qualify import torture as hard_cases
    from rig.qualify.torture import report
    from rig.qualify.torture.case import load, names

    wanted = case or [name for name in names() if full or load(name).quick]
    refuse(out, ("matrix.png", "matrix.svg", "matrix.json", "junit.xml"), force)
    with printing.status() as show, contextlib.ExitStack() as stack:
        shown: list[Callable[[int, int], object]] = []

        def progress(done: int, total: int) -> None:
            if not shown:  # the kernels are compiled
                show("")
                shown.append(stack.enter_context(printing.bar("cases")))
            shown[0](done, total)

        cells = hard_cases.matrix(wanted, not full, show, progress)
    report.keep(cells, out, not full)
    told = Told([cell.to_json() for cell in cells], show=lambda: _table(cells))
    files = [f"\n{out}/matrix.png, matrix.svg, matrix.json, junit.xml"]
    return Answer(told, all(cell.good for cell in cells), then=lambda: files)


def _table(cells: list[Cell]) -> None:
    """A row for each case and method, its steps side by side; then what decided where it is not green."""
    rows = []
    for cell in cells:
        v = cell.result
        name = f"{cell.method} (default)" if cell.default else cell.method
        speed = "" if cell.speed is None else f"{cell.speed:.3g}"
        rows.append((cell.case, name, f"{cell.step:g} s", v.colour, v.reason, v.detail, speed, f"{cell.seconds:.2f} s"))
    printing.table("", ("case", "method", "step", "result", "reason", "detail", "real-time factor", "time"), rows)
    counts = Counter[str](cell.result.colour for cell in cells)
    counted = ", ".join(f"{counts[colour]} {colour}" for colour in ("green", "amber", "red"))
    bad = sum(not cell.good for cell in cells)
    printing.line(f"{len(cells)} cells: {counted}; default methods that are not green: {bad or 'none'}")


def doctor(
    scene: Annotated[list[str] | None, Argument("SCENE...", "Names of scenes. Default: all shipped scenes.")] = None,
    ticket: Annotated[
        Path | None,
        Option(
            "FILE",
            "Measure the link to the plant of this ticket instead: docs/remote.md.",
            "--ticket",
            check=ticket_file,
        ),
    ] = None,
) -> Answer:
    """Measure this machine and predict which scenes run in real time with the timing verdict VALID.

    With --ticket: measure the link to a plant on another host, and tell the
    shortest period of a controller that it holds. Exit code 1: it holds none.
    """
    if ticket is not None:
        from rig.qualify.remote_link import measure

        if scene:
            raise UsageError(f"--ticket {ticket}: measures a link and no scenes; leave {' '.join(scene)} out")
        link = measure(ticket)
        return Answer(link, link.period_ms is not None)
    from rig.qualify.doctor import doctor as examine

    diagnosis = examine(report=printing.note, names=scene or ())
    return Answer(diagnosis, diagnosis.ok)


def device(
    port: Annotated[str, Argument("PORT", "serial:/dev/ttyACM0 or udp:HOST:PORT.")],
    baud: Annotated[int, Option("RATE", "Rate of a serial port.", low=1)] = 115200,
    values: Annotated[Literal["float64", "float32"], Option("", "As in the scene.")] = "float64",
    count: Annotated[int, Option("N", "Values of a frame, each way.", low=1, high=24)] = 1,
) -> Answer:
    """Measure the link to a board: round trips of echo frames, which drive nothing.

    At 100 Hz, 1 kHz and 5 kHz, with the shortest period of a controller
    that the link holds. Exit code 1: it holds none.
    """
    from rig.qualify.board_link import measure

    measured = measure(port, baud, values, count)
    return Answer(measured, measured.period_ms is not None)


def warmup(
    scene: Annotated[list[str] | None, Argument("SCENE...", "Names of scenes. Default: all shipped scenes.")] = None,
) -> None:
    """Compile the kernels of the shipped scenes, so that their first run starts without delay."""
    from rig.machine.scheduling import cores
    from rig.qualify.doctor import warmup as compile_all

    begin = time.perf_counter()
    spent = compile_all(printing.note, scene or None, cores())
    printing.line(
        f"ready: {sum(spent.values()):.0f} s of compiling in {time.perf_counter() - begin:.0f} s of wall time"
    )


def clean() -> None:
    """Delete what friction-rig has stored for this user: compiled kernels, models of plates, messages of the last run.

    The next start compiles again. Recordings and scenes are not touched.
    Folders that RIG_KERNELS and RIG_MODELS name are yours, and stay.
    """
    import shutil

    import platformdirs

    folders = {platformdirs.user_cache_path("friction-rig"), platformdirs.user_state_path("friction-rig")}
    stored = sorted(folder for folder in folders if folder.is_dir())
    for folder in stored:
        size = sum(path.lstat().st_size for path in folder.rglob("*") if not path.is_dir())
        shutil.rmtree(folder)
        printing.line(f"deleted {folder}: {size / 1e6:.1f} MB")
    if not stored:
        printing.line("nothing is stored")


def reproduce(
    figure: Annotated[str, Argument("FIGURE", 'Name of a figure, of a paper, or "all".')] = "",
    out: Annotated[Path, Option("FOLDER", "Folder for the pictures and their page.")] = Path("gallery"),
    *,
    force: bool,
) -> Answer:
    """Make a figure of a paper again from a scene, and compare its numbers with published or reference values.

    Without FIGURE: list the figures. Exit code 1: a number does not agree that should.
    Other figures in the folder are kept.
    """
    from rig import papers as again
    from rig.record.provenance import provenance

    if not figure:
        entries = again.pick("all")
        values = [{"name": e.name, "title": e.title, "scenes": list(e.scenes)} for e in entries]
        rows = [(e.name, e.number, e.title, ", ".join(e.scenes)) for e in entries]
        heads = ("figure", "in the paper", "what it shows", "scenes")
        return Answer(Told(values, show=lambda: printing.table("", heads, rows)))
    wanted = again.pick(figure)
    page = [] if (out / "numbers.json").exists() else ["README.md"]  # else it is the page of figures made before
    refuse(out, [*(f"{entry.name}{suffix}" for entry in wanted for suffix in (".png", ".svg")), *page], force)
    with printing.bar("figures") as progress:
        results = again.make_all(wanted, out, progress)
    machine = provenance(0, ())
    host = f"{machine['processor']}, {machine['cores']} cores, Python {machine['python']}, numba {machine['numba']}"
    write_file(out / "README.md", again.gallery_page(again.keep(results, out), host).encode())

    def show() -> None:
        for result in results:
            title = f"{result.entry.name}: {result.entry.title} ({result.picture})"
            columns = ("number", "ours", "expected", "", "source", "bound", "")
            printing.table(title, columns, [_compared(comparison) for comparison in result.comparisons])

    told = Told([result.to_json() for result in results], show=show)
    return Answer(told, all(result.agrees for result in results))


def _compared(number: Comparison) -> tuple[str, ...]:
    """A number of a figure beside the published one, as a row of a table."""
    ours = f"{number.ours:.7g}"
    expected = f"{number.expected:.7g}" if number.compared else ""
    remark = "" if number.agrees else number.result
    return number.what, ours, expected, number.unit, number.source, number.bound, remark


COMMANDS = {
    "cost": Made(cost, "rig cost belt_c --target 1e-4 --budget 40%"),
    "torture": Made(torture, "rig tool torture --case grazing"),
    "clean": Made(clean, "rig tool clean"),
    "doctor": Made(doctor, "rig tool doctor belt"),
    "device": Made(device, "rig tool device udp:192.168.7.2:5005"),
    "warmup": Made(warmup, "rig tool warmup pendulum"),
    "reproduce": Made(reproduce, "rig tool reproduce kroeger-3"),
}
