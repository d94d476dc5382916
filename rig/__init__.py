"""friction-rig: a laboratory in software for friction-induced vibration.

    import rig
    run = rig.simulate(rig.load("belt", {"friction.mu_static": "0.45"}), duration=10.0)
    run.time, run.signals["velocity"], run.units["velocity"]

Functions that take a scene take its name or file too, and then `overrides`, which change it as those of `load` do;
`untold` and `redesign` say what its controllers know of the rig (docs/belief.md).

model       a rig as rows by name, matrices, mode sets and tables
solve       compiled code: everything that runs in every tick
stability   eigenvalues and checks before a run
motion      a rig in motion: state and time, advanced by compiled code
effects     one file, one physical effect
plants      the rigs, one file each
sensors     instruments: a physical quantity in, sampled measurements out
controllers separate processes that receive measurements and send commands
scenes      a plant, its effects, sensors, controllers and protocol, as TOML
design      plant matrices in, controller numbers out
bus         how processes exchange messages
bench       runs a rig: in one process, in lockstep, paced
record      MCAP: write, read, recover, replay, compare
view        figures and rerun
analysis    analyses of a rig
gym         rigs as environments of Gymnasium
plant_fmu   scenes as FMUs
qualify     tests of the simulator: cost, torture
papers      the figures of the papers, reproduced
lessons     lessons of half an hour
web         the bench as a page in the browser
cli         the commands
parameters  how the commands show a parameter: stated with the functions below, which are the Python API
"""

from __future__ import annotations

TYPE_CHECKING = False  # as typing has it; nothing is imported here: every command begins with it, and a Ctrl-C may come
if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping
    from pathlib import Path
    from typing import Annotated, Any

    from control import StateSpace

    from rig.analysis.branches import Branches, Curves, Start
    from rig.analysis.cycles.cycle_report import Cycle
    from rig.analysis.identification.answer import Identified
    from rig.analysis.linear.control_loop import Loop
    from rig.analysis.linear.modes_report import Modes
    from rig.analysis.linear.sweep import Sweep
    from rig.analysis.map import Boundary, Map
    from rig.analysis.recorded.against_scene import AgainstScene
    from rig.analysis.recorded.comparison import Compared
    from rig.analysis.recorded.events import Events
    from rig.analysis.robust.result import RobustResult
    from rig.analysis.studies import StudyResult
    from rig.analysis.studies.factors import Distribution
    from rig.analysis.studies.search import SearchResult
    from rig.parameters import (
        Begin,
        Channel,
        Cluster,
        Controllers,
        Duration,
        End,
        Log,
        Option,
        Overrides,
        Redesign,
        Results,
        SceneOrName,
        Seed,
        Trust,
        Untold,
        Workers,
        controller_option,
    )
    from rig.record.imports.import_run import Imported
    from rig.record.run import Run
    from rig.scenes.scene import Scene

__all__ = [
    "branches",
    "diff",
    "events",
    "fork",
    "identify",
    "import_",
    "limit_cycle",
    "load",
    "lognormal",
    "loop",
    "map",
    "modes",
    "normal",
    "open",
    "optimise",
    "report",
    "simulate",
    "state_space",
    "study",
    "sweep",
    "triangular",
    "uniform",
]


def load(scene: str | Path, overrides: Mapping[str, object] | None = None) -> Scene:
    """Load a shipped scene by name, or a scene file; `overrides`: dotted keys to values with units.

    Values that an override makes meaningless (those of a kind that it changed) are left out and reported by `logging`.
    Raises rig.errors.SceneError with every fault of the scene.
    """
    from rig import scenes

    loaded = scenes.load(str(scene), overrides or {})
    for note in loaded.notes:
        _warn(note)
    return loaded


def _scene(
    scene: Scene | str | Path,
    overrides: Mapping[str, object] | None = None,
    untold: Mapping[str, object] | None = None,
    redesign: bool = False,
) -> Scene:
    """A scene that is loaded, or named, with `overrides`, as `load` does. Raises UsageError for anything else.

    `untold`, `redesign`: what its controllers believe of the rig (rig.scenes.belief).
    """
    from rig.scenes.belief import believing
    from rig.scenes.loader import loaded

    made = loaded(scene, overrides)
    for note in made.notes if made is not scene else ():
        _warn(note)
    return believing(made, untold or {}, redesign)


