"""friction-rig: a laboratory in software for friction-induced vibration.

    import rig
    run = rig.simulate(rig.load("belt", {"friction.mu_static": "0.45"}), duration=10.0)
    run.time, run.signals["velocity"], run.units["velocity"]

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
"""

from __future__ import annotations

TYPE_CHECKING = False  # as typing has it; nothing is imported here: every command begins with it, and a Ctrl-C may come
if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping
    from pathlib import Path
    from typing import Any

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
    from rig.analysis.studies import StudyResult
    from rig.analysis.studies.factors import Distribution
    from rig.analysis.studies.search import SearchResult
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
    scene: Scene | str | Path,
    duration: float | None = None,
    stop: Callable[[], str] | None = None,
    controllers: Mapping[str, Any] | None = None,
    untold: Mapping[str, object] | None = None,
    *,
    overrides: Mapping[str, object] | None = None,
) -> Run:
    """Run a scene in this process, with its controllers, for `duration` seconds or as long as its protocol takes.

    `controllers`: additional controllers by name. Each is an object with the attributes of a controller
    (docs/own.md), a discrete system of python-control with named inputs (sensors) and outputs (actuators,
    `_` for the dot), or, for a scene given by name, the path of a file as `rig simulate --controller` takes it. A
    controller of the scene with the same name is replaced; its delay is kept. `stop` is called ten times per simulated
    second: "" continues the run, any other text ends it and is the reason. `untold`: values of the rig, by dotted key,
    that the controllers do not know: they are designed without them (docs/belief.md). `overrides`: as for `load`, of a
    scene given by name or file. The run has its provenance (versions, machine, command), which `Run.save` writes.

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
    tolerance: float = 0.0,
    begin: float = 0.0,
    end: float = float("inf"),
    *,
    follow: Mapping[str, str] | None = None,
    pair: Mapping[str, str] | None = None,
    stick: Mapping[str, Any] | None = None,
    overrides: Mapping[str, object] | None = None,
) -> Compared | AgainstScene:
    """Compare two runs, or a measurement with its simulation by a scene, from `begin` to `end` [s].

    Two runs: scenes, channels, and measures such as period and amplitude. `tolerance`: allowed deviation of a channel,
    as a share of its range. A scene runs under the measured speed and load; then `follow` is actuator -> channel, by
    default by their names; `pair`: channel -> "SIMULATED" or "SIMULATED, FACTOR" ("displacement, 168 N/m"), by default
    equal names; `stick`: arguments of `rig.analysis.recorded.stick_slip`, for stick and motion times; `overrides`: of
    the scene, as for `load`. Raises rig.errors.UsageError for runs without a common time, and for channels that cannot
    be followed or compared.
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
    name: str = "",
    at: Iterable[str] | None = None,
    window: float = 0.0,
    first: float = 0.0,
    last: float = float("inf"),
    over: Scene | str | Path | None = None,
    key: str = "",
    *,
    overrides: Mapping[str, object] | None = None,
) -> Events:
    """Find the vibration events of a channel `name` from `first` to `last` [s], measured or simulated.

    Each has begin, end, frequency, level, growth rate with an interval of 90 %, and means of the channels `at` during
    the growth (default: speed of the drive, load, temperature). `window` [s]: default 40 ms, or eight periods. `over`:
    a scene, with `overrides` as for `load`, whose eigenvalues over `key` (drive.speed) are compared with them. Raises
    UsageError and SceneError.
    """
    from rig.analysis.recorded.events import events as find
    from rig.errors import UsageError

    if over is None and overrides:
        raise UsageError(f"overrides {', '.join(overrides)}: change the scene of `over`, which is not given")
    scene = None if over is None else _scene(over, overrides)
    return find(_run(run), name, None if at is None else list(at), window, first, last, scene, key)


def modes(scene: Scene | str | Path, *, overrides: Mapping[str, object] | None = None) -> Modes:
    """Compute growth rates, frequencies, damping ratios and shapes of the vibration modes about steady sliding.

    `overrides`: as for `load`, of a scene given by name or file.
    """
    from rig.analysis.linear.modes import modes as solve

    return solve(_scene(scene, overrides))


