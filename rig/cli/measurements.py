"""Commands for measurements: files of a data acquisition system become a recording."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

import rig
from rig.cli import printing
from rig.cli.build import Answer, Made
from rig.cli.printing import new, new_recording, reads
from rig.cli.recorded import (
    CONTACT,
    SPAN,
    stick_arguments,
)
from rig.cli.recordings import opened
from rig.errors import Faults, UsageError
from rig.parameters import Argument, Option


def _sources(context: typer.Context, paths: list[Path]) -> list[Path]:
    for path in paths:
        reads(context, path)
    return paths


def import_(
    files: Annotated[
        list[Path],
        Argument("FILE...", "Files of one run: CSV, Parquet, MAT, HDF5, netCDF, WAV, UFF, TDMS.", check=_sources),
    ],
    map: list[str],
    time: str,
    rate: str,
    join: str,
    skip_missing: bool,
    force: bool,
    out: Annotated[
        Path | None, Option("FILE", "Recording to write. Default: the name of the first file.", check=new_recording)
    ] = None,
) -> Any:
    """Make a recording of a measurement, in SI units, or list the columns of its files.

    A unit is never guessed: where a file states none, the map must. A file
    import.toml beside the measurements keeps the map for all of them.
    """
    from rig.record.imports import channel_map, import_run

    map_file = files[0].parent / channel_map.NAME
    channels = channel_map.ChannelMap.of_texts(map, time, rate)
    if not channels.channels and map_file.exists():
        kept = channel_map.ChannelMap.read(map_file)
        channels = channel_map.ChannelMap(kept.channels, time or kept.time, rate or kept.rate)
        printing.note(f"map of {map_file}")
    if not channels.channels:
        if out is not None:
            raise UsageError(f'--out {out}: name the channels, with --map "COLUMN = NAME, UNIT" or in {map_file}')
        return import_run.listed(files)
    path = out or files[0].with_suffix(".mcap")
    with printing.bar("samples") as progress:
        return import_run.import_files(files, path, channels, join, skip_missing, force, progress)


def stick(
    log: Path,
    trust: bool,
    faults: Faults,
    begin: float | None,
    end: float | None,
    law: Annotated[
        Path | None,
        Option(
            "FILE",
            "Write friction over rising speed, of a spring the mean of both ways, as the law of a scene (TOML).",
            check=new,
        ),
    ] = None,
    **contact: str | None,
) -> Answer:
    """Find stick and slip: times, breakaway forces, share of stick, friction over the slip speed.

    The slip speed is --velocity, or --drive minus --velocity, or what
    remains of --drive when a spring of --stiffness shows --friction.
    """
    from rig.analysis.recorded import stick_slip
    from rig.machine.files import write_file

    run = opened(log, trust)
    arguments = faults(lambda: stick_arguments(run, contact), dict[str, Any]())
    faults.raise_found()
    slips = stick_slip(run, **arguments, first=begin or 0.0, last=float("inf") if end is None else end)

    def then() -> Iterator[str]:
        if law is not None:
            write_file(law, slips.law().encode())
        yield from ()

    return Answer(slips, more={"law": law}, then=then)


COMMANDS = {
    "stick": Made(
        stick,
        "rig analyse stick paper.mcap --friction force --stiffness '168 N/m' --drive '1.1 mm/s' --figure stick.png",
        files="figure csv",
        more=SPAN | CONTACT,
    ),
    "import": Made(
        import_, 'rig import bench.csv --map "ch1 = vibrometer, 125 mm/s/V" --time "t, s" --out run.mcap', rig.import_
    ),
}