def _run(run: object) -> Run:
    """A run. Raises UsageError for anything else, such as the path of a recording."""
    from rig.errors import UsageError
    from rig.record.run import Run

    if isinstance(run, Run):
        return run
    raise UsageError(f"{run!r:.60} is no run; give what rig.open or rig.simulate returns")


def simulate(
    scene: SceneOrName,
    duration: Duration = None,
    stop: Callable[[], str] | None = None,
    controllers: Annotated[Mapping[str, Any] | None, Controllers] = None,
    untold: Untold = None,
    *,
    overrides: Overrides = None,
) -> Run:
    """Run a scene in this process, with its controllers, for `duration` seconds or as long as its protocol takes.

    `controllers`: additional controllers by name. Each is an object with the attributes of a controller (docs/own.md),
    a discrete system of python-control with named inputs (sensors) and outputs (actuators, `_` for the dot), or, for a
    scene given by name, the path of a file as `rig simulate --controller` takes it. A controller of the scene with the
    same name is replaced; its delay is kept. `stop` is called ten times per simulated second: "" continues the run, any
    other text ends it and is the reason. The run has its provenance (versions, machine, command), which `Run.save`
    writes.

    Raises rig.errors.SceneError for controllers that cannot be designed or do not fit the scene, UsageError for objects
    that are not controllers and for a scene without an end, ControllerFailed for an exception of a controller; the
    attribute `run` of this error is the run up to there.
    """
    from pathlib import Path

    from rig.bench.run.local_controllers import divided, placed
    from rig.bench.run.simulate import simulate as run
    from rig.quantities import run_length_ns
    from rig.record.provenance import provenance

    files, objects = divided(controllers or {}, isinstance(scene, str | Path))
    loaded, guests = placed(_scene(scene, {**(overrides or {}), **files}, untold), objects)
    result = run(loaded, duration_ns=run_length_ns(duration), stop=stop, guests=guests, boards=True)
    result.provenance = provenance(loaded.seed)
    return result.checked()


def fork(
    log: str | Path,
    at: float | None = None,
    overrides: Mapping[str, object] | None = None,
    duration: float | None = None,
    stop: Callable[[], str] | None = None,
    *,
    recorded: bool = False,
) -> Run:
    """Continue a recording from `at` [s] (None: its end) with other values, for `duration` [s] or its protocol.

    The recording is simulated again up to `at`, and its samples must repeat; the run contains this history too.
    `overrides`: dotted keys of the rig and of its controllers, values with units; they take effect at `at`.
    `recorded`: a controller on a board (docs/device.md) commands what it has commanded in the recording, up to its end;
    without it such a recording cannot be continued. Raises
    rig.errors.UsageError for values that are fixed while a rig runs and for an instant outside of the recording,
    LogError for a recording that does not repeat on this machine, ControllerFailed as `simulate` does.
    """
    from pathlib import Path

    from rig.bench.again.fork import fork as go_on
    from rig.quantities import run_length_ns

    return go_on(Path(log), at, overrides, run_length_ns(duration), stop, recorded).checked()


def diff(
    first: Run,
    second: Run | Scene | str | Path,
    tolerance: Annotated[
        float,
        Option("REL", "Allowed deviation: 1e-6 of the range of each channel, or, of a scene, 0.1 of each measure."),
    ] = 0.0,
    begin: Begin = 0.0,
    end: End = float("inf"),
    *,
    follow: Annotated[
        Mapping[str, str] | None,
        Option(
            '"ACTUATOR = CHANNEL"',
            "What an actuator of the scene follows. Repeatable. Default: speed and load, by their names.",
        ),
    ] = None,
    pair: Annotated[
        Mapping[str, str] | None,
        Option(
            '"CHANNEL = SIMULATED, FACTOR"',
            'What a measured channel is compared with: "force = displacement, 168 N/m". Repeatable. Default: equal '
            "names.",
        ),
    ] = None,
    stick: Mapping[str, Any] | None = None,
    overrides: Overrides = None,
) -> Compared | AgainstScene:
    """Compare two runs, or a measurement with its simulation by a scene, from `begin` to `end` [s].

    Two runs: scenes, channels, and measures such as period and amplitude. A scene runs under the measured speed and
    load; `stick`: arguments of `rig.analysis.recorded.stick_slip`, for stick and motion times. Raises
    rig.errors.UsageError for runs without a common time, and for channels that cannot be followed or compared.
    """
    from rig.errors import UsageError
    from rig.record.run import Run

    measured = _run(first)
    if isinstance(second, Run):
        from rig.analysis.recorded.comparison import compare

        if overrides:
            raise UsageError(f"overrides {', '.join(overrides)}: change a scene; the second one is a run")
        return compare(measured, second, begin, end, tolerance)
    from rig.analysis.recorded.against_scene import against_scene

    return against_scene(measured, _scene(second, overrides), begin, end, follow, pair, stick)


