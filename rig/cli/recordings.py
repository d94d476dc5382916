"""Commands for recordings.

Commands that find recordings and note what they are.

The command that writes a recording as a page to read.

The command that writes a recording for other programs.
"""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.cli import printing
from rig.cli.options import Force, Json, Trust, at, changes, number, pace, paired, plain, renamed, seconds
from rig.cli.printing import draw, hold, named, new, parents, reads, refuse
from rig.errors import ExitCode, LogError, UsageError
from rig.machine.files import RUNS
from rig.printable import printable

if TYPE_CHECKING:
    from rig.record.run import Run
    from rig.record.run_list import Listed
    from rig.record.user_notes import Notes


def recording(context: typer.Context, path: Path | None) -> Path | None:
    """Check the path of a recording: no folder, pipe or device. Whoever reads it reports a file that does not exist."""
    from rig.machine.files import regular

    if path is None:
        return None

    try:
        named("recording", path)
        regular(path)
    except FileNotFoundError:
        pass
    except UsageError:
        context.close()  # see `new`
        raise
    except OSError as error:
        context.close()
        raise UsageError(f"{path}: cannot be read: {error.strerror}") from None
    reads(context, path)
    return path


Log = Annotated[Path, typer.Argument(metavar="LOG", help="A recording (MCAP).", callback=recording)]


def allow(log: Path, trust: bool) -> None:
    """With `trust`, let this process and those that it starts run the code that a recording contains."""
    if trust:
        from rig.parts import trust_scene
        from rig.record.recorded_setup import head, setup_of

        trust_scene(setup_of(head(log)).scene)


def opened(log: Path, trust: bool = False) -> Run:
    """The run of a recording; prints damage and missing parts on standard error. `trust`: see `allow`."""
    from rig.record.reader import open as read

    allow(log, trust)
    status = printing.Status()
    status.show(f"reading {log}")
    try:
        run = read(log)
    finally:
        status.done()
    for note in run.notes:
        printing.note(f"{log}: {note}")
    return run


def without_outputs(run: Run, log: Path | str) -> str:
    """Why there is nothing to analyse or to draw; "" for a run with outputs of the plant."""
    if run.time.size:
        return ""
    if any(samples.v.size for samples in run.measurements.values()):
        return f"{log}: no output of the plant can be read in it, only measurements; rig export writes these"
    return f"{log}: the recording ends before its first sample"


def replay(
    log: Log,
    speed: Annotated[
        str, typer.Option("--pace", metavar="FACTOR", help='Real-time factor: recorded seconds per second, or "max".')
    ] = "1.0",
    into: Annotated[
        list[str] | None,
        typer.Option(
            "--into",
            metavar="CONTROLLER",
            help="Start this controller too (NAME or FILE.py) and compare its commands with the recorded ones.",
        ),
    ] = None,
    p: Annotated[
        list[str] | None,
        typer.Option(
            "-p",
            metavar="KEY=VALUE",
            callback=paired,
            help="Change a value of a controller of --into: -p controllers.nf.gain=300.",
        ),
    ] = None,
    trust: Trust = False,
    as_json: Json = False,
) -> None:
    """Play a recording back on the bus, for viewers and controllers.

    With --into each step waits for the command of the controller. With
    --pace max it runs as fast as the controllers answer. Exit code 1: a
    command differs, or a part of the recording is missing.
    """
    from rig.bench.again.replay import replay as play

    allow(log, trust)
    status = printing.Status()
    values = {key: plain(value) for key, value in changes(p).items()}
    found = play(log, into or (), pace(speed), values, status.show)
    status.done()
    if as_json:
        printing.report(found.to_json())
    else:
        printing.line(found.text())
    if found.fault:
        printing.note(f"{log}: {found.fault}")
    if not found.passed:
        raise typer.Exit(ExitCode.FAILED)


def verify(log: Log, trust: Trust = False, as_json: Json = False) -> None:
    """Check a recording: complete, undamaged, and the same bits when it is simulated again."""
    from rig.bench.again.verify import verify as check

    allow(log, trust)
    with printing.bar("seconds simulated again") as progress:
        found = check(log, progress)
    if as_json:
        printing.report(found.to_json())
    else:
        printing.line(found.text())
    if not found.passed:
        raise typer.Exit(ExitCode.FAILED)


