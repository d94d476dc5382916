"""Commands that analyse a rig without running its protocol: modes, cycle, identify, loop, map."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.cli import printing
from rig.cli.options import (
    Changes,
    Figure,
    Force,
    Json,
    Net,
    Page,
    Redesign,
    Results,
    SceneName,
    Untold,
    added,
    changes,
    linked,
    loop_option,
    named,
    refuse_all,
    seconds,
    separated,
    the_scene,
)
from rig.cli.printing import draw, new, refuse
from rig.errors import ExitCode, SceneError, UsageError
from rig.printable import counted

if TYPE_CHECKING:
    from rig.analysis.linear.control_loop import Loop
    from rig.analysis.linear.modes_report import Modes
    from rig.analysis.linear.sweep import Sweep
    from rig.model.system import Finding
    from rig.results import Result
    from rig.scenes.axis import Axis
    from rig.scenes.scene import Scene


Controller = Annotated[
    str | None, loop_option("Close the loop of this controller: eigenvalues, gain, phase and delay margins.")
]


def modes(
    scene: SceneName,
    p: Changes = None,
    along: Annotated[
        str | None,
        typer.Option(
            "--sweep",
            metavar="KEY=A:B:N",
            help='Compute eigenvalues over a parameter, and critical values: "drive.speed=0.05 m/s:0.4 m/s:50".',
        ),
    ] = None,
    controller: Controller = None,
    untold: Untold = None,
    redesign: Redesign = False,
    figure: Figure = None,
    shapes: Annotated[
        Path | None,
        typer.Option(
            "--shapes",
            metavar="FILE",
            callback=new,
            help="Mode shapes on the nodes of a structure, moving: GIF, or RRD for rerun.",
        ),
    ] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Compute eigenvalues and eigenmodes at steady sliding, open or closed loop, also over a parameter (--sweep)."""
    asked = [] if controller is None else [controller]
    loaded = the_scene(scene, changes(p), {"--controller": added(asked)}, untold, redesign)
    controller = next(iter(named(asked)), None)
    if along is not None or controller is not None:
        if shapes is not None:
            raise UsageError("--shapes: needs the modes of one scene; leave --sweep and --controller out")
        printing.warnings(loaded)
    result: Modes | Loop | Sweep
    errors: list[Finding] = []
    if along is not None:
        result = _swept(loaded, along, controller)
    elif controller is not None:
        from rig.analysis.linear.control_loop import loop

        result = loop(loaded, controller)
    else:
        from rig.analysis.linear.modes import modes as solve

        result = solve(loaded)
        if shapes is not None:
            from rig.analysis.linear.mode_shapes import write

            write(result, shapes)
        errors = [finding for finding in result.findings if finding.level == "error"]
    printing.result(result, as_json)
    draw(result, figure)
    if errors and loaded.clock.unstable != "run":
        more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
        printing.note(
            f"{loaded.name}: a run is refused{more}: {errors[0].what}\n  {errors[0].remedy}\n"
            '  clock.unstable = "run" runs it nevertheless, up to clock.limit'
        )
        raise typer.Exit(ExitCode.STOPPED)


def _swept(scene: Scene, along: str, controller: str | None) -> Sweep:
    from rig.analysis.linear.control_loop import loop, sweep_loop
    from rig.analysis.linear.modes import dithers
    from rig.analysis.linear.sweep import sweep
    from rig.scenes.axis import axes

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
    averaged = controller is None and dithers(scene, axis.key)
    if not averaged:
        idle(scene, axis)
    return sweep(scene, axis) if controller is None else sweep_loop(scene, axis, controller)