def events(
    run: Run,
    signal: Channel = "",
    at: Annotated[
        Iterable[str] | None,
        Option(
            "NAMES",
            "Channels whose means during the growth are listed. Default: speed of the drive, load, temperature.",
        ),
    ] = None,
    window: Annotated[
        float, Option("TIME", "Length of the windows. Default: 40 ms, or eight periods of the strongest tone.")
    ] = 0.0,
    begin: Begin = 0.0,
    end: End = float("inf"),
    over: Annotated[
        Scene | str | Path | None, Option("SCENE", "Scene whose eigenvalues over --key are compared with the events.")
    ] = None,
    key: Annotated[str, Option("KEY", "Key of that scene: drive.speed (default), load.force.")] = "",
    *,
    overrides: Overrides = None,
) -> Events:
    """Find the vibration events of a channel from `begin` to `end` [s], measured or simulated.

    Each has begin, end, frequency, level, growth rate with an interval of 90 %, and means of the channels `at` during
    the growth. `overrides`: as for `load`, of the scene `over`. Raises UsageError and SceneError.
    """
    from rig.analysis.recorded.events import events as find
    from rig.errors import UsageError

    if over is None and overrides:
        raise UsageError(f"overrides {', '.join(overrides)}: change the scene of `over`, which is not given")
    scene = None if over is None else _scene(over, overrides)
    return find(_run(run), signal, None if at is None else list(at), window, begin, end, scene, key)


def modes(scene: SceneOrName, *, overrides: Overrides = None) -> Modes:
    """Compute growth rates, frequencies, damping ratios and shapes of the vibration modes about steady sliding."""
    from rig.analysis.linear.modes import modes as solve

    return solve(_scene(scene, overrides))


def sweep(
    scene: SceneOrName,
    key: str,
    values: Iterable[float],
    controller: Annotated[
        str, controller_option("Close the loop of this controller: eigenvalues, gain, phase and delay margins.")
    ] = "",
    *,
    overrides: Overrides = None,
    untold: Untold = None,
    redesign: Redesign = False,
) -> Sweep:
    """Compute eigenvalues about steady sliding over a parameter of the rig, `values` in SI, and the critical values.

    With `controller`, these are those of its closed loop; the key may then be one of the controller
    (controllers.NAME.gain). The controller keeps the numbers that it has for the scene; it is told only set-points
    (speed of the drive, load) and with `redesign` every value. Raises rig.errors.SceneError for a key that is not a
    number of the rig and for values that the scene cannot have.
    """
    from rig.analysis.linear.control_loop import sweep_loop
    from rig.analysis.linear.sweep import sweep as solve
    from rig.scenes.axis import Axis

    loaded = _scene(scene, overrides, untold, redesign)
    axis = Axis.of(key, values, loaded, controller)
    return sweep_loop(loaded, axis, controller) if controller else solve(loaded, axis)


def loop(
    scene: SceneOrName,
    controller: Annotated[str, controller_option("Controller of the loop. Default: the only one of the scene.")],
    *,
    overrides: Overrides = None,
    untold: Untold = None,
) -> Loop:
    """Analyse a closed loop about steady sliding: eigenvalues, range of gains, margins of phase and delay.

    Raises rig.errors.SceneError for a controller that is not a linear feedback and where nothing slides steadily.
    """
    from rig.analysis.linear.control_loop import loop as solve

    return solve(_scene(scene, overrides, untold), controller)


def state_space(scene: SceneOrName, delay: float = 0.0, *, overrides: Overrides = None) -> StateSpace:
    """Linearise the rig about steady sliding: python-control's StateSpace from its actuators to its outputs.

    `delay` [s]: delay of the commands, as a Pade approximation of order 8. Raises rig.errors.SceneError where nothing
    slides steadily.
    """
    from rig.analysis.linear.control_loop import state_space as solve

    return solve(_scene(scene, overrides), delay)


