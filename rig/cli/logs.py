"""Commands for recordings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.cli import printing
from rig.cli.options import Force, Json, Trust, changes, pace, paired, plain, renamed, seconds
from rig.cli.outputs import draw, named, new, reads
from rig.errors import ExitCode, LogError, UsageError

if TYPE_CHECKING:
    from rig.record.run import Run


def recording(context: typer.Context, path: Path | None) -> Path | None:
    """Check the path of a recording: no folder, pipe or device. Whoever reads it reports a file that does not exist."""
    from rig.user_files import regular

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
    from rig.bench.replay import replay as play

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
    from rig.bench.verify import verify as check

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
    from rig.record.recover import recover as save
    from rig.user_files import recording_name

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
    from rig.analysis.sound import hear
    from rig.record.wav import write
    from rig.user_files import draft_of

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


COMMANDS = {
    "replay": (replay, "rig replay recordings/golden/pendulum.mcap --into nf --pace max"),
    "verify": (verify, "rig verify recordings/golden/pendulum.mcap"),
    "amplitude": (amplitude, "rig amplitude recordings/runs/lever-20260101-120000.mcap --from '4 s'"),
    "sound": (sound, "rig sound recordings/runs/brake-20260101-120000.mcap --out squeal.wav --figure squeal.png"),
    "recover": (recover, "rig recover recordings/runs/pendulum-20260101-120000.mcap"),
}
