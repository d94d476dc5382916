"""Commands that run a scene as processes (demo, run), or in this process (simulate)."""

from __future__ import annotations

import shlex
import sys
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import rig
from rig.cli import printing
from rig.cli.build import Answer, Made, Told
from rig.cli.options import (
    Accuracy,
    After,
    Before,
    Budget,
    Lockstep,
    Most,
    Net,
    NewName,
    Out,
    Pace,
    When,
    accuracy,
    added,
    check_controllers,
    linked,
    live_pace,
    recording,
    refuse_all,
    separated,
    share,
    the_scene,
    trigger,
)
from rig.cli.printing import new_recording
from rig.cli.recordings import allow
from rig.errors import ControllerFailed, ExitCode, UsageError
from rig.machine.process import told_to_stop
from rig.parameters import Argument, Option
from rig.units import number_or_text

if TYPE_CHECKING:
    from rig.bench.live.outcome import Pace as LivePace
    from rig.bus.tickets import Listener
    from rig.record.run import Run
    from rig.scenes.scene import Scene


View = Annotated[bool, Option("", "Show the run live in rerun.", "--view")]
Web = Annotated[bool, Option("", "Show the run live on a page in the browser.", "--web")]
Only = Annotated[
    list[str] | None,
    Option("NAMES", "Sensors and outputs that --figure draws over time, separated by commas.", "--only"),
]
Listen = Annotated[
    str | None,
    Option(
        "tls/HOST:PORT",
        "Let processes on other hosts join the run at this address of this host, each with a ticket: docs/remote.md.",
        "--listen",
    ),
]
Tickets = Annotated[
    list[str] | None,
    Option(
        "SEATS",
        "With --listen: who joins from other hosts, separated by commas: controllers of the scene, recorder, viewer, "
        "operator. Repeatable.",
        "--tickets",
    ),
]
DIALS = ("clock.method", "clock.tolerance", "clock.rk4_step")


def demo(
    view: View = False,
    web: Web = False,
    device: Annotated[bool, Option("", "The controller runs on a stand-in for a board: docs/device.md.")] = False,
) -> None:
    """Run the pendulum with its controller. Write a recording, a figure and a summary."""
    from rig.analysis.pool.kernel_shapes import prepare
    from rig.bench.live.supervise import run as supervise
    from rig.compiled.kernel import compiled
    from rig.controllers.runtime.stand_in import started
    from rig.design import described
    from rig.scenes import load

    shipped = load("pendulum")
    scene = load("pendulum_device") if device else shipped
    printing.note(f"{scene.title}\n\n{scene.about}\n")
    sys.stderr.write("1 of 3, ")  # the kernels say themselves that they are compiled, and how far it is
    sys.stderr.flush()
    prepare([scene])
    if not compiled():
        printing.note("compile: all kernels are compiled already")
    seconds = 1e-9 * (scene.duration_ns or 0)
    board = f", the board at {scene.controllers['nf'].port}" if device else ""
    printing.note(f"2 of 3, run: plant, controller and recorder as processes{board}, {seconds:g} s in real time")
    with ExitStack() as stack:
        if device:
            stack.enter_context(started(scene.controllers["nf"].port, described(shipped)["nf"]))
        outcome = supervise(scene, view=view, web=web)
    figure = Path(outcome.log).with_suffix(".png") if outcome.log else None
    if figure is not None:
        printing.note("3 of 3, draw: the figure of the run; a second or two")
        _draw(outcome.log, figure)
    printing.line(outcome.text())
    if figure is not None and figure.exists():
        printing.line(f" figure    {figure}\n           {figure.resolve().as_uri()}")
    raise typer.Exit(outcome.exit_code)