def limit_cycle(
    scene: SceneOrName,
    longest: Annotated[
        float | None, Option("TIME", "Simulated time within which the motion must settle. Default: 120 s.")
    ] = None,
    *,
    overrides: Overrides = None,
) -> Cycle:
    """Find the limit cycle at constant actuator values: period, stick time, extremes, energy, Floquet multipliers.

    If it does not settle within `longest` [s], `decided` is false. Raises rig.errors.NumericsError if the integration
    has to stop.
    """
    from rig.analysis.cycles.cycle import limit_cycle as search

    return search(_scene(scene, overrides), longest=longest)


def branches(
    scene: SceneOrName,
    over: Annotated[str, Option("KEY=FROM:TO", 'Parameter and its range: "drive.speed=0.05 m/s:0.8 m/s".')],
    *,
    output: Annotated[
        str | None, Option("NAME", "Plant output of the figure. Default: the first output of the plant.")
    ] = None,
    start: Annotated[
        Iterable[str | float | Run | Map | Start],
        Option(
            "LIST",
            "What branches of cycles begin from: hopf (Hopf points of sliding), simulation (limit cycles in the middle "
            "and at the ends of the range), a value to simulate at, the folder of a map, a recording.",
        ),
    ] = ("hopf", "simulation"),
    points: Annotated[int, Option("N", "Most points of a branch of cycles.", low=2, high=100_000)] = 400,
    second: Annotated[
        str | None,
        Option("KEY=FROM:TO:COUNT", "Second parameter: curves of the special points over both, not branches."),
    ] = None,
    out: Results = "branches",
    overrides: Overrides = None,
) -> Branches | Curves:
    """Follow stable and unstable motions over a parameter: `rig.branches("belt", "drive.speed=0.05 m/s:0.8 m/s")`.

    Steady sliding and cycles with any sequence of events, with Floquet multipliers, and their special points: Hopf,
    fold, grazing, period doubling, torus, lift-off, landing, begin and end of stick, jump, canard. `start`: a map and a
    recording may be the results of `map` and of `open`. With `second` the result is the curves of the special points
    over both, the boundaries of sliding, stick-slip and both. An interrupted computation goes on from its last point.
    Raises rig.errors.SceneError and UsageError.
    """
    from pathlib import Path

    from rig.analysis.branches import branches as follow
    from rig.analysis.branches import curves, job
    from rig.scenes.axis import Axis

    loaded = _scene(scene, overrides)
    todo = job(loaded, over, output, tuple(start), points)
    root = Path(out)
    return follow(todo, root) if second is None else curves(todo, Axis.parse(second, loaded), root)


def map(
    scene: SceneOrName,
    x: Annotated[
        str, Option("KEY=FROM:TO:COUNT", 'First axis, along which runs are continued: "drive.speed=1:8 rpm:36".')
    ],
    y: Annotated[str | None, Option("KEY=FROM:TO:COUNT", "Second axis: one row of the map for each value.")] = None,
    *,
    output: Annotated[
        str | None, Option("NAME", "Plant output to evaluate. Default: the first output of the plant.")
    ] = None,
    runs: Annotated[
        tuple[str, ...],
        Option(
            "LIST", "Runs: up, down (continued from point to point), near, far (start near to or far from sliding)."
        ),
    ] = ("up", "down", "near", "far"),
    longest: Annotated[
        float | None, Option("TIME", "Longest simulated time for one point. Default: at least 480 slow periods.")
    ] = None,
    out: Results = "maps",
    workers: Workers = None,
    overrides: Overrides = None,
) -> Map | Boundary:
    """Map the steady-state behaviour over one or two parameters: `rig.map("belt", "drive.speed=0.05:0.8:40")`.

    Over dither.frequency and dither.amplitude the map shows the boundary above which dither keeps the rig sliding,
    averaged and simulated. An interrupted map continues from its folder. Raises rig.errors.SceneError, UsageError, and
    WorkerError when a worker is lost.
    """
    from pathlib import Path

    from rig.analysis.map import chart, job

    loaded = _scene(scene, overrides)
    return chart(job(loaded, x, y, output, runs, longest), Path(out), workers)  # type: ignore[return-value]