def sweep(
    scene: Scene | str | Path,
    key: str,
    values: Iterable[float],
    controller: str = "",
    *,
    overrides: Mapping[str, object] | None = None,
    untold: Mapping[str, object] | None = None,
    redesign: bool = False,
) -> Sweep:
    """Compute eigenvalues about steady sliding over a parameter of the rig, `values` in SI, and the critical values.

    With `controller`, these are those of its closed loop; the key may then be one of the controller
    (controllers.NAME.gain). The controller keeps the numbers that it has for the scene; it is told only set-points
    (speed of the drive, load) and with `redesign` every value. `overrides`, `untold`: see `simulate`. Raises
    rig.errors.SceneError for a key that is not a number of the rig and for values that the scene cannot have.
    """
    from rig.analysis.linear.control_loop import sweep_loop
    from rig.analysis.linear.sweep import sweep as solve
    from rig.scenes.axis import Axis

    loaded = _scene(scene, overrides, untold, redesign)
    axis = Axis.of(key, values, loaded, controller)
    return sweep_loop(loaded, axis, controller) if controller else solve(loaded, axis)


def loop(
    scene: Scene | str | Path,
    controller: str,
    *,
    overrides: Mapping[str, object] | None = None,
    untold: Mapping[str, object] | None = None,
) -> Loop:
    """Analyse a closed loop about steady sliding: eigenvalues, range of gains, margins of phase and delay.

    `overrides`, `untold`: see `simulate`. Raises rig.errors.SceneError for a controller that is not a linear feedback
    and where nothing slides steadily.
    """
    from rig.analysis.linear.control_loop import loop as solve

    return solve(_scene(scene, overrides, untold), controller)


def state_space(
    scene: Scene | str | Path, delay: float = 0.0, *, overrides: Mapping[str, object] | None = None
) -> StateSpace:
    """Linearise the rig about steady sliding: python-control's StateSpace from its actuators to its outputs.

    `delay` [s]: delay of the commands, as a Pade approximation of order 8. `overrides`: as for `load`, of a scene
    given by name or file. Raises rig.errors.SceneError where nothing slides steadily.
    """
    from rig.analysis.linear.control_loop import state_space as solve

    return solve(_scene(scene, overrides), delay)


def limit_cycle(
    scene: Scene | str | Path, longest: float | None = None, *, overrides: Mapping[str, object] | None = None
) -> Cycle:
    """Find the limit cycle at constant actuator values: period, stick time, extremes, energy, Floquet multipliers.

    `longest`: simulated seconds within which the motion must settle, 120 by default; otherwise `decided` is false.
    `overrides`: as for `load`, of a scene given by name or file. Raises rig.errors.NumericsError if the integration has
    to stop.
    """
    from rig.analysis.cycles.cycle import limit_cycle as search

    return search(_scene(scene, overrides), longest=longest)


def branches(
    scene: Scene | str | Path,
    over: str,
    *,
    output: str | None = None,
    start: Iterable[str | float | Run | Map | Start] = ("hopf", "simulation"),
    points: int = 400,
    second: str | None = None,
    folder: str | Path = "branches",
    overrides: Mapping[str, object] | None = None,
) -> Branches | Curves:
    """Follow stable and unstable motions over a parameter: `rig.branches("belt", "drive.speed=0.05 m/s:0.8 m/s")`.

    Steady sliding and cycles with any sequence of events, with Floquet multipliers, and their special points: Hopf,
    fold, grazing, period doubling, torus, lift-off, landing, begin and end of stick, jump, canard. `start`: what
    branches of cycles begin from: "hopf" (the Hopf points of sliding), "simulation" (limit cycles in the middle and at
    the ends of the range), a value at which to simulate, a map, a recording. `output`: plant output of the figure, by
    default the first. `points`: most points of a branch. `second`: a further parameter, KEY=FROM:TO:COUNT; then the
    result is the curves of the special points over both, the boundaries of sliding, stick-slip and both. Results go to
    a folder of their own in `folder`; an interrupted computation goes on from its last point. `overrides`: as for
    `load`, of a scene given by name or file. Raises rig.errors.SceneError and UsageError.
    """
    from pathlib import Path

    from rig.analysis.branches import branches as follow
    from rig.analysis.branches import curves, job
    from rig.scenes.axis import Axis

    loaded = _scene(scene, overrides)
    todo = job(loaded, over, output, tuple(start), points)
    root = Path(folder)
    return follow(todo, root) if second is None else curves(todo, Axis.parse(second, loaded), root)


