"""The command `rig map`: steady-state behaviour, or stable and unstable regions, over one or two parameters."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.cli import printing
from rig.cli.options import Changes, Force, Json, SceneName, changes, seconds, the_scene
from rig.cli.outputs import draw, refuse
from rig.errors import UsageError

if TYPE_CHECKING:
    from rig.analysis.axis import Axis
    from rig.scenes.scene import Scene

XAxis = Annotated[
    str,
    typer.Option(
        metavar="KEY=FROM:TO:COUNT", help='First axis, along which runs are continued: "drive.speed=1:8 rpm:36".'
    ),
]
YAxis = Annotated[
    str | None, typer.Option(metavar="KEY=FROM:TO:COUNT", help="Second axis: one row of the map for each value.")
]
Runs = Annotated[
    str,
    typer.Option(
        metavar="LIST",
        help="Runs: up, down (continued from point to point), near, far (start near to or far from sliding).",
    ),
]
Output = Annotated[
    str | None, typer.Option(metavar="NAME", help="Plant output to evaluate. Default: the first output of the plant.")
]
Longest = Annotated[
    str | None,
    typer.Option(metavar="TIME", help="Longest simulated time for one point. Default: at least 480 slow periods."),
]
Workers = Annotated[int | None, typer.Option(min=1, max=256, help="Number of processes. Default: one for each core.")]
Eigenvalues = Annotated[
    bool,
    typer.Option(
        "--eigenvalues", help="Simulate nothing: find where sliding is unstable, by eigenvalues, over both axes."
    ),
]
Folder = Annotated[
    Path, typer.Option(metavar="FOLDER", help="Folder for the results; each map has a folder of its own in it.")
]


def map_(
    scene: SceneName,
    x: XAxis,
    y: YAxis = None,
    p: Changes = None,
    runs: Runs = "up,down,near,far",
    output: Output = None,
    longest: Longest = None,
    workers: Workers = None,
    eigenvalues: Eigenvalues = False,
    out: Folder = Path("maps"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Map the steady-state behaviour over one or two parameters: sliding, stick-slip, or both.

    One axis gives a bifurcation diagram. Results are kept: after an
    interruption the same command continues. --force draws a finished map again.
    """
    from rig.analysis.map import chart, job, store_of
    from rig.user_files import write_file

    loaded = the_scene(scene, changes(p))
    printing.warnings(loaded)
    if eigenvalues:
        _regions(loaded, x, y, out, workers, force, as_json)
        return
    wanted = tuple(run.strip() for run in runs.split(",") if run.strip())
    todo = job(loaded, x, y, output, wanted, seconds(longest, "--longest"))
    if not todo.dithered:
        idle(loaded, todo.x, todo.y)
    store = store_of(todo, out)
    refuse(store.folder, ("map.csv", "map.png"), force)
    with printing.kept(store, "parts", len(todo.units)), printing.bar("rows" if y else "parts") as progress:
        found = chart(todo, out, workers, progress)
    if as_json:
        printing.report(found.to_json())
    else:
        printing.line(found.text())
        printing.line(f"\n{store.folder}/map.png, map.csv")
    write_file(store.folder / "map.csv", found.csv().encode())
    draw(found, store.folder / "map.png")


def idle(scene: Scene, *axes: Axis | None) -> None:
    """Warn of parameters of effects that are off."""
    for why in filter(None, (axis.idle(scene) for axis in axes if axis)):
        printing.note(f"warning: {why}")


def _regions(scene: Scene, x: str, y: str | None, out: Path, workers: int | None, force: bool, as_json: bool) -> None:
    from rig.analysis.axis import axes
    from rig.analysis.map import store_of, survey, surveyed
    from rig.user_files import write_file

    if y is None:
        raise UsageError("--eigenvalues: needs --y as well; over one parameter: rig modes SCENE --sweep KEY=A:B:N")
    across, along = axes(scene, {"--x": x, "--y": y})
    idle(scene, across, along)
    todo = surveyed(scene, across, along)
    store = store_of(todo, out)
    refuse(store.folder, ("regions.csv", "regions.png"), force)
    with printing.kept(store, "parts", len(todo.units)), printing.bar("rows") as progress:
        found, folder = survey(scene, across, along, out, workers, progress)
    if as_json:
        printing.report(found.to_json() | {"folder": str(folder)})
    else:
        printing.line(found.text())
        printing.line(f"\n{folder}/regions.png, regions.csv")
    write_file(folder / "regions.csv", found.csv().encode())
    draw(found, folder / "regions.png")


COMMANDS = {
    "map": (map_, 'rig map belt --x "drive.speed=0.05 m/s:0.8 m/s:40" --y "load.force=10 N:30 N:5"'),
}