def study(
    scene: SceneOrName,
    over: Annotated[
        Mapping[str, object],
        Option(
            "KEY=VALUES",
            'Vary a parameter: "load.force=10 N:30 N:5", "load.force=10, 20 N", '
            '"friction.mu_static=normal(0.4, 0.02)". Repeatable.',
        ),
    ],
    measure: Annotated[
        Iterable[str | Callable[[Run], object]],
        Option(
            "NAME", "Measure: cycle.amplitude, motion.period, run.rms, ..., or FILE.py:FUNCTION of a Run. Repeatable."
        ),
    ],
    *,
    samples: Annotated[int | None, Option("N", "Samples of the distributions. Default: 64.", low=1)] = None,
    sampling: Annotated[str, Option("HOW", "random, latin, sobol; saltelli for Sobol indices.")] = "random",
    repeat: Annotated[int, Option("N", "Runs of each point, with different seeds.", low=1)] = 1,
    seed: Seed = None,
    duration: Duration = None,
    keep: Annotated[
        str | None, Option("CONDITION", 'Keep recordings of the runs for which it holds: "cycle.amplitude > 5 mm".')
    ] = None,
    out: Results = "studies",
    workers: Workers = None,
    cluster: Cluster = "",
    overrides: Overrides = None,
    untold: Untold = None,
    redesign: Redesign = False,
) -> StudyResult:
    """Evaluate measures over parameters: `rig.study("belt", {"load.force": [10, 20, 30]}, ["cycle.amplitude"])`.

    `over`: dotted key -> values in SI or texts with units (a grid), "10 N:30 N:5", or a distribution such as
    rig.normal(0.4, 0.02). `measure`: names (docs/studies.md), or functions of a Run, which return a number, or a number
    and its unit. Point number k is run with the seed `seed` + k. `duration` [s] of a run: by default the length of its
    protocol. An interrupted study continues from its folder. Raises rig.errors.SceneError and UsageError with every
    fault, WorkerError if workers fail.
    """
    from pathlib import Path

    from rig.analysis.studies import prepared
    from rig.analysis.studies import study as carry_out
    from rig.analysis.studies.factors import check_once

    check_once(over, overrides, untold)
    loaded = _scene(scene, overrides, untold, redesign)
    work = prepared(loaded, over, measure, samples, sampling, repeat, seed, duration, keep)
    return carry_out(work, Path(out), workers, keep=keep, cluster=cluster)


def optimise(
    scene: SceneOrName,
    over: Annotated[
        Mapping[str, object] | None,
        Option("KEY=FROM:TO", 'Range of a parameter: "load.force=10 N:30 N". Repeatable.'),
    ] = None,
    minimise: Annotated[
        str | Callable[[Run], object] | None,
        Option("MEASURE", "Measure to minimise: a name as for rig study, or FILE.py:FUNCTION."),
    ] = None,
    *,
    maximise: Annotated[
        str | Callable[[Run], object] | None,
        Option("MEASURE", "Measure to maximise instead; with --against: tolerance or tolerance.KEY."),
    ] = None,
    against: Annotated[
        Mapping[str, object] | None,
        Option(
            "KEY=RANGE",
            'What is not known of the rig: "friction.mu=+-2 %", "load.force=18 N:22 N", "friction.mu=normal(0.4, 0.02)"'
            ". Of a parameter of --over: its tolerance. The worst rig counts. Repeatable.",
        ),
    ] = None,
    band: Annotated[
        str | tuple[float, float] | None,
        Option("FROM:TO", 'Frequencies of the modes that count, with --against: "2 kHz:5 kHz".'),
    ] = None,
    limit: Annotated[
        Iterable[str] | None,
        Option("SUM", 'Linear limit of a design, with --against: "c.damping + 2 * d.damping < 5 N*s/m". Repeatable.'),
    ] = None,
    decay: Annotated[
        float | str | None, Option("RATE", 'Least decay that a tolerance keeps: "5 1/s". Default: nothing grows.')
    ] = None,
    series: Annotated[
        str | None,
        Option("NAME", "Components of a series, with --against: E6, E12, E24, E48, E96 or E192. Default: any value."),
    ] = None,
    prove: Annotated[
        bool,
        Option(
            "",
            "With --against: prove that no rig of the box grows, or say what is left; run nominal and worst rig, and "
            "find the least knock from which they do not come back.",
        ),
    ] = False,
    evaluations: Annotated[int, Option("N", "Largest number of points.", low=1, high=1_000_000)] = 600,
    seed: Seed = None,
    duration: Duration = None,
    out: Results = "searches",
    workers: Workers = None,
    cluster: Cluster = "",
    overrides: Overrides = None,
    untold: Untold = None,
    redesign: Redesign = False,
) -> SearchResult | RobustResult:
    """Find the smallest value of a measure: `rig.optimise("belt", {"load.force": (10, 30)}, "cycle.amplitude")`.

    `over`: dotted key -> range in SI, or text such as "10 N:30 N". Points are computed by differential evolution, all
    with `seed`. A search that was interrupted, or one with more evaluations, continues from its folder. With `against`
    (docs/robust.md) the growth of the worst rig of a box is made small; without `over` it is that of the scene. Raises
    rig.errors.SceneError, UsageError and WorkerError.
    """
    from pathlib import Path

    from rig.analysis.studies.factors import check_once

    check_once(over, overrides, untold)
    loaded = _scene(scene, overrides, untold, redesign)
    if against is None and band is None and limit is None and decay is None and series is None and not prove:
        from rig.analysis.studies.search import prepared, search

        work = prepared(loaded, over or {}, minimise, maximise, evaluations, seed, duration)
        return search(work, Path(out), workers, cluster=cluster)
    from rig.analysis import robust

    job = robust.prepared(loaded, over or {}, against or {}, minimise, maximise, band, limit, decay, seed, series)
    return robust.designed(job, Path(out), workers, cluster=cluster, prove=prove)


