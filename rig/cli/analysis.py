"""Commands that learn something from a rig without running its protocol."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.cli import printing
from rig.cli.options import Changes, Force, Json, SceneName, changes, seconds, the_scene
from rig.cli.outputs import new, refuse
from rig.errors import NumericsError, SceneError, UsageError

if TYPE_CHECKING:
    from rig.analysis.control_loop import Loop
    from rig.analysis.modes import Modes
    from rig.analysis.sweep import Sweep
    from rig.scenes.scene import Scene

Along = Annotated[
    str | None,
    typer.Option(
        "--sweep",
        metavar="KEY=A:B:N",
        help='Compute eigenvalues over a parameter, and critical values: "drive.speed=0.05 m/s:0.4 m/s:50".',
    ),
]
Controller = Annotated[
    str | None,
    typer.Option(
        "--controller",
        metavar="NAME",
        help="Close the loop of this controller: eigenvalues, gain, phase and delay margins.",
    ),
]
Picture = Annotated[
    Path | None, typer.Option("--figure", metavar="FILE", callback=new, help="Draw the sweep (PNG, SVG, PDF).")
]
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
Settling = Annotated[
    str | None,
    typer.Option(
        "--longest", metavar="TIME", help="Simulated time within which the motion must settle. Default: 120 s."
    ),
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


def modes(
    scene: SceneName,
    p: Changes = None,
    along: Along = None,
    controller: Controller = None,
    figure: Picture = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Compute eigenvalues and eigenmodes at steady sliding, open or closed loop, also over a parameter (--sweep)."""
    loaded = the_scene(scene, changes(p))
    if along is not None or controller is not None:
        printing.warnings(loaded)
    faults = ["--figure: draws a sweep; add --sweep KEY=A:B:N"] if figure is not None and not along else []
    found: Modes | Loop | Sweep | None = None
    try:
        if along is not None:
            found = _swept(loaded, along, controller)
        elif controller is not None:
            from rig.analysis.control_loop import loop

            found = loop(loaded, controller)
        else:
            from rig.analysis.modes import modes as solve

            found = solve(loaded)
    except SceneError as error:
        faults += error.faults
    if faults or found is None:
        raise SceneError(loaded.name, faults)
    if as_json:
        printing.report(found.to_json())
    else:
        printing.line(found.text())
    if figure is not None:
        from rig.analysis.sweep import Sweep
        from rig.analysis.sweep_figure import draw

        assert isinstance(found, Sweep)
        draw(found, figure)
    _refused(loaded, found)


def _refused(scene: Scene, found: Modes | Loop | Sweep) -> None:
    """Say so where a run of the scene would be refused: nothing limits what grows."""
    from rig.analysis.modes import Modes

    errors = [one for one in found.findings if one.level == "error"] if isinstance(found, Modes) else []
    if not errors or scene.clock.unstable == "run":
        return
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    printing.note(f"{scene.name}: a run is refused{more}: {errors[0].what}\n  {errors[0].remedy}\n"
              '  clock.unstable = "run" runs it nevertheless, up to clock.limit')  # fmt: skip
    raise typer.Exit(NumericsError.exit_code)


def _swept(scene: Scene, along: str, controller: str | None) -> Sweep:
    from rig.analysis.axis import axes
    from rig.analysis.control_loop import loop, sweep_loop
    from rig.analysis.sweep import sweep

    faults: list[str] = []
    if controller is not None:
        try:
            loop(scene, controller)
        except SceneError as error:
            faults += error.faults
    try:
        [axis] = axes(scene, {"--sweep": along}, controller or "")
    except SceneError as error:
        faults += error.faults
    if faults:
        raise SceneError(scene.name, faults)
    return sweep(scene, axis) if controller is None else sweep_loop(scene, axis, controller)


def cycle(scene: SceneName, p: Changes = None, longest: Settling = None, as_json: Json = False) -> None:
    """Find the limit cycle: period, time in stick, extremes, energy per period, Floquet multipliers.

    The plant runs alone: actuators are held, no controller acts, no sensor
    measures.

    Exit code 1: undecided within the longest time.
    """
    from rig.analysis.cycle import limit_cycle

    most, loaded = seconds(longest, "--longest"), the_scene(scene, changes(p))
    printing.warnings(loaded)
    status = printing.Status()
    try:
        found = limit_cycle(
            loaded,
            longest=most,
            watch=lambda now, drift: status.show(
                f"{now:.3g} s simulated, successive periods agree to {drift:.0e} of a period"
            ),
        )
    finally:
        status.done()
    if as_json:
        printing.report(found.to_json())
    else:
        printing.line(found.text())
        if loaded.controllers or loaded.sensors:
            printing.line(f"  plant alone: without {_left_out(loaded)}")
    if not found.decided:
        raise typer.Exit(1)


def _left_out(scene: Scene) -> str:
    """The controllers and sensors of a scene, in words."""
    parts = ("controller", scene.controllers), ("sensor", scene.sensors)
    return " and ".join(f"{what}{'s' * (len(names) > 1)} {', '.join(names)}" for what, names in parts if names)