def run(
    scene: Scene,
    overrides: Mapping[str, object],
    controllers: list[str],
    duration: float | None,
    speed: Pace = None,
    lockstep: Lockstep = False,
    net: Net = None,
    view: View = False,
    web: Web = False,
    name: NewName = None,
    out: Out = None,
    only: Only = None,
    when: When = None,
    before: Before = None,
    after: After = None,
    most: Most = None,
    budget: Budget = None,
    precision: Accuracy = None,
    listen: Listen = None,
    tickets: Tickets = None,
    *,
    figure: Path | None,
    force: bool,
) -> Answer:
    """Run a scene in real time, with plant, controllers and recorder as processes."""
    factor = live_pace(speed, lockstep)
    names = listed(only, figure)
    windows = trigger(when, before, after, most)
    if windows is not None and figure is not None:
        raise UsageError("--figure: draws the recording of a whole run; --trigger records windows only")
    from rig.bench.live.outcome import keeps_up
    from rig.bench.live.supervise import run as supervise

    check_controllers(controllers, scene)
    drawable(names, scene)
    keeps_up(scene, factor)
    listener = reached_at(listen, tickets, scene, duration, factor)
    scene = configured(scene, overrides, precision, budget)
    if windows is not None:  # the recorder would find what is wrong only when the run has begun
        from rig.record.windows import bound, refuse_existing

        outputs = {name: output.unit for name, output in scene.assemble().outputs.items()}
        bound(windows.condition, outputs, {name: sensor.delivers for name, sensor in scene.sensors.items()})
        if out is not None:
            refuse_existing(out, force)
    printing.run_warnings(scene, duration)
    outcome = supervise(
        scene,
        pace=factor,
        lockstep=lockstep,
        duration=duration,
        view=view,
        web=web,
        out=out,
        replace=force,
        name=name,
        trigger=windows.options() if windows is not None else (),
        listener=listener,
    )

    def draw(path: Path) -> None:
        if outcome.log:
            _draw(outcome.log, path, names)

    return Answer(outcome, draw=draw, code=outcome.exit_code)


def reached_at(
    listen: str | None, tickets: list[str] | None, scene: Scene, duration: float | None, pace: LivePace
) -> Listener | None:
    """Where other hosts reach the run, from --listen and --tickets; None without. Raises UsageError."""
    if listen is None and not tickets:
        return None
    named = ",".join(tickets or ())
    seats = separated(named)
    refuse_all(
        (listen is None, f"--tickets {named}: needs --listen tls/HOST:PORT, where their holders reach the run"),
        (
            listen is not None and not seats,
            f"--listen {listen}: needs --tickets with the seats of other hosts, such as --tickets operator",
        ),
    )
    from rig.bus.tickets import Listener

    seconds = (scene.duration_ns or 0) / 1e9 if duration is None else duration
    factor = 1.0 if pace is None or pace == "auto" else pace
    listener = Listener(listen or "", tuple(seats), seconds / min(factor, 1.0))
    listener.check([name for name in scene.controllers if name not in scene.in_plant])
    return listener


def listed(only: list[str] | None, figure: Path | None) -> list[str]:
    """The names that --only lists. Raises UsageError without a figure or without names."""
    refuse_all(
        (only is not None and figure is None, "--only: chooses what --figure draws; add --figure FILE"),
        (only is not None and not only, "--only: expected names of sensors or outputs, separated by commas"),
    )
    return only or []


def drawable(names: Collection[str], scene: Scene) -> None:
    """Raise UsageError for a name that a run of the scene will not have."""
    from rig.record.run_data import listing, unknown

    outputs = {name: output.unit for name, output in scene.assemble().outputs.items()} if names else {}
    known = listing({name: sensor.delivers for name, sensor in scene.sensors.items()}, outputs)
    for name in names:
        if name not in known and name not in outputs:
            raise unknown(name, known, "scene")


def configured(scene: Scene, overrides: Mapping[str, object], precision: float | None, budget: str | None) -> Scene:
    """The scene with the method and step for the target error or the budget."""
    wanted = accuracy(precision, "--accuracy")
    most = share(budget)
    if wanted is None and most is None:
        return scene
    if given := [key for key in DIALS if key in overrides]:
        raise UsageError(f"{', '.join(given)}: --accuracy and --budget select this value; give one or the other")
    from rig.qualify.cost import chosen

    with printing.bar("settings") as progress:
        return chosen(scene, wanted, most, printing.note, report=progress)


def _draw(log: str, figure: Path, only: Collection[str] = ()) -> None:
    """Draw a recording."""
    from rig.cli.recordings import opened, without_outputs
    from rig.view.palette import put

    run = opened(Path(log))
    if nothing := without_outputs(run, log):
        printing.note(f"no figure: {nothing}")
        return
    put(run.plot(only), figure)
    printing.note(f"figure {figure}")


def _start(context: typer.Context, text: str | None) -> str | None:
    """The recording and instant to continue from; the recording is not to be overwritten."""
    if text is not None:
        recording(context, instant_of(text)[0])
    return text


