"""The command that writes a recording for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rig.cli import printing
from rig.cli.logs import Log, opened
from rig.cli.options import Force, Json, at, number
from rig.cli.outputs import hold, named, parents, refuse
from rig.errors import UsageError
from rig.printable import printable

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
    from rig.record.export.description import description
    from rig.record.export.files import files

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
    "export": (export, "rig export recordings/golden/pendulum.mcap --to csv --only vibrometer,nf --rate '500 Hz'"),
}