def identify(scene: SceneName, p: Changes = None, as_json: Json = False) -> None:
    """Identify parameters of the lever rig: run an experiment and evaluate its measurements."""
    from rig.analysis.identify import identify as run

    found = run(the_scene(scene, changes(p)))
    if as_json:
        printing.report(found.to_json())
        return
    printing.line(found.text())


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
    from rig.analysis.map import Store, chart, job
    from rig.analysis.map.figure import draw

    loaded = the_scene(scene, changes(p))
    printing.warnings(loaded)
    if eigenvalues:
        _regions(loaded, x, y, out, workers, force, as_json)
        return
    wanted = tuple(run.strip() for run in runs.split(",") if run.strip())
    todo = job(loaded, x, y, output, wanted, seconds(longest, "--longest"))
    store = Store.of(todo, out)
    refuse(store.folder, ("map.csv", "map.png"), force)
    try:
        with printing.bar("rows" if y else "parts") as progress:
            found = chart(todo, out, workers, progress)
    except KeyboardInterrupt:
        printing.note(f"interrupted: {len(store.load())} of {len(todo.units)} parts are kept in {store.folder}; "
                  "the same command continues from there")  # fmt: skip
        raise
    if as_json:
        printing.report(found.to_json())
    else:
        printing.line(found.text())
        printing.line(f"\n{store.folder}/map.png, map.csv")
    found.write_csv(store.folder / "map.csv")
    draw(found, store.folder / "map.png")


def _regions(scene: Scene, x: str, y: str | None, out: Path, workers: int | None, force: bool, as_json: bool) -> None:
    from rig.analysis.axis import axes
    from rig.analysis.map import Store, survey, surveyed
    from rig.analysis.regions import draw

    if y is None:
        raise UsageError("--eigenvalues: needs --y as well; over one parameter: rig modes SCENE --sweep KEY=A:B:N")
    across, along = axes(scene, {"--x": x, "--y": y})
    refuse(Store.of(surveyed(scene, across, along), out).folder, ("regions.csv", "regions.png"), force)
    with printing.bar("rows") as progress:
        found, folder = survey(scene, across, along, out, workers, progress)
    if as_json:
        printing.report(found.to_json() | {"folder": str(folder)})
    else:
        printing.line(found.text())
        printing.line(f"\n{folder}/regions.png, regions.csv")
    found.write_csv(folder / "regions.csv")
    draw(found, folder / "regions.png")


def reproduce(
    figure: Annotated[str, typer.Argument(metavar="FIGURE", help='Name of a figure, of a paper, or "all".')] = "",
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Folder for the pictures and their page.")] = Path(
        "gallery"
    ),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Make a figure of a paper again from a scene, and compare its numbers with published or reference values.

    Without FIGURE: list the figures. Exit code 1: a number does not agree.
    Other figures in the folder are kept.
    """
    from rig import papers as again
    from rig.record.provenance import provenance

    if not figure:
        entries = again.pick("all")
        if as_json:
            printing.report([{"name": e.name, "title": e.title, "scenes": list(e.scenes)} for e in entries])
        else:
            rows = [(e.name, e.number, e.title, ", ".join(e.scenes)) for e in entries]
            printing.table("", ("figure", "in the paper", "what it shows", "scenes"), rows)
        return
    wanted = again.pick(figure)
    page = [] if (out / "numbers.json").exists() else ["README.md"]  # else it is the page of figures made before
    refuse(out, [*(f"{entry.name}.png" for entry in wanted), *page], force)
    results = []
    with printing.bar("figures") as progress:
        for number, entry in enumerate(wanted):
            progress(number, len(wanted))
            results.append(again.make(entry, out))
            if not as_json:
                agree = sum(c.agrees for c in results[-1].comparisons)
                printing.note(
                    f"{entry.name}: {agree} of {len(results[-1].comparisons)} numbers agree; {results[-1].picture}"
                )
        progress(len(wanted), len(wanted))
    machine = provenance(0, ())
    host = f"{machine['processor']}, {machine['cores']} cores, Python {machine['python']}, numba {machine['numba']}"
    (out / "README.md").write_text(again.page(again.keep(results, out), host))
    if as_json:
        printing.report([result.to_json() for result in results])
    else:
        for result in results:
            numbers = [
                (c.what, f"{c.ours:.7g}", f"{c.expected:.7g}", c.unit, c.source, c.bound, "" if c.agrees else "DIFFERS")
                for c in result.comparisons
            ]
            columns = ("number", "ours", "expected", "", "source", "bound", "")
            printing.table(f"{result.entry.name}: {result.entry.title}", columns, numbers)
    if not all(result.agrees for result in results):
        raise typer.Exit(1)


COMMANDS = {
    "modes": (modes, 'rig modes belt --sweep "drive.speed=0.05 m/s:0.4 m/s:50" --figure locus.png'),
    "cycle": (cycle, 'rig cycle two_dof -p friction.mu=0.45 --longest "10 min"'),
    "identify": (identify, "rig identify lever_kinetic_friction"),
    "map": (map_, 'rig map belt --x "drive.speed=0.05 m/s:0.8 m/s:40" --y "load.force=10 N:30 N:5"'),
    "reproduce": (reproduce, "rig reproduce kroeger-3"),
}
