"""Commands for recordings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.cli import printing
from rig.cli.options import Force, Json, Pace, Trust, pace, seconds
from rig.cli.outputs import named, new, reads
from rig.errors import LogError, UsageError

if TYPE_CHECKING:
    from rig.record.run import Run


def _file(context: typer.Context, path: Path) -> Path:
    """A path that is no folder, pipe or device; one that is not there is told by whoever reads it."""
    from rig.user_files import regular

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


Log = Annotated[Path, typer.Argument(metavar="LOG", help="A recording (MCAP).", callback=_file)]


def allow(log: Path, trust: bool) -> None:
    """With `trust`, let this process and those that it starts run the code that a recording carries."""
    if trust:
        from rig.parts import trust_scene
        from rig.record.reader import head

        trust_scene(head(log).setup().scene)


def opened(log: Path, trust: bool = False) -> Run:
    """The run of a recording; prints damage and missing parts on standard error. `trust`: see `allow`."""
    from rig.record.reader import open as read

    allow(log, trust)
    run = read(log)
    for told in run.notes:
        printing.note(f"{log}: {told}")
    return run


def replay(
    log: Log,
    speed: Pace = "1.0",
    into: Annotated[
        list[str] | None,
        typer.Option(
            "--into",
            metavar="CONTROLLER",
            help="Start this controller too and compare its commands with the recorded ones.",
        ),
    ] = None,
    trust: Trust = False,
    as_json: Json = False,
) -> None:
    """Play the measurements of a recording back on the bus, for viewers and controllers.

    With --pace max it runs as fast as the controllers answer.
    """
    from rig.bench.replay import replay as play

    allow(log, trust)
    status = printing.Status()
    found = play(log, into=into or (), pace=pace(speed), tell=status.show)
    status.done()
    if as_json:
        printing.report(vars(found))
    else:
        printing.line(f"{found.messages} messages, {found.steps} steps, {found.seconds:.3f} s of simulated time")
        for name, count in found.compared.items():
            printing.line(f"{name}: {count} commands compared")
        printing.line(str(found.divergence) if found.divergence else "no command differs" if found.compared else "")
    if found.divergence or found.unanswered or found.fault:
        printing.note(found.fault or f"{found.unanswered} recorded commands were not answered again")
        raise typer.Exit(1)


def verify(log: Log, trust: Trust = False, as_json: Json = False) -> None:
    """Check a recording: complete, undamaged, and the same bits when it is simulated again."""
    from rig.bench.verify import verify as check

    allow(log, trust)
    found = check(log)
    if as_json:
        printing.report(found.to_json())
    else:
        printing.line(found.text())
    if not found.passed:
        raise typer.Exit(1)


def diff(
    first: Annotated[Path, typer.Argument(metavar="A", help="A recording.", callback=_file)],
    second: Annotated[Path, typer.Argument(metavar="B", help="Another one.", callback=_file)],
    as_json: Json = False,
) -> None:
    """Compare two recordings bit by bit at the instants that both contain, and show where they differ.

    Exit code 1: they differ. One recording may have additional samples between
    those of the other.
    """
    from rig.record.compare import compare

    found = compare(opened(first), opened(second))
    if as_json:
        differences = [vars(difference) for difference in found.differences]
        printing.report({"identical": found.identical, "agree": found.agree, "compared": found.compared,
                     "differences": differences,
                     "missing": found.missing})  # fmt: skip
    elif found.identical:
        printing.line(f"identical: {found.compared} numbers, bit by bit")
    else:
        if found.agree:
            printing.line(f"agree at all common instants: {found.compared} numbers, bit by bit")
        for difference in found.differences:
            printing.line(str(difference))
        for name in found.missing:
            printing.line(f"{name} is in only one of the two recordings")
    if not found.agree:
        raise typer.Exit(1)


def recover(
    log: Log,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="File to write.")] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Recover a recording that was cut off or damaged: write all messages whose checksums are right to a new file.

    Exit code 1: messages were lost, or may have been (what followed a cut is
    unknown).
    """
    from rig.record.recover import recover as save

    if out is not None:
        named("--out", out)
    found = save(log, out, force)
    if as_json:
        printing.report({**vars(found), "complete": found.complete})
    else:
        printing.line(f"{found.path}: {found.messages} messages, {found.seconds:.3f} s; the original: {found.fault}")
        for place in found.skipped:
            printing.line(f"  skipped {place}")
        printing.line(f"  {found.told()}")
    if not found.complete:
        raise typer.Exit(1)


def sound(
    log: Log,
    channel: Annotated[str, typer.Option(metavar="SENSOR", help="Sensor to listen to. Default: the microphone.")] = "",
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
    from rig.analysis.sound import hear
    from rig.analysis.sound.figure import draw
    from rig.analysis.sound.wav import write

    run = opened(log, trust)
    heard = hear(run, channel)
    full = None if out is None else write(heard, out)
    if as_json:
        printing.report(heard.to_json() | {"wav": out, "full_scale": full, "figure": figure})
    else:
        printing.line(heard.text())
        if full is not None:
            printing.line(f"{out}: 24 bit, full scale is {full:.4g} {heard.unit}")
    if figure is not None:
        draw(heard, run, figure)


def amplitude(
    log: Log,
    first: Annotated[
        str | None, typer.Option("--from", metavar="TIME", help="Start of the evaluated time span.")
    ] = None,
    last: Annotated[str | None, typer.Option("--to", metavar="TIME", help="End of the evaluated time span.")] = None,
    trust: Trust = False,
    as_json: Json = False,
) -> None:
    """Compute amplitude and frequency of each measurement, stage by stage, and the speeds of first and last stick."""
    from rig.analysis.amplitude import measured
    from rig.analysis.three_stages import stages

    begin, end = seconds(first, "--from", low=0.0) or 0.0, seconds(last, "--to") or float("inf")
    run = opened(log, trust)
    if not run.time.size:
        raise LogError(f"{log}: the recording ends before its first sample")
    if begin >= min(end, float(run.time[-1])):
        raise UsageError(f"--from {begin:g} s to {min(end, float(run.time[-1])):g} s: the time span is empty; "
                         f"the recording has {run.time[0]:g} to {run.time[-1]:g} s")  # fmt: skip
    rows = list(measured(run, begin, end))
    turns = stages(run)
    if as_json:
        found = [{**row._asdict(), "found": row.found._asdict()} for row in rows]
        printing.report({"rows": found, "stages": turns._asdict() if turns else None})
        return
    cells = [
        (row.stage, row.sensor, f"{row.mean:.5g} {row.unit}", f"{row.found.half:.5g} {row.unit}", row.found.cycles,
         f"{row.found.frequency:.5g} Hz" if row.found.cycles else "-")
        for row in rows
    ]  # fmt: skip
    printing.table(
        "amplitude index: mean of half of peak to valley",
        ("stage", "sensor", "mean", "amplitude", "cycles", "frequency"),
        cells,
    )
    if turns:
        printing.line(turns.text())


COMMANDS = {
    "replay": (replay, "rig replay recordings/golden/pendulum.mcap --into nf --pace max"),
    "verify": (verify, "rig verify recordings/golden/pendulum.mcap"),
    "diff": (diff, "rig diff first.mcap second.mcap"),
    "amplitude": (amplitude, "rig amplitude recordings/runs/lever-20260101-120000.mcap --from '4 s'"),
    "sound": (sound, "rig sound recordings/runs/brake-20260101-120000.mcap --out squeal.wav --figure squeal.png"),
    "recover": (recover, "rig recover recordings/runs/pendulum-20260101-120000.mcap"),
}