def identify(
    scene: SceneOrName,
    runs: Annotated[
        str | Path | Iterable[Mapping[str, Any]],
        Option("FILE", "The recordings and what is free (TOML, see docs/identify.md)."),
    ],
    free: Mapping[str, object] | None = None,
    laws: Mapping[str, Mapping[str, object]] | Iterable[str] | None = None,
    *,
    per_run: Iterable[str] | None = None,
    next: Annotated[
        Mapping[str, object] | None,
        Option(
            "KEY=VALUES, ...",
            'Propose the next experiment among settings: "drive.speed=0.05 m/s:0.3 m/s:5, load.force=8 N, 16 N".',
        ),
    ] = None,
    starts: int | None = None,
    seed: int | None = None,
    folder: Annotated[
        str | Path | None, Option("FOLDER", "Folder in which evaluations are kept for a repetition.")
    ] = None,
    workers: Workers = None,
    overrides: Overrides = None,
) -> Identified:
    """Fit parameters of a scene to recordings: value, interval of 90 % and verdict for each.

    `runs`: a file, or its tables [[run]] as mappings, in which `run` may be a Run. `free`: dotted key -> range, "0.1:1"
    or (0.1, 1.0). `laws`: friction laws to compare, law -> ranges of its own keys. `per_run`: ["level"] gives each
    record an offset of its own. `next`: key -> values. `starts`: further starts near the values of the scene. An
    interrupted fit continues from `folder` (None: nothing is kept). Raises rig.errors.SceneError and UsageError with
    every fault, WorkerError if workers fail.
    """
    from pathlib import Path

    from rig.analysis.identification.identify import identify as fit
    from rig.analysis.identification.next_experiment import propose, settings_of
    from rig.analysis.identification.runs import prepared

    given = runs if isinstance(runs, str | Path) else [*runs]
    task = prepared(_scene(scene, overrides), given, free, laws, per_run, starts, seed)
    if next:
        settings_of(task.scene, next)
    identified = fit(task, None if folder is None else Path(folder), workers)
    return propose(identified, next, workers) if next else identified


def normal(
    mean: float | str, deviation: float | str, low: float | str | None = None, high: float | str | None = None
) -> Distribution:
    """A normal distribution for `rig.study`, in SI or as texts with units, cut off at `low` and `high`."""
    return _distribution("normal", mean=mean, deviation=deviation, low=low, high=high)


def lognormal(
    median: float | str, deviation: float, low: float | str | None = None, high: float | str | None = None
) -> Distribution:
    """A lognormal distribution for `rig.study`; `deviation`: standard deviation of the natural logarithm."""
    return _distribution("lognormal", median=median, deviation=deviation, low=low, high=high)


