"""Commands for recordings: play, check, recover, list, note, write as a page or for other programs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import rig
from rig.cli import printing
from rig.cli.build import Answer, Made, Told
from rig.cli.options import at, number, pace, refuse_all
from rig.cli.printing import named, refuse, writable
from rig.errors import UsageError
from rig.machine.files import RUNS
from rig.parameters import Argument, Option
from rig.printable import counted, printable
from rig.units import number_or_text

if TYPE_CHECKING:
    from rig.record.run import Run
    from rig.record.run_list import Listed
    from rig.record.user_notes import Notes

_SHOWN = 60  # most characters of a note in the list
NAMES = ("csv", "hdf5", "mat", "netcdf", "parquet", "wav")
"""Formats, as `rig.record.export.FORMATS` has them, which is not imported before it is needed."""
_LIST = f"{', '.join(NAMES[:-1])} or {NAMES[-1]}"
RATES = (1e-3, 1e9)
"""Lowest and highest rate [Hz] that can be asked for."""


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
    with printing.status(f"reading {log}"):
        run = read(log)
    for note in run.notes:
        printing.note(f"{log}: {note}")
    return run


def without_outputs(run: Run, log: Path | str) -> str:
    """Why there is nothing to analyse or to draw; "" for a run with outputs of the plant."""
    if run.time.size or run.measured:
        return ""
    if any(samples.v.size for samples in run.measurements.values()):
        return f"{log}: no output of the plant can be read in it, only measurements; rig export writes these"
    return f"{log}: the recording ends before its first sample"


def replay(
    log: Path,
    trust: bool,
    p: Annotated[
        Mapping[str, str],
        Option("KEY=VALUE", "Change a value of a controller of --into: -p controllers.nf.gain=300.", "-p"),
    ],
    speed: Annotated[
        str, Option("FACTOR", 'Real-time factor: recorded seconds per second, or "max".', "--pace")
    ] = "1.0",
    into: Annotated[
        list[str] | None,
        Option(
            "CONTROLLER", "Start this controller too (NAME or FILE.py) and compare its commands with the recorded ones."
        ),
    ] = None,
) -> Answer:
    """Play a recording back on the bus, for viewers and controllers.

    With --into each step waits for the command of the controller. With
    --pace max it runs as fast as the controllers answer. Exit code 1: a
    command differs, or a part of the recording is missing.
    """
    from rig.bench.again.replay import replay as play

    allow(log, trust)
    values = {key: number_or_text(value) for key, value in p.items()}
    with printing.status() as show:
        replayed = play(log, into or (), pace(speed), values, show)
    notes = [f"{log}: {replayed.fault}"] if replayed.fault else []
    return Answer(replayed, replayed.passed, notes=notes)


def verify(log: Path, trust: bool) -> Answer:
    """Check a recording: complete, undamaged, and the same bits when it is simulated again."""
    from rig.bench.again.verify import verify as check

    allow(log, trust)
    with printing.bar("seconds simulated again") as progress:
        verified = check(log, progress)
    return Answer(verified, verified.passed)


def recover(
    log: Path,
    force: bool,
    out: Annotated[Path | None, Option("FILE", "File to write. Default: NAME.recovered.mcap beside it.")] = None,
) -> Answer:
    """Recover a recording that was cut off or damaged: write all messages whose checksums are right to a new file.

    Exit code 1: messages were lost, or may have been (what followed a cut is
    unknown).
    """
    from rig.machine.files import recording_name
    from rig.record.recover import recover as save

    if out is not None:
        named("--out", out)
        recording_name(out)
    saved = save(log, out, force)
    told = Told(
        {**vars(saved), "complete": saved.complete},
        f"{saved.path}: {counted(saved.messages, 'message')}, {saved.seconds:.3f} s; the original: {saved.fault}",
        *(f"  skipped {place}" for place in saved.skipped),
        f"  {saved.losses()}",
    )
    return Answer(told, saved.complete)


def runs(
    folder: Annotated[Path, Argument("[FOLDER]", "Where to look, or one recording.")] = RUNS,
    tag: Annotated[list[str] | None, Option("TAG", "Only runs with this tag. Repeatable.")] = None,
    scene: Annotated[str | None, Option("SCENE", "Only runs of this scene.")] = None,
    rebuild: Annotated[bool, Option("", "Read all files again, not only new and changed ones.")] = False,
) -> Told:
    """List recordings: scene, date, length, timing verdict, notes and tags."""
    from rig.record import run_list

    if folder == RUNS and not folder.exists():
        return Told([], f"{folder}: no recordings yet; rig run SCENE makes one, and rig runs FOLDER looks elsewhere")
    if not folder.exists():
        raise UsageError(f"{folder}: no such folder or recording")
    if folder.is_dir():
        with printing.bar("reading") as progress:
            listed = run_list.runs(folder, rebuild, progress)
    else:
        listed = [run_list.of_file(folder)]
        folder = folder.parent
    wanted = [listing for listing in listed if _fits(listing, tag or (), scene)]
    for listing in wanted:
        for warning in _warnings(listing.notes):
            printing.note(warning)
    cards = [_card(listing) for listing in wanted]
    if not wanted:
        return Told(cards, f"{folder}: {f'none of {len(listed)} recordings fits' if listed else 'no recordings'}")
    columns = ("recording", "scene", "date", "length", "timing", "notes")
    rows = [_row(listing, folder) for listing in wanted]
    return Told(cards, show=lambda: printing.table(f"recordings in {folder}", columns, rows))


def _fits(listing: Listed, tags: Iterable[str], scene: str | None) -> bool:
    """Whether a recording has all `tags`, and is one of `scene` (None: of any)."""
    if not {*tags} <= {*listing.notes.tags}:
        return False
    return scene is None or (listing.contents is not None and listing.contents.scene == scene)


def _card(listing: Listed) -> dict[str, Any]:
    """A recording of the list, for JSON."""
    contents = vars(listing.contents) if listing.contents else {}
    notes = [vars(note) for note in listing.notes.entries]
    return {
        "path": listing.path,
        "size": listing.size,
        **contents,
        "fault": listing.fault,
        "notes": notes,
        "tags": listing.notes.tags,
    }


def _row(listing: Listed, folder: Path) -> tuple[str, ...]:
    last = next((note.text for note in reversed(listing.notes.entries) if note.text), "")
    short = last if len(last) <= _SHOWN else f"{last[: _SHOWN - 1]}…"
    noted = " ".join(filter(None, (short, *(f"#{tag}" for tag in listing.notes.tags))))
    name = str(listing.path.relative_to(folder))
    said = "; ".join(filter(None, (listing.fault, noted)))
    contents = listing.contents
    if contents is None:
        return name, "", "", "", "", said
    began = datetime.fromtimestamp(contents.began_ns * 1e-9, UTC).astimezone().strftime("%Y-%m-%d %H:%M:%S")
    length = "unknown" if contents.seconds is None else f"{contents.seconds:.3f} s"
    return name, contents.scene or "unknown", began, length, contents.timing or "unknown", said


def note(
    log: Path,
    text: Annotated[str | None, Argument("TEXT", "What to note. Without it the notes are printed.")] = None,
    tag: Annotated[list[str] | None, Option("TAG", "Add a tag. Repeatable.")] = None,
) -> Answer:
    """Add a note or tags to a recording, or print its notes. They are kept in a file beside it."""
    from rig.record import user_notes

    if text is not None or tag:
        user_notes.add(log, text or "", tag or ())
    elif not log.exists():
        raise UsageError(f"{log}: no such file")
    notes = user_notes.read(log)
    report = {
        "path": notes.path,
        "notes": [vars(note) for note in notes.entries],
        "other": [vars(note) for note in notes.other],
        "unreadable": notes.unreadable,
    }
    return Answer(Told(report, *map(str, notes.entries or [f"{log}: no notes"])), notes=list(_warnings(notes)))


def _warnings(notes: Notes) -> Iterator[str]:
    """What a reader of notes should know about their file."""
    if other := len(notes.other):
        yield f"{notes.path}: {other} of its notes are on another recording that had this name"
    if notes.unreadable:
        yield f"{notes.path}: {notes.unreadable} of its lines contain no note"


def report(context: typer.Context, log: Path, out: Path | None, trust: bool, force: bool) -> Told:
    """Write one page about a recording that any browser opens: figures, timing verdict, measures, provenance.

    The page is one file and loads no other files.
    """
    path = out or log.with_suffix(".html")
    writable(context, "--out", path)
    if path.suffix.lower() not in (".html", ".htm"):
        raise UsageError(f"--out {path}: the name of a page ends in .html")
    run = opened(log, trust)
    from rig.analysis.report.page import write

    with printing.status(f"writing {path}"):
        size = write(run, log, path)
    return Told({"path": path, "bytes": size, "damage": run.notes}, str(path))


def export(
    context: typer.Context,
    log: Path,
    force: bool,
    to: Annotated[str, Option("FORMAT", f"{_LIST}.")],
    only: Annotated[
        list[str] | None, Option("NAMES", "Outputs, sensors and controllers, separated by commas. Default: everything.")
    ] = None,
    rate: Annotated[
        str | None,
        Option("RATE", 'Filter and decimate faster outputs and sensors to this rate: "200 Hz". Whole fractions only.'),
    ] = None,
    out: Annotated[
        Path | None,
        Option(
            "PATH", "File to write; for csv, parquet and wav a folder. Default: beside the recording, with its name."
        ),
    ] = None,
) -> Told:
    """Write a recording for other programs: CSV, HDF5, MATLAB, netCDF, Parquet, WAV.

    There is one table for the outputs of the plant, one for the sensors of each
    rate, one for the commands of each controller and one for the events.
    """
    hertz = None if rate is None else number(rate, "--rate", "Hz", *RATES)
    refuse_all(
        (to not in NAMES, f"--to {to}: expected {_LIST}"),
        (
            only is not None and not only,
            "--only: expected names of outputs, sensors or controllers, separated by commas",
        ),
    )
    from rig.record.export import FORMATS, tables
    from rig.record.export import export as write
    from rig.record.export.files import description, files

    chosen = FORMATS[to]
    path = out or log.with_name(f"{log.stem}-{to}" if chosen.folder else f"{log.stem}{chosen.suffix}")
    named("--out", path)
    if chosen.folder:
        at(path)
    else:
        writable(context, "--out", path)
    run = opened(log)
    exported = tables(run, only or [], hertz)
    if chosen.folder:
        refuse(path, files(exported, to), force)
    with printing.status() as show:
        written = write(exported, to, path, description(run) | {"recording": printable(log.name)}, show)
    for note in exported.notes:
        printing.note(note)
    contents = [vars(table) for table in written]
    report = {"path": path, "tables": contents, "notes": exported.notes, "damage": run.notes}
    return Told(report, f"{path}:", *(f"  {table}" for table in written))


COMMANDS = {
    "replay": Made(replay, "rig live replay recordings/golden/pendulum.mcap --into nf --pace max"),
    "verify": Made(verify, "rig verify recordings/golden/pendulum.mcap"),
    "recover": Made(recover, "rig recover recordings/runs/pendulum-20260101-120000.mcap"),
    "runs": Made(runs, "rig runs recordings/runs --tag squeal"),
    "note": Made(note, 'rig note recordings/runs/mine.mcap "new pad, second day" --tag squeal'),
    "report": Made(report, "rig report recordings/golden/pendulum.mcap --out pendulum.html", rig.report),
    "export": Made(export, "rig export recordings/golden/pendulum.mcap --to csv --only vibrometer,nf --rate '500 Hz'"),
}