def map(
    scene: Scene | str | Path,
    x: str,
    y: str | None = None,
    *,
    output: str | None = None,
    runs: tuple[str, ...] = ("up", "down", "near", "far"),
    longest: float | None = None,
    folder: str | Path = "maps",
    workers: int | None = None,
    overrides: Mapping[str, object] | None = None,
) -> Map | Boundary:
    """Map the steady-state behaviour over one or two parameters: `rig.map("belt", "drive.speed=0.05:0.8:40")`.

    Axes are KEY=FROM:TO:COUNT; `output`: plant output to evaluate; `runs`: up and down (each run continues from the
    point before), near and far (runs that start near steady sliding or far from it); `longest`: simulated seconds for
    one point. Over dither.frequency and dither.amplitude the map shows the boundary above which dither keeps the rig
    sliding, averaged and simulated. Results go to a folder of their own in `folder`; an interrupted map continues from
    it. `overrides`: as for `load`, of a scene given by name or file. Raises rig.errors.SceneError, UsageError, and
    WorkerError when a worker is lost.
    """
    from pathlib import Path

    from rig.analysis.map import chart, job

    loaded = _scene(scene, overrides)
    return chart(job(loaded, x, y, output, runs, longest), Path(folder), workers)  # type: ignore[return-value]


def study(
    scene: Scene | str | Path,
    over: Mapping[str, object],
    measure: Iterable[str | Callable[[Run], object]],
    *,
    samples: int | None = None,
    sampling: str = "random",
    repeat: int = 1,
    seed: int | None = None,
    duration: float | None = None,
    keep: str | None = None,
    folder: str | Path = "studies",
    workers: int | None = None,
    cluster: str = "",
    overrides: Mapping[str, object] | None = None,
    untold: Mapping[str, object] | None = None,
    redesign: bool = False,
) -> StudyResult:
    """Evaluate measures over parameters: `rig.study("belt", {"load.force": [10, 20, 30]}, ["cycle.amplitude"])`.

    `over`: dotted key -> values in SI or texts with units (a grid), "10 N:30 N:5", or a distribution such as
    rig.normal(0.4, 0.02), of which `samples` values are drawn (64 by default), by `sampling`: random, latin, sobol, or
    saltelli, from which Sobol indices follow. `measure`: names such as cycle.period, motion.growth_rate, run.rms (see
    docs/studies.md), or functions of a Run, which return a number, or a number and its unit. Each point is run `repeat`
    times, point number k with the seed `seed` + k. `duration` [s] of a run: by default the length of its protocol.
    `keep`: condition for keeping the recording of a run, such as "cycle.amplitude > 5 mm". Results go to a folder of
    their own in `folder`, from which an interrupted study continues. `workers`: processes, one for each core by
    default. `cluster`: the address of a dask scheduler. `overrides`, `untold`, `redesign`: as for
    `sweep`. Raises rig.errors.SceneError and UsageError with every fault, WorkerError if workers fail.
    """
    from pathlib import Path

    from rig.analysis.studies import prepared
    from rig.analysis.studies import study as carry_out

    loaded = _scene(scene, overrides, untold, redesign)
    work = prepared(loaded, over, measure, samples, sampling, repeat, seed, duration, keep)
    return carry_out(work, Path(folder), workers, keep=keep, cluster=cluster)