def uniform(low: float | str, high: float | str) -> Distribution:
    """A uniform distribution for `rig.study`, in SI or as texts with units."""
    return _distribution("uniform", low=low, high=high)


def triangular(low: float | str, mode: float | str, high: float | str) -> Distribution:
    """A triangular distribution for `rig.study` with its peak at `mode`, in SI or as texts with units."""
    return _distribution("triangular", low=low, mode=mode, high=high)


def _distribution(kind: str, **values: float | str | None) -> Distribution:
    from rig.analysis.studies.factors import made

    return made(kind, {name: value for name, value in values.items() if value is not None})


def open(path: str | Path, trust: bool = False) -> Run:
    """Read a recording as a Run. If it is cut off or damaged, a part is read and a warning is logged; see `Run.damage`.

    `trust`: let this process run the code of parts from files (a plant, a sensor) that the recording contains. Without
    it outputs, measurements and events are available; functions that need the code raise rig.errors.Untrusted. Raises
    rig.errors.LogError for a file that cannot be read or is not a recording, PartError for code that was changed.
    """
    from pathlib import Path

    from rig import parts
    from rig.record import reader

    run = reader.open(Path(path))
    if trust:
        parts.trust_scene(run.scene)
    for note in run.notes:
        _warn(f"{path}: {note}")
    return run


def import_(
    files: str | Path | Iterable[str | Path],
    out: str | Path,
    map: Annotated[
        Mapping[str, str],
        Option(
            '"COLUMN = NAME, SCALE UNIT"',
            'What a column is: "ch1 = vibrometer, 125 mm/s/V". Repeatable. Default: import.toml beside the files; '
            "without it the columns are listed, and a map is proposed.",
        ),
    ],
    time: Annotated[str, Option('"COLUMN, UNIT"', 'The column with the time: "t, ms".')] = "",
    rate: Annotated[str, Option("RATE", "Samples per second, in place of times: 2 kHz.")] = "",
    join: Annotated[
        str,
        Option(
            "CHANNEL",
            'The common time of several files: "trigger > 2 V", whose first sample is the same instant in all, or a '
            "channel that all contain.",
        ),
    ] = "",
    skip_missing: Annotated[bool, Option("", "Leave out values that are not there (empty, NaN).")] = False,
    force: bool = False,
) -> Imported:
    """Write the recording `out` of a measurement in `files` of a data acquisition system; several files are one run.

    `map`: column -> "NAME, SCALE UNIT". `force`: replace `out`. Raises rig.errors.UsageError with every fault of the
    files.
    """
    from pathlib import Path

    from rig.record.imports.channel_map import ChannelMap
    from rig.record.imports.import_run import import_files

    paths = [files] if isinstance(files, str | Path) else files
    given = ChannelMap(dict(map), time, rate)
    return import_files([Path(path) for path in paths], Path(out), given, join, skip_missing, force)


def report(
    log: Log,
    out: Annotated[
        str | Path | None, Option("FILE", "File to write (HTML). Default: NAME.html beside the recording.")
    ] = None,
    trust: Trust = False,
) -> Path:
    """Write a self-contained page (HTML) about a recording, and return its path.

    An existing page is replaced. For `trust` and damaged recordings see `open`. Raises rig.errors.LogError for
    a file that cannot be read or is not a recording, OutputError if the page cannot be written.
    """
    from pathlib import Path

    from rig.analysis.report.page import write

    recording = Path(log)
    page = recording.with_suffix(".html") if out is None else Path(out)
    write(open(recording, trust), recording, page)
    return page


def __getattr__(name: str) -> object:
    """`rig.gym` is imported where it is used: it needs gymnasium. `__version__` is that of the installed package."""
    if name == "__version__":
        from importlib.metadata import version

        return version("friction-rig")
    if name == "branch":
        raise AttributeError(
            "rig.branch is gone: rig.fork continues a recording, rig.branches follows motions over a parameter"
        )
    if name != "gym":
        raise AttributeError(f"module 'rig' has no attribute {name!r}")
    from importlib import import_module

    return import_module("rig.gym")


def _warn(text: str) -> None:
    """Write a line on standard error, unless the user has set up `logging` otherwise."""
    import logging

    logging.getLogger(__name__).warning("%s", text)