def cycle(
    scene: SceneName,
    p: Changes = None,
    longest: Annotated[
        str | None,
        typer.Option(
            "--longest", metavar="TIME", help="Simulated time within which the motion must settle. Default: 120 s."
        ),
    ] = None,
    figure: Figure = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Find the limit cycle: period, time in stick, extremes, energy per period, Floquet multipliers.

    The plant runs alone: actuators are held, no controller acts, no sensor
    measures.

    Exit code 1: undecided within the longest time.
    """
    from rig.analysis.cycles.cycle import limit_cycle

    most = seconds(longest, "--longest")
    loaded = the_scene(scene, changes(p))
    printing.warnings(loaded)
    with printing.status() as show:

        def watch(now: float, drift: float) -> None:
            agree = f", successive periods agree to {drift:.0e} of a period" if math.isfinite(drift) else ""
            show(f"{now:.3g} s simulated{agree}")

        motion = limit_cycle(loaded, longest=most, watch=watch)
    printing.result(motion, as_json)
    draw(motion, figure)
    printing.passed(motion.decided)


def identify(
    scene: SceneName,
    p: Changes = None,
    runs: Annotated[
        Path | None,
        typer.Option("--runs", metavar="FILE", help="The recordings and what is free (TOML, see docs/identify.md)."),
    ] = None,
    following: Annotated[
        str | None,
        typer.Option(
            "--next",
            metavar="KEY=VALUES, ...",
            help='Propose the next experiment among settings: "drive.speed=0.05 m/s:0.3 m/s:5, load.force=8 N, 16 N".',
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", callback=new, help="Write a scene (TOML) and its covariance (JSON)."),
    ] = None,
    page: Page = None,
    keep: Annotated[
        Path, typer.Option("--folder", metavar="FOLDER", help="Folder in which evaluations are kept for a repetition.")
    ] = Path("fits"),
    workers: Annotated[
        int | None, typer.Option(min=1, max=256, help="Number of processes. Default: one for each core.")
    ] = None,
    figure: Figure = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Fit parameters of a rig to recordings: value, interval, and a verdict for each.

    Without --runs: run an experiment of the lever rig and evaluate it. Scenes with
    an experiment: lever_free_cylinder, lever_free_lever, lever_static_friction,
    lever_kinetic_friction.

    Evaluations are kept: after an interruption the same command continues. Exit code
    1: no law fits, or a parameter cannot be identified.
    """
    loaded = the_scene(scene, changes(p))
    title = f"Parameters of {loaded.title or loaded.name}"
    if runs is None:
        from rig.analysis.identification.lever import experiment as run

        if following is not None or out is not None:
            raise UsageError("--next and --out need recordings: --runs FILE")
        evaluated = run(loaded)
        printing.result(evaluated, as_json, figure=figure, page=page)
        draw(evaluated, figure)
        _put(evaluated, title, page)
        printing.passed(evaluated.complete)
        return
    from rig.analysis.identification.identify import identify as fit
    from rig.analysis.identification.next_experiment import asked, propose, settings_of
    from rig.analysis.identification.runs import prepared
    from rig.analysis.identification.written import write

    settings = None if following is None else asked(following)
    if settings is not None:
        settings_of(loaded, settings)  # a fit takes minutes
    task = prepared(loaded, runs)
    try:
        with printing.status() as show:
            fitted = fit(task, keep, workers, lambda done: show(f"{counted(done, 'cycle')} computed"))
        refused: UsageError | None = None
        if settings is not None:
            try:
                with printing.bar("settings") as progress:
                    fitted = propose(fitted, settings, workers, progress)
            except UsageError as fault:  # the fit took minutes: its report comes first
                refused = fault
    except KeyboardInterrupt:
        printing.note(f"interrupted: finished cycles are kept in {keep}; the same command continues from there")
        raise
    more = {"figure": figure, "page": page}
    if out is not None and fitted.told:
        written_, beside = write(fitted, out, scene)
        more |= {"scene_file": written_, "covariance": beside}
    printing.result(fitted, as_json, **more)
    draw(fitted, figure)
    _put(fitted, title, page)
    if out is not None and not as_json:
        printing.line(f"\n{out}, {beside}" if fitted.told else f"\n{out} is not written: no parameter is identified")
    if refused is not None:
        raise refused
    printing.passed(fitted.complete)


def _put(result: Result, title: str, page: Path | None) -> None:
    """Write the page of a result."""
    if page is not None:
        from rig.analysis.report.page import result_page
        from rig.machine.files import write_file

        write_file(page, result_page(result, title).encode())


Measure = Annotated[
    bool,
    typer.Option("--measure", help="Measure the time over the bus on this machine, as rig tool doctor does (1 s)."),
]


def loop(
    scene: SceneName,
    p: Changes = None,
    net: Net = None,
    controller: Annotated[
        str | None, loop_option("Controller of the loop. Default: the only one of the scene.")
    ] = None,
    untold: Untold = None,
    measure: Measure = False,
    figure: Figure = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Report on a control loop: delay budget, margins, and decay rate over delay, jitter and loss of its link.

    The loop is linearised about steady sliding. One point is checked by
    simulations: that of the scene's own links, or one that is chosen.
    """
    from rig.analysis.linear.loop_report import report

    given = changes(p)
    asked = [] if controller is None else [controller]
    loaded = the_scene(scene, given, {"--controller": added(asked), "--net": linked(net, given)}, untold)
    name = next(iter([*named(asked), *loaded.controllers]), "")
    if controller is None and len(loaded.controllers) != 1:
        known = ", ".join(loaded.controllers) or "none"
        raise UsageError(f"{loaded.name}: name the controller of the loop with --controller; there are: {known}")
    printing.warnings(loaded)
    bus = None
    if measure:
        from rig.qualify.doctor import round_trips

        trips, _, fault = round_trips(1.0)
        if fault or not len(trips):
            printing.note(f"the bus was not measured: {fault or 'no answer arrived'}")
        else:
            import numpy as np

            bus = float(np.quantile(trips, 0.99)) * 1e-9
    with printing.bar("points") as progress:
        reported = report(loaded, name, bus, progress)
    printing.result(reported, as_json)
    draw(reported, figure)


Runs = Annotated[
    str,
    typer.Option(
        metavar="LIST",
        help="Runs: up, down (continued from point to point), near, far (start near to or far from sliding).",
    ),
]
Longest = Annotated[
    str | None,
    typer.Option(metavar="TIME", help="Longest simulated time for one point. Default: at least 480 slow periods."),
]
Workers = Annotated[int | None, typer.Option(min=1, max=256, help="Number of processes. Default: one for each core.")]


def map_(
    scene: SceneName,
    x: Annotated[
        str,
        typer.Option(
            metavar="KEY=FROM:TO:COUNT", help='First axis, along which runs are continued: "drive.speed=1:8 rpm:36".'
        ),
    ],
    y: Annotated[
        str | None, typer.Option(metavar="KEY=FROM:TO:COUNT", help="Second axis: one row of the map for each value.")
    ] = None,
    p: Changes = None,
    runs: Runs = "up,down,near,far",
    output: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Plant output to evaluate. Default: the first output of the plant."),
    ] = None,
    longest: Longest = None,
    workers: Workers = None,
    eigenvalues: Annotated[
        bool,
        typer.Option(
            "--eigenvalues", help="Simulate nothing: find where sliding is unstable, by eigenvalues, over both axes."
        ),
    ] = False,
    boundaries: Annotated[
        bool,
        typer.Option("--curves", help="Draw the curves of Hopf, fold and grazing points over the map (rig branches)."),
    ] = False,
    out: Results = Path("maps"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Map the steady-state behaviour over one or two parameters: sliding, stick-slip, or both.

    One axis gives a bifurcation diagram. Results are kept: after an
    interruption the same command continues. --force draws a finished map again.
    """
    from rig.analysis import branches
    from rig.analysis.map import Map, chart, job, regions_job, store_of

    loaded = the_scene(scene, changes(p))
    printing.warnings(loaded)
    if eigenvalues:
        todo = regions_job(loaded, x, y)
        name = "regions"
    else:
        todo = job(loaded, x, y, output, tuple(separated(runs)), seconds(longest, "--longest"))
        name = "map"
    if not todo.dithered:
        idle(loaded, todo.x, todo.y)
    store = store_of(todo, out)
    refuse(store.folder, (f"{name}.csv", f"{name}.png"), force)
    if boundaries and (todo.y is None or todo.dithered or eigenvalues):
        raise UsageError("--curves: needs a simulated map over two parameters, --x and --y")
    with printing.kept(store, "parts", len(todo.units)), printing.bar("rows" if y else "parts") as progress:
        result = chart(todo, out, workers, progress)
    if not boundaries:
        written(result, store.folder, name, as_json)
        return
    assert isinstance(result, Map)
    assert todo.y is not None
    along = branches.job(loaded, f"{x.rpartition(':')[0]}", output)
    with (
        printing.kept(branches.curves_store(along, todo.y, out), "parts of curves"),
        printing.bar("points") as progress,
    ):
        lines = branches.curves(along, todo.y, out, progress)
    written(result, store.folder, name, as_json, lines.over(result), curves=lines.to_json()["curves"])
    if not as_json:
        printing.line(f"\n{lines.text()}")


def branches(
    scene: SceneName,
    over: Annotated[
        str,
        typer.Option(metavar="KEY=FROM:TO", help='Parameter and its range: "drive.speed=0.05 m/s:0.8 m/s".'),
    ],
    p: Changes = None,
    start: Annotated[
        str,
        typer.Option(
            metavar="LIST",
            help="What branches of cycles begin from: hopf (Hopf points of sliding), simulation (limit cycles in the "
            "middle and at the ends of the range), a value to simulate at, the folder of a map, a recording.",
        ),
    ] = "hopf,simulation",
    output: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Plant output of the figure. Default: the first output of the plant."),
    ] = None,
    second: Annotated[
        str | None,
        typer.Option(
            metavar="KEY=FROM:TO:COUNT", help="Second parameter: curves of the special points over both, not branches."
        ),
    ] = None,
    threshold: Annotated[
        str | None,
        typer.Option(
            metavar="VALUE", help="Least knocks from sliding to stick-slip and back at this value of the parameter."
        ),
    ] = None,
    knock: Annotated[
        str,
        typer.Option(
            metavar="PULSE", help='With --threshold: a pulse of an actuator, "load.force 20 ms", not an impulse.'
        ),
    ] = "",
    alone: Annotated[
        bool, typer.Option("--plant-alone", help="With --threshold: leave out the controllers of the scene.")
    ] = False,
    starts: Annotated[
        str | None,
        typer.Option(
            metavar="LIST",
            help='With --threshold: share of starts that come to slide, "x=-2:2, x\'=0:2" (SI, uniform).',
        ),
    ] = None,
    points: Annotated[int, typer.Option(min=2, max=100_000, help="Most points of a branch of cycles.")] = 400,
    out: Results = Path("branches"),
    figure: Figure = None,
    page: Page = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Follow stable and unstable motions over a parameter: where they begin, turn and end.

    Steady sliding and limit cycles with any sequence of stick, slip, lift-off
    and landing. Results are kept: after an interruption the same command
    continues. --force draws finished branches again.
    """
    from rig.analysis.branches import (
        Branches,
        Curves,
        Threshold,
        curves,
        curves_store,
        job,
        refuse_controllers,
        store_of,
    )
    from rig.analysis.branches import branches as follow
    from rig.scenes.axis import axes

    refuse_all(
        (
            threshold is None and (knock or starts or alone),
            "--knock, --starts and --plant-alone belong to --threshold VALUE",
        ),
        (threshold and second, "--threshold needs branches; leave out --second"),
    )
    loaded = the_scene(scene, changes(p))
    printing.warnings(loaded)
    if threshold:
        refuse_controllers(loaded, alone)
    todo = job(loaded, over, output, tuple(separated(start)), points)
    along = next(iter(axes(loaded, {"--second": second})), None)
    name = "curves" if along else "branches"
    store = curves_store(todo, along, out) if along else store_of(todo, out)
    refuse(store.folder, (f"{name}.csv", f"{name}.png"), force)
    followed: Branches | Curves
    edge: Threshold | None = None
    with printing.kept(store, "parts of curves" if along else "branches"):
        if along:
            with printing.bar("points") as progress:
                followed = curves(todo, along, out, progress)
        else:
            with printing.status() as show:
                followed = follow(todo, out, show)
                if threshold:
                    edge = Threshold.parse(followed, threshold, starts, knock, alone)
    more = {"threshold": edge.to_json()} if edge else {}
    written(followed, store.folder, name, as_json, **more)
    draw(followed, figure)
    _put(followed, f"Branches of {loaded.title or loaded.name}", page)
    if edge and not as_json:
        printing.line(f"\n{edge.text()}")


def written(result: Any, folder: Path, name: str, as_json: bool, figure: Any = None, **more: Any) -> None:
    """Print a result that has a folder, as JSON with `more`; write its table and its figure as `name` there."""
    from rig.machine.files import write_file
    from rig.view.palette import put

    printing.result(result, as_json, folder=str(folder), **more)
    if not as_json:
        printing.line(f"\n{folder}/{name}.png, {name}.csv")
    write_file(folder / f"{name}.csv", result.csv().encode())
    put(figure or result.plot(), folder / f"{name}.png")


def idle(scene: Scene, *axes: Axis | None) -> None:
    """Warn of parameters of effects that are off."""
    for why in filter(None, (axis.idle(scene) for axis in axes if axis)):
        printing.note(f"warning: {why}")


COMMANDS = {
    "modes": (modes, 'rig modes belt --sweep "drive.speed=0.05 m/s:0.4 m/s:50" --figure locus.png'),
    "cycle": (cycle, 'rig cycle two_dof -p friction.mu=0.45 --longest "10 min"'),
    "branches": (branches, 'rig branches belt --over "drive.speed=0.05 m/s:0.8 m/s"'),
    "identify": (identify, "rig identify belt --runs runs.toml --out mine.toml --figure fit.png"),
    "loop": (loop, "rig loop belt_normal_force --figure loop.png"),
    "map": (map_, 'rig map belt --x "drive.speed=0.05 m/s:0.8 m/s:40" --y "load.force=10 N:30 N:5"'),
}