def optimise(
    scene: Scene | str | Path,
    over: Mapping[str, object],
    measure: str | Callable[[Run], object],
    *,
    largest: bool = False,
    evaluations: int = 600,
    seed: int | None = None,
    duration: float | None = None,
    folder: str | Path = "searches",
    workers: int | None = None,
    cluster: str = "",
    overrides: Mapping[str, object] | None = None,
    untold: Mapping[str, object] | None = None,
    redesign: bool = False,
) -> SearchResult:
    """Find the smallest value of a measure: `rig.optimise("belt", {"load.force": (10, 30)}, "cycle.amplitude")`.

    `over`: dotted key -> range in SI, or text such as "10 N:30 N". `measure`: as for `rig.study`; `largest`: search for
    its largest value. At most `evaluations` points are computed, by differential evolution, all with `seed`. Results go
    to a folder of their own in `folder`, from which an interrupted search, or one with more evaluations, continues.
    `duration`, `workers`, `cluster`, `overrides`, `untold`, `redesign`: as for `rig.study`. Raises
    rig.errors.SceneError, UsageError and WorkerError.
    """
    from pathlib import Path

    from rig.analysis.studies.search import prepared, search

    loaded = _scene(scene, overrides, untold, redesign)
    work = prepared(loaded, over, measure, largest, evaluations, seed, duration)
    return search(work, Path(folder), workers, cluster=cluster)


def identify(
    scene: Scene | str | Path,
    runs: str | Path | Iterable[Mapping[str, Any]],
    free: Mapping[str, object] | None = None,
    laws: Mapping[str, Mapping[str, object]] | Iterable[str] | None = None,
    *,
    per_run: Iterable[str] | None = None,
    over: Mapping[str, object] | None = None,
    starts: int | None = None,
    seed: int | None = None,
    folder: str | Path | None = None,
    workers: int | None = None,
    overrides: Mapping[str, object] | None = None,
) -> Identified:
    """Fit parameters of a scene to recordings: value, interval of 90 % and verdict for each.

    `runs`: a file (docs/identify.md), or its tables [[run]] as mappings, in which `run` may be a Run. `free`: dotted
    key -> range, "0.1:1" or (0.1, 1.0). `laws`: friction laws to compare, law -> ranges of its own keys. `per_run`:
    ["level"] gives each record an offset of its own. `over`: settings among which the next experiment is proposed,
    key -> values. `starts`: further starts near the values of the scene. `folder`: where evaluations are kept, from
    which an interrupted fit continues; None: nowhere. `workers`: processes, one for each core by default.
    `overrides`: as for `load`, of a scene given by name or file. Raises rig.errors.SceneError and UsageError with every
    fault, WorkerError if workers fail.
    """
    from pathlib import Path

    from rig.analysis.identification.identify import identify as fit
    from rig.analysis.identification.next_experiment import propose
    from rig.analysis.identification.runs import prepared

    given = runs if isinstance(runs, str | Path) else [*runs]
    task = prepared(_scene(scene, overrides), given, free, laws, per_run, starts, seed)
    found = fit(task, None if folder is None else Path(folder), workers)
    return propose(found, over, workers) if over else found


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
    channels: Mapping[str, str],
    time: str = "",
    rate: str = "",
    join: str = "",
    skip_missing: bool = False,
    replace: bool = False,
) -> Imported:
    """Write the recording `out` of a measurement in `files` of a data acquisition system; several files are one run.

    `channels`: column -> "NAME, SCALE UNIT" such as "vibrometer, 125 mm/s/V". `time`: the column with the time and its
    unit, "t, ms", or `rate`, "2 kHz", if a file states neither. `join`: what gives several files a common time,
    "trigger > 2 V" or a channel that all contain. Raises rig.errors.UsageError with every fault of the files.
    """
    from pathlib import Path

    from rig.record.imports.channel_map import ChannelMap
    from rig.record.imports.import_run import import_files

    paths = [files] if isinstance(files, str | Path) else files
    given = ChannelMap(dict(channels), time, rate)
    return import_files([Path(path) for path in paths], Path(out), given, join, skip_missing, replace)


def report(path: str | Path, out: str | Path | None = None, trust: bool = False) -> Path:
    """Write a self-contained page (HTML) about a recording, and return its path: `out`, or NAME.html beside it.

    An existing page is replaced. For `trust` and damaged recordings see `open`. Raises rig.errors.LogError for
    a file that cannot be read or is not a recording, OutputError if the page cannot be written.
    """
    from pathlib import Path

    from rig.analysis.report.page import write

    log = Path(path)
    page = log.with_suffix(".html") if out is None else Path(out)
    write(open(log, trust), log, page)
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