Start = Annotated[
    str | None,
    Option(
        "LOG@TIME",
        "Continue a recording from this instant (12.5s, 300ms; without @TIME: its end) instead of a scene.",
        "--from",
        check=_start,
    ),
]


def instant_of(text: str) -> tuple[Path, float | None]:
    """The recording and the instant [s] of LOG@12.5s, LOG@12500ms or LOG (None: its end).

    A file with the whole text as its name comes first, so a name may have an @. Raises UsageError for an instant that
    is no time.
    """
    from rig.units import si

    name, at, instant = text.rpartition("@")
    if not at or not name or "/" in instant or Path(text).exists():
        return Path(text), None
    try:
        return Path(name), float(si(number_or_text(instant), "s"))
    except ValueError as error:
        raise UsageError(f"{text}: the instant {error}; write LOG@12.5s or LOG@12500ms") from None


def simulate(
    scene: Annotated[str | None, Argument("SCENE", "Name of a shipped scene, or a TOML file.")] = None,
    start: Start = None,
    net: Net = None,
    method: Annotated[
        str | None,
        Option("METHOD", "As clock.method: auto (default), exact, dopri5, dop853, rosenbrock, rk4, kick, smooth."),
    ] = None,
    out: Annotated[
        Path | None, Option("FILE", "Recording to write (MCAP). Default: none.", check=new_recording)
    ] = None,
    only: Only = None,
    budget: Budget = None,
    precision: Accuracy = None,
    recorded: Annotated[
        bool, Option("", "With --from: a board commands what it has commanded in the recording.")
    ] = False,
    *,
    overrides: Mapping[str, str],
    untold: Mapping[str, object],
    controllers: list[str],
    duration: float | None,
    trust: bool,
    figure: Path | None,
    force: bool,
) -> Answer:
    """Simulate a scene with its controllers in one process, as fast as possible.

    With --from: simulate a recording again up to an instant and continue
    from there. Values given with -p and a --duration count from that instant.
    """
    names = listed(only, figure)
    links = linked(net, overrides)
    by_method = {} if method is None else {"clock.method": method}
    given = {
        "SCENE": scene,
        "--untold": untold,
        "--controller": controllers,
        "--net": net,
        "--method": method,
        "--accuracy": precision,
        "--budget": budget,
    }
    wrong = ", ".join(name for name, value in given.items() if value not in (None, [], {}))
    neither = "name a scene (rig list shows them), or a recording to continue: --from LOG@12.5s"
    refuse_all(
        (by_method.keys() & overrides.keys(), "--method and -p: both give clock.method; leave out one of them"),
        (start is not None and wrong, f"--from {start}: {wrong} cannot be given with it; the recording decides"),
        (start is None and scene is None, neither),
        (start is None and recorded, "--recorded: only with --from, for a recording of a board"),
    )
    loaded: Scene | None = None
    if scene is not None:
        by_option: dict[str, Mapping[str, object]] = {
            "--controller": added(controllers),
            "--net": links,
            "--method": by_method,
        }
        loaded = the_scene(scene, overrides, by_option, untold)
        check_controllers(controllers, loaded)
        drawable(names, loaded)
        loaded = configured(loaded, {**overrides, **by_method}, precision, budget)
        printing.run_warnings(loaded, duration)
    failed = False
    begin = time.perf_counter()
    with _asked_to_stop() as stop:
        try:
            simulated = _simulated(loaded, start, overrides, duration, trust, recorded, stop)
        except ControllerFailed as error:  # what was computed is kept
            if error.run is None:  # it could not start
                raise
            simulated = error.run
            failed = True
    wall = time.perf_counter() - begin
    if out is not None:
        from rig.record.save_run import save

        save(simulated, out, replace=force)  # another command may have written it since this one began
    from rig.scenes.scene import Scene
    from rig.view.palette import put

    told = Told(
        lambda: {**simulated.summary, "energy": simulated.energy, "events": simulated.events, "fault": simulated.fault},
        show=lambda: printing.pairs(_summary(simulated, loaded or Scene.from_json(simulated.scene), wall, out, figure)),
    )
    kinds = {event["kind"] for event in simulated.plant_events}
    stopped = not failed and (simulated.fault or "limit" in kinds)
    codes = {ExitCode.STOPPED: stopped, ExitCode.FAILED: failed or "lost" in kinds, ExitCode.INTERRUPTED: stop()}
    code = next((code for code, holds in codes.items() if holds), ExitCode.DONE)
    return Answer(told, notes=[*_notes(simulated)], draw=lambda path: put(simulated.plot(names), path), code=code)


