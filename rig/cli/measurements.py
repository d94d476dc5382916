"""Commands for measurements: files of a data acquisition system become a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from rig.cli import printing
from rig.cli.options import Figure, Force, Json, Trust, seconds
from rig.cli.printing import draw, new, new_recording, reads
from rig.cli.recorded import (
    Drive,
    First,
    Friction,
    Last,
    Load,
    Smooth,
    Stiffness,
    Table,
    Threshold,
    Velocity,
    stick_arguments,
)
from rig.cli.recordings import Log, opened
from rig.errors import Faults, UsageError


def _sources(context: typer.Context, paths: list[Path]) -> list[Path]:
    for path in paths:
        reads(context, path)
    return paths


Sources = Annotated[
    list[Path],
    typer.Argument(
        metavar="FILE...",
        help="Files of one run: CSV, Parquet, MAT, HDF5, netCDF, WAV, UFF, TDMS.",
        callback=_sources,
    ),
]
Mapped = Annotated[
    list[str] | None,
    typer.Option(
        "--map",
        metavar='"COLUMN = NAME, SCALE UNIT"',
        help='What a column is: "ch1 = vibrometer, 125 mm/s/V". Repeatable. Default: import.toml beside '
        "the files; without it the columns are listed, and a map is proposed.",
    ),
]
TimeColumn = Annotated[str, typer.Option(metavar='"COLUMN, UNIT"', help='The column with the time: "t, ms".')]
SampleRate = Annotated[str, typer.Option(metavar="RATE", help="Samples per second, in place of times: 2 kHz.")]
Join = Annotated[
    str,
    typer.Option(
        metavar="CHANNEL",
        help='The common time of several files: "trigger > 2 V", whose first sample '
        "is the same instant in all, or a channel that all contain.",
    ),
]
SkipMissing = Annotated[bool, typer.Option("--skip-missing", help="Leave out values that are not there (empty, NaN).")]
ImportedFile = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", callback=new_recording, help="Recording to write. Default: the name of the first file."
    ),
]
LawFile = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        callback=new,
        help="Write friction over rising speed, of a spring "
        "the mean of both ways, as the [friction] of a scene (TOML).",
    ),
]


def import_(
    files: Sources,
    mapped: Mapped = None,
    time: TimeColumn = "",
    rate: SampleRate = "",
    join: Join = "",
    skip_missing: SkipMissing = False,
    out: ImportedFile = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Make a recording of a measurement, in SI units, or list the columns of its files.

    A unit is never guessed: where a file states none, the map must. A file
    import.toml beside the measurements keeps the map for all of them.
    """
    from rig.record.imports import channel_map, import_run

    map_file = files[0].parent / channel_map.NAME
    channels = channel_map.ChannelMap.of_texts(mapped or (), time, rate)
    if not channels.channels and map_file.exists():
        kept = channel_map.ChannelMap.read(map_file)
        channels = channel_map.ChannelMap(kept.channels, time or kept.time, rate or kept.rate)
        printing.note(f"map of {map_file}")
    if not channels.channels:
        if out is not None:
            raise UsageError(f'--out {out}: name the channels, with --map "COLUMN = NAME, UNIT" or in {map_file}')
        printing.result(import_run.listed(files), as_json)
        return
    path = out or files[0].with_suffix(".mcap")
    with printing.bar("samples") as progress:
        imported = import_run.import_files(files, path, channels, join, skip_missing, force, progress)
    printing.result(imported, as_json)


def stick(
    log: Log,
    velocity: Velocity = "",
    friction: Friction = "",
    drive: Drive = "",
    stiffness: Stiffness = "",
    load: Load = "",
    threshold: Threshold = "",
    smooth: Smooth = "",
    begin: First = None,
    end: Last = None,
    law: LawFile = None,
    figure: Figure = None,
    csv: Table = None,
    trust: Trust = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Find stick and slip: times, breakaway forces, share of stick, friction over the slip speed.

    The slip speed is --velocity, or --drive minus --velocity, or what
    remains of --drive when a spring of --stiffness shows --friction.
    """
    from rig.analysis.recorded import stick_slip
    from rig.machine.files import write_file

    run = opened(log, trust)
    faults = Faults()
    contact = faults(
        lambda: stick_arguments(run, velocity, friction, drive, stiffness, load, threshold, smooth), dict[str, Any]()
    )
    low = faults(lambda: seconds(begin, "--from", 0.0), None) or 0.0
    high = faults(lambda: seconds(end, "--to"), None) or float("inf")
    faults.raise_found()
    slips = stick_slip(run, **contact, first=low, last=high)
    printing.result(slips, as_json, figure=figure, csv=csv, law=law)
    if csv is not None:
        write_file(csv, slips.csv().encode())
    if law is not None:
        write_file(law, slips.law().encode())
    draw(slips, figure)


COMMANDS = {
    "stick": (
        stick,
        "rig analyse stick paper.mcap --friction force --stiffness '168 N/m' --drive '1.1 mm/s' --figure stick.png",
    ),
    "import": (import_, 'rig import bench.csv --map "ch1 = vibrometer, 125 mm/s/V" --time "t, s" --out run.mcap'),
}