def recover(
    log: Log,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="File to write. Default: NAME.recovered.mcap beside it.")
    ] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Recover a recording that was cut off or damaged: write all messages whose checksums are right to a new file.

    Exit code 1: messages were lost, or may have been (what followed a cut is
    unknown).
    """
    from rig.machine.files import recording_name
    from rig.record.recover import recover as save

    if out is not None:
        named("--out", out)
        recording_name(out)
    found = save(log, out, force)
    if as_json:
        printing.report({**vars(found), "complete": found.complete})
    else:
        printing.line(f"{found.path}: {found.messages} messages, {found.seconds:.3f} s; the original: {found.fault}")
        for place in found.skipped:
            printing.line(f"  skipped {place}")
        printing.line(f"  {found.losses()}")
    if not found.complete:
        raise typer.Exit(ExitCode.FAILED)


def sound(
    log: Log,
    signal: Annotated[
        str, typer.Option("--signal", metavar="SENSOR", help="Sensor whose sound is analysed. Default: the microphone.")
    ] = "",
    channel: Annotated[str, typer.Option("--channel", hidden=True)] = "",
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", callback=new, help="Write the sound to a WAV file.")
    ] = None,
    figure: Annotated[
        Path | None, typer.Option(metavar="FILE", callback=new, help="Draw sound, spectrum and level (PNG, SVG, PDF).")
    ] = None,
    trust: Trust = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Find squeals in the sound of a recording: level, frequency, times. Write a WAV file."""
    from rig.analysis.recorded.sound import hear
    from rig.machine.files import draft_of
    from rig.record.wav import write

    sensor = renamed("--channel", channel, "--signal", signal)
    run = opened(log, trust)
    heard = hear(run, sensor)
    full = None
    if out is not None:
        with draft_of(out) as draft:
            full = write(heard.v, heard.rate, draft)
    if as_json:
        printing.report(heard.to_json() | {"wav": out, "full_scale": full, "figure": figure})
    else:
        printing.line(heard.text())
        if full is not None:
            printing.line(f"{out}: 24 bit, full scale is {full:.4g} {heard.unit}")
    draw(heard, figure)


