"""The command that writes a scene as an FMU."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rig.cli import printing
from rig.cli.options import Changes, Force, Json, SceneName, changes, the_scene
from rig.cli.outputs import new


def fmu(
    scene: SceneName,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", callback=new, help="FMU to write.")],
    p: Changes = None,
    inputs: Annotated[
        list[str] | None,
        typer.Option(
            "--input",
            metavar="ACTUATOR",
            help="Actuator that is an input; may be repeated. Default: all that can be commanded.",
        ),
    ] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write a scene as an FMU for co-simulation (FMI 2.0), for controllers in other tools.

    Inputs are actuators; outputs are the sensors and the plant's own outputs,
    with units. The rig runs in a child process of the program that imports the
    FMU: it needs this Python, or another one with friction-rig (parameter
    python). Controllers of the scene that drive an input are left out.
    """
    overrides = changes(p)
    from rig.plant_fmu.export import export

    loaded = the_scene(scene, overrides)
    found = export(loaded, out, inputs or ())
    if as_json:
        printing.report({"path": out, "inputs": found.inputs, "outputs": found.results})
        return
    for label, names in (("inputs", found.inputs), ("outputs", found.results)):
        printing.line(f"{label:9}{', '.join(f'{name} [{unit}]' for name, unit in names.items())}")
    printing.line(f"step     {loaded.frame_ns * 1e-9:g} s, or a whole number of these")
    printing.line(f"fmu      {out}")


COMMANDS = {"fmu": (fmu, "rig fmu belt --out plant.fmu")}