def _simulated(
    scene: Scene | None,
    start: str | None,
    overrides: Mapping[str, str],
    length: float | None,
    trust: bool,
    recorded: bool,
    stop: Callable[[], str],
) -> Run:
    """Simulate a scene, or continue a recording."""
    from rig.bench.live.rehearsal import marked

    with marked(None):
        if start is None:
            assert scene is not None
            return rig.simulate(scene, length, stop)
        log, at = instant_of(start)
        allow(log, trust)
        given = {key: number_or_text(value) for key, value in overrides.items()}
        return rig.fork(log, at, given, length, stop, recorded=recorded)


@contextmanager
def _asked_to_stop() -> Iterator[Callable[[], str]]:
    """Which signal has asked this process to end, in words; the second one ends it at once."""
    asked: list[str] = []

    def heard(name: str) -> None:
        if asked:
            raise KeyboardInterrupt
        asked.append(name)
        printing.note("ending the run; press Ctrl-C again to end at once")

    with told_to_stop(heard):
        yield lambda: f"interrupted by {asked[0]}" if asked else ""


def _notes(run: Run) -> Iterator[str]:
    """What of the run deserves attention: its warnings and faults."""
    from rig.bus.topics import LEVELS

    forked = max((event["t_ns"] for event in run.plant_events if event["kind"] == "fork"), default=-1)
    told = LEVELS.keys() - {"overruled", "fault"}
    for event in run.plant_events:
        kind = event["kind"]
        t = event["t_ns"]
        text = event["text"]
        if kind == "warning" or (kind == "overruled" and t == forked):
            yield f"warning: {text}"
        elif kind == "log" and t == forked:  # a board that was asked again
            yield text
        elif t >= forked and kind in told and text.partition("\n")[0] not in run.fault:
            yield f"{t * 1e-9:.3f} s  {kind}: {text}"
    if run.fault:
        yield run.fault


def _summary(run: Run, scene: Scene, wall: float, out: Path | None, figure: Path | None) -> Iterator[tuple[str, str]]:
    """The summary of a run in this process, as labelled lines."""
    from rig.bench.live import status
    from rig.model.assembly import portrait
    from rig.printable import counted
    from rig.record.statistics import contact
    from rig.scenes.belief import lines as belief_lines

    plant = run.summary["plant"]
    length = float(run.time[-1])
    yield "run", f"{length:g} s simulated in {wall:.2f} s, compiling included; ended: {run.summary['ended']}"
    yield from (("fork", event["text"]) for event in run.plant_events if event["kind"] == "fork")
    yield from (("belief", line) for line in belief_lines(scene))
    yield "plant", status.plant(plant, plant["energy_error"])
    for name in portrait(scene.assemble().outputs) or ():
        v = run.signals[name]
        yield name, f"{v.min():.6g} .. {v.max():.6g} {run.units[name]}"
    if text := contact(run):
        yield "contact", text
    for name, counts in run.summary["controllers"].items():
        yield name, ", ".join([counted(counts["updates"], "update"), *status.unanswered(counts)])
    yield from (("network", status.link(topic, n)) for topic, n in run.summary.get("network", {}).items())
    yield from (("audit", effect["text"]) for effect in run.summary["audit"] if effect["noted"])
    yield from ((label, str(path)) for label, path in (("log", out), ("figure", figure)) if path is not None)
    if out:
        log = shlex.quote(str(out))
        yield "next", f"rig report {log} | rig verify {log} | rig live replay {log} | rig simulate --from {log}"
    else:
        draw = "" if figure else ", --figure FILE.png to draw it"
        yield "next", f"the same with --out FILE.mcap to keep a recording{draw}"


COMMANDS = {
    "demo": Made(demo, "rig demo --view"),
    "run": Made(run, 'rig run pendulum --view -p drive.speed="2 rpm"', rig.simulate, "figure"),
    "simulate": Made(
        simulate,
        "rig simulate pendulum --duration 10 --out pendulum.mcap --figure pendulum.png",
        rig.simulate,
        "figure",
    ),
}