def amplitude(
    log: Log,
    first: Annotated[
        str | None, typer.Option("--from", metavar="TIME", help="Start of the evaluated time span.")
    ] = None,
    last: Annotated[str | None, typer.Option("--to", metavar="TIME", help="End of the evaluated time span.")] = None,
    figure: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", callback=new, help="Draw the amplitude of each sensor in each stage (PNG, SVG, PDF)."
        ),
    ] = None,
    trust: Trust = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Compute amplitude and frequency of each measurement, stage by stage, and the speeds of first and last stick."""
    from rig.analysis.recorded import amplitudes

    begin, end = seconds(first, "--from", low=0.0) or 0.0, seconds(last, "--to") or float("inf")
    run = opened(log, trust)
    if nothing := without_outputs(run, log):
        raise LogError(nothing)
    if begin >= min(end, float(run.time[-1])):
        raise UsageError(f"--from {begin:g} s to {min(end, float(run.time[-1])):g} s: the time span is empty; "
                         f"the recording has {run.time[0]:g} to {run.time[-1]:g} s")  # fmt: skip
    found = amplitudes(run, begin, end)
    if as_json:
        printing.report(found.to_json())
    else:
        printing.table(found.TITLE, found.COLUMNS, found.table())
        if found.sticks:
            printing.line(found.sticks.text())
    draw(found, figure)


_SHOWN = 60
"""Most characters of a note in the list."""


def runs(
    folder: Annotated[Path, typer.Argument(metavar="[FOLDER]", help="Where to look, or one recording.")] = RUNS,
    tag: Annotated[
        list[str] | None, typer.Option("--tag", metavar="TAG", help="Only runs with this tag. Repeatable.")
    ] = None,
    scene: Annotated[str | None, typer.Option(metavar="SCENE", help="Only runs of this scene.")] = None,
    rebuild: Annotated[
        bool, typer.Option("--rebuild", help="Read all files again, not only new and changed ones.")
    ] = False,
    as_json: Json = False,
) -> None:
    """List recordings: scene, date, length, timing verdict, notes and tags."""
    from rig.record import run_list

    if folder == RUNS and not folder.exists():
        printing.line(f"{folder}: no recordings yet; rig run SCENE makes one, and rig runs FOLDER looks elsewhere")
        return
    if not folder.exists():
        raise UsageError(f"{folder}: no such folder or recording")
    if folder.is_dir():
        with printing.bar("reading") as progress:
            found = run_list.runs(folder, rebuild, progress)
    else:
        found, folder = [run_list.one(folder)], folder.parent
    wanted = [one for one in found if _wanted(one, tag or [], scene)]
    for one in wanted:
        _warn(one.notes)
    if as_json:
        printing.report([_plain(one) for one in wanted])
        return
    if not wanted:
        printing.line(f"{folder}: {f'none of {len(found)} recordings fits' if found else 'no recordings'}")
        return
    columns = ("recording", "scene", "date", "length", "timing", "notes")
    printing.table(f"recordings in {folder}", columns, [_row(one, folder) for one in wanted])


def _wanted(one: Listed, tags: list[str], scene: str | None) -> bool:
    here = one.contents.scene if one.contents else ""
    return set(tags) <= set(one.notes.tags) and scene in (None, here)


def _row(one: Listed, folder: Path) -> tuple[str, ...]:
    name = str(one.path.relative_to(folder))
    notes = one.notes.found
    last = next((note.text for note in reversed(notes) if note.text), "")
    short = last if len(last) <= _SHOWN else f"{last[: _SHOWN - 1]}…"
    noted = " ".join(filter(None, (short, *(f"#{tag}" for tag in one.notes.tags))))
    said = "; ".join(filter(None, (one.fault, noted)))
    if (contents := one.contents) is None:
        return name, "", "", "", "", said
    return (
        name,
        contents.scene or "unknown",
        _date(contents.began_ns),
        f"{contents.seconds:.3f} s" if contents.seconds is not None else "unknown",
        contents.timing or "unknown",
        said,
    )


def _date(began_ns: int) -> str:
    return datetime.fromtimestamp(began_ns * 1e-9, UTC).astimezone().strftime("%Y-%m-%d %H:%M:%S")


def _plain(one: Listed) -> dict[str, Any]:
    contents = vars(one.contents) if one.contents else {}
    notes = [vars(note) for note in one.notes.found]
    return {"path": one.path, "size": one.size, **contents, "fault": one.fault, "notes": notes, "tags": one.notes.tags}


def note(
    log: Log,
    text: Annotated[
        str | None, typer.Argument(metavar="TEXT", help="What to note. Without it the notes are printed.")
    ] = None,
    tag: Annotated[list[str] | None, typer.Option("--tag", metavar="TAG", help="Add a tag. Repeatable.")] = None,
    as_json: Json = False,
) -> None:
    """Add a note or tags to a recording, or print its notes. They are kept in a file beside it."""
    from rig.record import user_notes

    if text is not None or tag:
        user_notes.add(log, text or "", tag or ())
    elif not log.exists():
        raise UsageError(f"{log}: no such file")
    found = user_notes.read(log)
    if as_json:
        printing.report({"path": found.path, "notes": [vars(one) for one in found.found],
                         "other": [vars(one) for one in found.other], "unreadable": found.unreadable})  # fmt: skip
        return
    for one in found.found:
        printing.line(str(one))
    if not found.found:
        printing.line(f"{log}: no notes")
    _warn(found)


def _warn(notes: Notes) -> None:
    """Print what a reader of notes should know about their file."""
    if other := len(notes.other):
        printing.note(f"{notes.path}: {other} of its notes are on another recording that had this name")
    if notes.unreadable:
        printing.note(f"{notes.path}: {notes.unreadable} of its lines contain no note")


def report(
    context: typer.Context,
    log: Log,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="File to write (HTML). Default: NAME.html beside the recording.")
    ] = None,
    trust: Trust = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write one page about a recording that any browser opens: figures, timing verdict, measures, provenance.

    The page is one file and loads no other files.
    """
    path = out or log.with_suffix(".html")
    named("--out", path)
    if path.suffix.lower() not in (".html", ".htm"):
        raise UsageError(f"--out {path}: the name of a page ends in .html")
    hold(context, "--out", path)
    run = opened(log, trust)
    from rig.analysis.report import write

    status = printing.Status()
    status.show(f"writing {path}")
    try:
        size = write(run, log, path)
    finally:
        status.done()
    if as_json:
        printing.report({"path": path, "bytes": size, "damage": run.notes})
    else:
        printing.line(str(path))


