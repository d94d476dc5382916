"""Commands that analyse a rig without running its protocol: modes, cycle, identify, loop, map."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import rig
from rig.cli import printing
from rig.cli.build import Answer, Made
from rig.cli.options import Net, refuse_all
from rig.cli.printing import new, refuse
from rig.errors import ExitCode, SceneError, UsageError
from rig.parameters import Option

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rig.analysis.branches import Branches, Curves, Threshold
    from rig.analysis.linear.loop_report import LoopReport
    from rig.analysis.linear.sweep import Sweep
    from rig.scenes.axis import Axis
    from rig.scenes.scene import Scene


def modes(
    scene: Scene,
    controller: str,
    along: Annotated[
        str | None,
        Option(
            "KEY=A:B:N",
            'Compute eigenvalues over a parameter, and critical values: "drive.speed=0.05 m/s:0.4 m/s:50".',
            "--sweep",
        ),
    ] = None,
    shapes: Annotated[
        Path | None,
        Option("FILE", "Mode shapes on the nodes of a structure, moving: GIF, or RRD for rerun.", check=new),
    ] = None,
) -> Answer:
    """Compute eigenvalues and eigenmodes at steady sliding, open or closed loop, also over a parameter (--sweep)."""
    if along is None and not controller:
        from rig.analysis.linear.modes import modes as solve

        solved = solve(scene)
        if shapes is not None:
            from rig.analysis.linear.mode_shapes import write

            write(solved, shapes)
        errors = [finding for finding in solved.findings if finding.level == "error"]
        if not errors or scene.clock.unstable == "run":
            return Answer(solved)
        more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
        refused = (
            f"{scene.name}: a run is refused{more}: {errors[0].what}\n  {errors[0].remedy}\n"
            '  clock.unstable = "run" runs it nevertheless, up to clock.limit'
        )
        return Answer(solved, notes=[refused], code=ExitCode.STOPPED)
    if shapes is not None:
        raise UsageError("--shapes: needs the modes of one scene; leave --sweep and --controller out")
    printing.warnings(scene)
    if along is not None:
        return Answer(_swept(scene, along, controller))
    from rig.analysis.linear.control_loop import loop

    return Answer(loop(scene, controller))


def _swept(scene: Scene, along: str, controller: str) -> Sweep:
    from rig.analysis.linear.control_loop import loop, sweep_loop
    from rig.analysis.linear.modes import dithers
    from rig.analysis.linear.sweep import sweep
    from rig.scenes.axis import axes

    faults: list[str] = []
    if controller:
        try:
            loop(scene, controller)
        except SceneError as error:
            faults += error.faults
    try:
        [axis] = axes(scene, {"--sweep": along}, controller)
    except SceneError as error:
        faults += error.faults
    if faults:
        raise SceneError(scene.name, faults)
    if controller or not dithers(scene, axis.key):
        idle(scene, axis)
    return sweep_loop(scene, axis, controller) if controller else sweep(scene, axis)


def cycle(scene: Scene, longest: float | None) -> Answer:
    """Find the limit cycle: period, time in stick, extremes, energy per period, Floquet multipliers.

    The plant runs alone: actuators are held, no controller acts, no sensor
    measures.

    Exit code 1: undecided within the longest time.
    """
    from rig.analysis.cycles.cycle import limit_cycle

    printing.warnings(scene)
    with printing.status() as show:

        def watch(now: float, drift: float) -> None:
            agree = f", successive periods agree to {drift:.0e} of a period" if math.isfinite(drift) else ""
            show(f"{now:.3g} s simulated{agree}")

        motion = limit_cycle(scene, longest=longest, watch=watch)
    return Answer(motion, motion.decided)


def identify(
    scene: Scene,
    scene_name: str,
    next: str | None,
    workers: int | None,
    runs: Path | None = None,
    folder: Path = Path("fits"),
    out: Annotated[Path | None, Option("FILE", "Write a scene (TOML) and its covariance (JSON).", check=new)] = None,
) -> Answer:
    """Fit parameters of a rig to recordings: value, interval, and a verdict for each.

    Without --runs: run an experiment of the lever rig and evaluate it. Scenes with
    an experiment: lever_free_cylinder, lever_free_lever, lever_static_friction,
    lever_kinetic_friction.

    Evaluations are kept: after an interruption the same command continues. Exit code
    1: no law fits, or a parameter cannot be identified.
    """
    title = f"Parameters of {scene.title or scene.name}"
    if runs is None:
        from rig.analysis.identification.lever import experiment

        if next is not None or out is not None:
            raise UsageError("--next and --out need recordings: --runs FILE")
        evaluated = experiment(scene)
        return Answer(evaluated, evaluated.complete, title=title)
    from rig.analysis.identification.identify import identify as fit
    from rig.analysis.identification.identify import usual
    from rig.analysis.identification.next_experiment import asked, propose, settings_of
    from rig.analysis.identification.runs import prepared
    from rig.analysis.identification.written import write

    settings = None if next is None else asked(next)
    if settings is not None:
        settings_of(scene, settings)  # a fit takes minutes
    task = prepared(scene, runs)
    refused: list[UsageError] = []
    try:
        with printing.status() as show:
            progress_words = printing.about("cycles", usual(task))
            fitted = fit(task, folder, workers, lambda done: show(progress_words(done)))
        if settings is not None:
            try:
                with printing.bar("settings") as progress:
                    fitted = propose(fitted, settings, workers, progress)
            except UsageError as fault:  # the fit took minutes: its report comes first
                refused = [fault]
    except KeyboardInterrupt:
        printing.note(f"interrupted: finished cycles are kept in {folder}; the same command continues from there")
        raise
    more: dict[str, object] = {}
    told = []
    if out is not None and fitted.told:
        written_, beside = write(fitted, out, scene_name)
        more = {"scene_file": written_, "covariance": beside}
        told = [f"\n{out}, {beside}"]
    elif out is not None:
        told = [f"\n{out} is not written: no parameter is identified"]

    def then() -> Iterator[str]:
        yield from told
        for fault in refused:
            raise fault

    return Answer(fitted, fitted.complete, more, title=title, then=then)


def loop(
    scene: Scene,
    net: Net = None,
    controller: str = "",
    measure: Annotated[
        bool, Option("", "Measure the time over the bus on this machine, as rig tool doctor does (1 s).")
    ] = False,
) -> LoopReport:
    """Report on a control loop: delay budget, margins, and decay rate over delay, jitter and loss of its link.

    The loop is linearised about steady sliding. One point is checked by
    simulations: that of the scene's own links, or one that is chosen.
    """
    from rig.analysis.linear.loop_report import report

    if not controller and len(scene.controllers) != 1:
        known = ", ".join(scene.controllers) or "none"
        raise UsageError(f"{scene.name}: name the controller of the loop with --controller; there are: {known}")
    printing.warnings(scene)
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
        return report(scene, controller or next(iter(scene.controllers)), bus, progress)


def map_(
    scene: Scene,
    x: str,
    y: str | None,
    output: str | None,
    runs: tuple[str, ...],
    longest: float | None,
    workers: int | None,
    out: Path,
    force: bool,
    eigenvalues: Annotated[
        bool, Option("", "Simulate nothing: find where sliding is unstable, by eigenvalues, over both axes.")
    ] = False,
    boundaries: Annotated[
        bool, Option("", "Draw the curves of Hopf, fold and grazing points over the map (rig branches).", "--curves")
    ] = False,
) -> Answer:
    """Map the steady-state behaviour over one or two parameters: sliding, stick-slip, or both.

    One axis gives a bifurcation diagram. Results are kept: after an
    interruption the same command continues. --force draws a finished map again.
    """
    from rig.analysis import branches
    from rig.analysis.map import chart, job, regions_job, store_of

    printing.warnings(scene)
    if eigenvalues:
        todo = regions_job(scene, x, y)
        name = "regions"
    else:
        todo = job(scene, x, y, output, runs, longest)
        name = "map"
    if not todo.dithered:
        idle(scene, todo.x, todo.y)
    store = store_of(todo, out)
    refuse(store.folder, (f"{name}.csv", f"{name}.png"), force)
    if boundaries and (todo.y is None or todo.dithered or eigenvalues):
        raise UsageError("--curves: needs a simulated map over two parameters, --x and --y")
    with printing.kept(store, "parts", len(todo.units)), printing.bar("rows" if y else "parts") as progress:
        result: Any = chart(todo, out, workers, progress)
    if not boundaries:
        return in_folder(result, store.folder, name)
    assert todo.y is not None
    along = branches.job(scene, f"{x.rpartition(':')[0]}", output)
    with (
        printing.kept(branches.curves_store(along, todo.y, out), "parts of curves"),
        printing.bar("points") as progress,
    ):
        lines = branches.curves(along, todo.y, out, progress)
    more = {"curves": lines.to_json()["curves"]}
    return in_folder(result, store.folder, name, more, [f"\n{lines.text()}"], plot=lambda: lines.over(result))


def branches(
    scene: Scene,
    over: str,
    start: tuple[str, ...],
    output: str | None,
    second: str | None,
    points: int,
    out: Path,
    force: bool,
    threshold: Annotated[
        str | None, Option("VALUE", "Least knocks from sliding to stick-slip and back at this value of the parameter.")
    ] = None,
    knock: Annotated[
        str, Option("PULSE", 'With --threshold: a pulse of an actuator, "load.force 20 ms", not an impulse.')
    ] = "",
    alone: Annotated[
        bool, Option("", "With --threshold: leave out the controllers of the scene.", "--plant-alone")
    ] = False,
    starts: Annotated[
        str | None,
        Option("RANGES", 'With --threshold: share of starts that come to slide, "x=-2:2, x\'=0:2" (SI, uniform).'),
    ] = None,
) -> Answer:
    """Follow stable and unstable motions over a parameter: where they begin, turn and end.

    Steady sliding and limit cycles with any sequence of stick, slip, lift-off
    and landing. Results are kept: after an interruption the same command
    continues. --force draws finished branches again.
    """
    from rig.analysis.branches import Asked, curves, curves_store, job, store_of
    from rig.analysis.branches import branches as follow
    from rig.scenes.axis import axes

    refuse_all(
        (
            threshold is None and (knock or starts or alone),
            "--knock, --starts and --plant-alone belong to --threshold VALUE",
        ),
        (threshold and second, "--threshold needs branches; leave out --second"),
    )
    printing.warnings(scene)
    todo = job(scene, over, output, start, points)
    asked = Asked.parse(todo, threshold, starts, knock, alone) if threshold else None
    along = next(iter(axes(scene, {"--second": second})), None)
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
                if asked:
                    edge = asked.of(followed)
    more = {"threshold": edge.to_json()} if edge else {}
    title = f"Branches of {scene.title or scene.name}"
    return in_folder(followed, store.folder, name, more, [f"\n{edge.text()}"] if edge else [], title=title)


def in_folder(
    result: Any,
    folder: Path,
    name: str,
    more: Mapping[str, object] | None = None,
    below: Iterable[str] = (),
    plot: Callable[[], Figure] | None = None,
    **how: Any,
) -> Answer:
    """Return the answer with a result whose table and figure are written as `name` to its folder.

    `more`: of its JSON. `below`: printed below its text. `plot`: draws the figure, if it is not that of the result.
    """
    from rig.machine.files import write_file
    from rig.view.palette import put

    def then() -> Iterator[str]:
        yield f"\n{folder}/{name}.png, {name}.csv"
        write_file(folder / f"{name}.csv", result.csv().encode())
        put((plot or result.plot)(), folder / f"{name}.png")
        yield from below

    return Answer(result, more={"folder": str(folder), **(more or {})}, then=then, **how)


def idle(scene: Scene, *axes: Axis | None) -> None:
    """Warn of parameters of effects that are off."""
    for why in filter(None, (axis.idle(scene) for axis in axes if axis)):
        printing.note(f"warning: {why}")


COMMANDS = {
    "modes": Made(
        modes, 'rig modes belt --sweep "drive.speed=0.05 m/s:0.4 m/s:50" --figure locus.png', rig.sweep, "figure"
    ),
    "cycle": Made(cycle, 'rig cycle two_dof -p friction.mu=0.45 --longest "10 min"', rig.limit_cycle, "figure"),
    "branches": Made(branches, 'rig branches belt --over "drive.speed=0.05 m/s:0.8 m/s"', rig.branches, "figure page"),
    "identify": Made(
        identify, "rig identify belt --runs runs.toml --out mine.toml --figure fit.png", rig.identify, "figure page"
    ),
    "loop": Made(loop, "rig loop belt_normal_force --figure loop.png", rig.loop, "figure"),
    "map": Made(map_, 'rig map belt --x "drive.speed=0.05 m/s:0.8 m/s:40" --y "load.force=10 N:30 N:5"', rig.map),
}
