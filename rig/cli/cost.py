"""The command `rig cost`: error against compute time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.cli import printing
from rig.cli.options import Budget, Changes, Force, Json, SceneName, accuracy, at, changes, share, the_scene
from rig.cli.outputs import draw, refuse
from rig.errors import ExitCode

if TYPE_CHECKING:
    from rig.qualify.cost import Table
    from rig.qualify.cost.delay import Delayed
    from rig.qualify.cost.effects import Paired
    from rig.scenes.scene import Scene

Metric = Annotated[
    str,
    typer.Option(
        metavar="MEASURE", help="Error measure for the recommendation. Default: worst, the largest of all measures."
    ),
]
Target = Annotated[float, typer.Option(metavar="ERROR", help="Target relative error.")]
Folder = Annotated[
    Path, typer.Option(metavar="FOLDER", help="Folder for the results; each scene has a folder of its own in it.")
]
Peers = Annotated[
    bool,
    typer.Option(
        "--peers", help="Compare with scipy, SUNDIALS, diffrax, PathSim and MuJoCo instead, as far as installed."
    ),
]


def cost(
    scene: SceneName,
    p: Changes = None,
    metric: Metric = "worst",
    target: Target = 1e-3,
    budget: Budget = None,
    peers: Peers = False,
    out: Folder = Path("cost"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Measure error against compute time for each method and step, and recommend a setting.

    The errors are those of physical measures, such as period and amplitude.
    Writes a table (CSV, Parquet) and figures. `rig run SCENE --accuracy 1e-4`
    uses the table.
    """
    wanted, most = accuracy(target, "--target"), share(budget)
    from rig.errors import UsageError
    from rig.qualify.cost import cost as measure
    from rig.qualify.cost import folder_of, recommended
    from rig.qualify.cost.pareto import front
    from rig.qualify.cost.report import COLUMNS, CostReport, lines, notes
    from rig.qualify.cost.waterfall import text

    loaded = the_scene(scene, changes(p))
    printing.warnings(loaded)
    folder = folder_of(loaded, at(out))
    refuse(folder, ("peers.csv", "peers.png") if peers else ("cost.png",), force)  # drawn last: a table without is not
    if peers:
        _race(loaded, target, folder, as_json)
        return
    try:
        with printing.bar("settings") as progress:
            found = measure(loaded, out, progress)
    except KeyboardInterrupt:
        printing.note(f"interrupted; the results so far are in {folder}")
        raise
    by = found.metric(metric)
    try:
        pick, why = recommended(found.rows, by, wanted, most), ""
    except UsageError as error:
        pick, why = None, str(error)
    loops, parts = _loops(loaded, folder), _effects(loaded, folder)
    if as_json:
        report = {**vars(found), "rows": [row.flat() for row in found.rows], "folder": str(folder)}
        report |= {"recommended": None if pick is None else pick.flat(), "why": why}
        printing.report({**report, "loops": [vars(one) for one in loops], "effects": [one.to_json() for one in parts]})
    else:
        printing.table(f"{found.scene}: error and compute time on this machine", COLUMNS, lines(found, by, pick))
        printing.line()
        for line in [*notes(found, by), *(one.text() for one in loops), *map(text, parts)]:
            printing.line(f"  {line}")
        printing.line(f"\nrecommended for a relative error of {wanted:g}: {why or pick.text(by)}")  # type: ignore[union-attr]
    if front(found.rows, by):
        draw(CostReport(found, by, pick, most), folder / "cost.png")
    _draw(found, loops, parts, folder)
    if not as_json:
        printing.line(f"{folder}: {', '.join(sorted(path.name for path in folder.iterdir()))}")
    if pick is None:
        raise typer.Exit(ExitCode.FAILED)


def _race(scene: Scene, target: float, folder: Path, as_json: bool) -> None:
    """Other people's solvers on the same problem."""
    from rig.qualify.cost.peers.race import ABSENT, race
    from rig.qualify.cost.peers.report import COLUMNS, draw, lines, write
    from rig.record.provenance import provenance

    with printing.bar("runs") as progress:
        found = race(scene, report=progress)
    folder.mkdir(parents=True, exist_ok=True)
    write(found, folder / "peers.csv")
    if as_json:
        printing.report([vars(one) for one in found])
    else:
        printing.table(
            f"{scene.name}: the fastest setting that meets a relative error of {target:g}",
            COLUMNS,
            lines(found, target),
        )
        printing.line(f"\n{folder}/peers.png, peers.csv")
        if any(one.fault == ABSENT for one in found):
            printing.line("to install missing solvers: pip install -e '.[peers]' in the project's folder")
    draw(found, scene.title, provenance(scene.seed), target, folder / "peers.png")


def _loops(scene: Scene, folder: Path) -> list[Delayed]:
    """What delay and sampling of its loops cost."""
    from rig.qualify.cost.delay import delayed, write

    loops = delayed(scene)
    if loops:
        write(loops, folder / "delay.csv")
    return loops


def _effects(scene: Scene, folder: Path) -> list[Paired]:
    """What its effects cost and change."""
    from rig.qualify.cost.effects import effects
    from rig.qualify.cost.waterfall import write

    with printing.bar("effects") as progress:
        parts = effects(scene, report=progress)
    if parts:
        write(parts, folder / "effects.csv")
    return parts


def _draw(found: Table, loops: list[Delayed], parts: list[Paired], folder: Path) -> None:
    """The figures of loops and effects, where there are any."""
    from rig.qualify.cost import delay, waterfall

    if loops:
        delay.draw(loops, found, folder / "delay.png")
    if parts:
        waterfall.draw(parts, found, folder / "effects.png")


COMMANDS = {"cost": (cost, "rig cost belt_c --target 1e-4 --budget 40%")}