NAMES = ("csv", "hdf5", "mat", "netcdf", "parquet", "wav")
"""Formats, as `rig.record.export.FORMATS` has them, which is not imported before it is needed."""
_LIST = f"{', '.join(NAMES[:-1])} or {NAMES[-1]}"
RATES = (1e-3, 1e9)
"""Lowest and highest rate [Hz] that can be asked for."""


def export(
    context: typer.Context,
    log: Log,
    to: Annotated[str, typer.Option("--to", metavar="FORMAT", help=f"{_LIST}.")],
    only: Annotated[
        str | None,
        typer.Option(
            "--only",
            metavar="NAMES",
            help="Outputs, sensors and controllers, separated by commas. Default: everything.",
        ),
    ] = None,
    rate: Annotated[
        str | None,
        typer.Option(
            "--rate",
            metavar="RATE",
            help='Filter and decimate faster outputs and sensors to this rate: "200 Hz". Whole fractions only.',
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="PATH",
            help="File to write; for csv, parquet and wav a folder. Default: beside the recording, with its name.",
        ),
    ] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write a recording for other programs: CSV, HDF5, MATLAB, netCDF, Parquet, WAV.

    There is one table for the outputs of the plant, one for the sensors of each
    rate, one for the commands of each controller and one for the events.
    """
    if to not in NAMES:
        raise UsageError(f"--to {to}: expected {_LIST}")
    hertz = None if rate is None else number(rate, "--rate", "Hz", *RATES)
    names = None if only is None else [one.strip() for one in only.split(",") if one.strip()]
    if names == []:
        raise UsageError("--only: expected names of outputs, sensors or controllers, separated by commas")
    from rig.record.export import FORMATS, tables
    from rig.record.export import export as write
    from rig.record.export.files import description, files

    chosen = FORMATS[to]
    path = out or log.with_name(f"{log.stem}-{to}" if chosen.folder else f"{log.stem}{chosen.suffix}")
    named("--out", path)
    if chosen.folder:
        context.with_resource(parents(at(path)))
    else:
        hold(context, "--out", path)
    run = opened(log)
    found = tables(run, names or (), hertz)
    if chosen.folder:
        refuse(path, files(found, to), force)
    status = printing.Status()
    try:
        written = write(found, to, path, description(run) | {"recording": printable(log.name)}, status.show)
    finally:
        status.done()
    for note in found.notes:
        printing.note(note)
    if as_json:
        contents = [vars(one) for one in written]
        printing.report({"path": path, "tables": contents, "notes": found.notes, "damage": run.notes})
        return
    printing.line(f"{path}:")
    for one in written:
        printing.line(f"  {one}")


COMMANDS = {
    "replay": (replay, "rig replay recordings/golden/pendulum.mcap --into nf --pace max"),
    "verify": (verify, "rig verify recordings/golden/pendulum.mcap"),
    "amplitude": (amplitude, "rig amplitude recordings/runs/lever-20260101-120000.mcap --from '4 s'"),
    "sound": (sound, "rig sound recordings/runs/brake-20260101-120000.mcap --out squeal.wav --figure squeal.png"),
    "recover": (recover, "rig recover recordings/runs/pendulum-20260101-120000.mcap"),
    "runs": (runs, "rig runs recordings/runs --tag squeal"),
    "note": (note, 'rig note recordings/runs/mine.mcap "new pad, second day" --tag squeal'),
    "report": (report, "rig report recordings/golden/pendulum.mcap --out pendulum.html"),
    "export": (export, "rig export recordings/golden/pendulum.mcap --to csv --only vibrometer,nf --rate '500 Hz'"),
}
