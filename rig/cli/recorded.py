"""Commands that analyse a recording; each is a record, from which the command is made, and one that compares two."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from inspect import Parameter, Signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from rig.cli import printing
from rig.cli.options import Changes, Figure, Force, Json, Trust, changes, scene_file, seconds, the_scene
from rig.cli.printing import draw, new
from rig.cli.recordings import Log, opened, recording, without_outputs
from rig.errors import Faults, LogError, UsageError

if TYPE_CHECKING:
    from rig.record.run import Run
    from rig.scenes.scene import Scene

Table = Annotated[Path | None, typer.Option("--csv", metavar="FILE", callback=new, help="Write all numbers as CSV.")]
First = Annotated[str | None, typer.Option("--from", metavar="TIME", help="Start of the evaluated time span.")]
Last = Annotated[str | None, typer.Option("--to", metavar="TIME", help="End of the evaluated time span.")]

Microphone = Annotated[
    str, typer.Option("--signal", metavar="SENSOR", help="Sensor whose sound is analysed. Default: the microphone.")
]
SoundFile = Annotated[Path | None, typer.Option(metavar="FILE", callback=new, help="Write the sound to a WAV file.")]

Tolerance = Annotated[
    float,
    typer.Option(
        "--tolerance",
        metavar="REL",
        help="Allowed deviation: 1e-6 of the range of each channel, or, of a scene, 0.1 of each measure.",
    ),
]
Followed = Annotated[
    list[str] | None,
    typer.Option(
        metavar='"ACTUATOR = CHANNEL"',
        help="What an actuator of the scene follows. Repeatable. Default: speed and load, by their names.",
    ),
]
Pairs = Annotated[
    list[str] | None,
    typer.Option(
        metavar='"CHANNEL = SIMULATED, FACTOR"',
        help='What a measured channel is compared with: "force = '
        'displacement, 168 N/m". Repeatable. Default: equal names.',
    ),
]

Velocity = Annotated[
    str, typer.Option(metavar="NAME", help="Channel of the slip speed; with --drive, of the speed of the body.")
]
Friction = Annotated[
    str, typer.Option(metavar="NAME", help="Channel of the friction force, or of the force of the spring.")
]
Drive = Annotated[
    str, typer.Option(metavar="NAME|VALUE", help='Speed of the drive: a channel, or a value, "1.1 mm/s".')
]
Stiffness = Annotated[
    str,
    typer.Option(
        metavar="VALUE",
        help='Spring through which the drive pulls: "168 N/m". The slip speed then follows from the force.',
    ),
]
Load = Annotated[
    str, typer.Option(metavar="NAME|VALUE", help='Normal force, for a coefficient: a channel, or a value, "16 N".')
]
Threshold = Annotated[
    str,
    typer.Option(
        metavar="VALUE", help="Noise of the slip speed: a slip exceeds ten times as much. Default: 4 % of the drive."
    ),
]
Smooth = Annotated[
    str, typer.Option(metavar="VALUE", help="Strength of the smoothing of the force, in its unit. Default: none.")
]


def stick_arguments(
    run: Run, velocity: str, friction: str, drive: str, stiffness: str, load: str, threshold: str, smooth: str
) -> dict[str, Any]:
    """The arguments of `stick_slip` from the texts of the options above. Raises UsageError with all faults."""
    from rig.quantities import finite
    from rig.record.run_data import signals

    known = signals(run)
    faults = Faults()

    def value(given: str, option: str, unit: str) -> float:
        try:
            return finite(given, unit) if given else 0.0
        except ValueError as fault:
            raise UsageError(f"{option} {given}: {fault}") from None

    rotates = drive.endswith(("rpm", "rad/s"))
    speed = known.get(velocity, "rad/s" if rotates else "m/s")
    newton = known.get(friction, "N")
    slope = "N/m" if newton == "N" else f"{newton}/m"
    arguments = {
        "velocity": velocity,
        "friction": friction,
        "drive": drive if drive in known else faults(lambda: value(drive, "--drive", speed), 0.0),
        "load": load if load in known else faults(lambda: value(load, "--load", newton), 0.0),
        "stiffness": faults(lambda: value(stiffness, "--stiffness", slope), 0.0),
        "threshold": faults(lambda: value(threshold, "--threshold", speed), 0.0),
        "smooth": faults(lambda: value(smooth, "--smooth", newton), 0.0),
    }
    faults.raise_found()
    return arguments


def _text(given: str, flag: str, run: Run) -> str:
    return given


def _time(given: str, flag: str, run: Run) -> float | None:
    return seconds(given, flag)


def _times(given: str, flag: str, run: Run) -> list[float]:
    faults = Faults()
    times = [faults(partial(seconds, text, flag, 0.0), None) for text in given.split(",") if text.strip()]
    faults.raise_found()
    return [time for time in times if time is not None]


def _section(given: str, flag: str, run: Run) -> tuple[str, float]:
    """The channel and the value [in its unit] of a section."""
    from rig.analysis.recorded import series
    from rig.quantities import Condition

    cut = Condition.read(given, flag, "=", 'NAME = VALUE, such as "velocity = 10 mm/s"')
    return cut.name, cut.level_in(series(run, cut.name).unit)


def _names(given: str, flag: str, run: Run) -> list[str]:
    return [name.strip() for name in given.split(",") if name.strip()]


def _scene(given: str, flag: str, run: Run) -> Scene:
    from rig.scenes import load

    return load(given)


class Option(NamedTuple):
    """An option of an analysis; `read` gives the argument of its function from the text, the flag and the run."""

    kind: Any
    read: Callable[[str, str, Run], object] = _text

    @property
    def flag(self) -> str:
        """Its name on the command line."""
        return str(self.kind.__metadata__[0].default)


def _option(flag: str, metavar: str, text: str, read: Callable[[str, str, Run], object] = _text) -> Option:
    return Option(Annotated[str | None, typer.Option(flag, metavar=metavar, help=text)], read)


class Analysis(NamedTuple):
    """An analysis of a recording: a function of `rig.analysis.recorded`, which takes a run and the `options` by name.

    Its result has `text`, `to_json`, `plot`, and `csv` if it is a `table` of numbers. `show`: how the text is printed.
    """

    function: str
    about: str
    options: Mapping[str, Option]
    example: str
    table: bool = True
    show: Callable[[Any], None] | None = None

    def command(self) -> Callable[..., None]:
        """Return the command: it reads the options, reports all faults at once, prints, writes and draws."""

        def run_it(
            log: Path,
            figure: Path | None,
            trust: bool,
            as_json: bool,
            csv: Path | None = None,
            force: bool = False,
            **given: str | None,
        ) -> None:
            from rig.analysis import recorded
            from rig.machine.files import write_file

            run = opened(log, trust)
            faults = Faults()
            if nothing := without_outputs(run, log):
                raise LogError(nothing)
            values = dict[str, Any]()
            for name, option in self.options.items():
                text = given[name]
                if text is None:
                    continue
                value = faults(partial(option.read, text, option.flag, run), None)
                if value is not None:
                    values[name] = value
            if _empty(faults, values.get("first", 0.0), values.get("last", float("inf"))):
                values = {name: value for name, value in values.items() if name not in _SPAN}
            result: Any = faults(lambda: getattr(recorded, self.function)(run, **values), None)
            faults.raise_found()
            if self.show and not as_json:
                self.show(result)
            else:
                printing.result(result, as_json, figure=figure, **({"csv": csv} if self.table else {}))
            if csv is not None:
                write_file(csv, result.csv().encode())
            draw(result, figure)

        kinds = {"log": Log, **{name: option.kind for name, option in self.options.items()}, "figure": Figure}
        kinds |= {"csv": Table} if self.table else {}
        kinds |= {"trust": Trust, "force": Force, "as_json": Json}
        unset = {Path: Parameter.empty, str: Parameter.empty, bool: False}
        run_it.__doc__ = self.about
        run_it.__annotations__ = kinds
        parameters = [
            Parameter(name, Parameter.KEYWORD_ONLY, annotation=kind, default=unset.get(kind.__origin__))
            for name, kind in kinds.items()
        ]
        run_it.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
        return run_it


def _empty(faults: Faults, begin: float, end: float) -> bool:
    """Whether a time span is empty; then it is one of the faults."""
    if begin >= end:
        faults.found.append(f"--from {begin:g} s to {end:g} s: the time span is empty; --to must be later")
    return begin >= end


def _stages(amplitudes: Any) -> None:
    printing.table(amplitudes.TITLE, amplitudes.COLUMNS, amplitudes.table())
    if amplitudes.sticks:
        printing.line(amplitudes.sticks.text())


_SIGNAL = _option("--signal", "NAME", "Sensor or plant output to analyse. Default: a sensor that measures vibration.")
_SPAN = {"first": Option(First, lambda given, flag, run: seconds(given, flag, low=0.0)), "last": Option(Last, _time)}


def _window(help_text: str) -> Option:
    return _option("--window", "TIME", help_text, _time)


ANALYSES = {
    "spectrum": Analysis(
        "spectrum",
        "Compute power spectral density and spectrogram of a measurement or output; with --orders, its orders too.",
        {
            "name": _SIGNAL,
            "window": _window("Length of the windows. Default: 1/8 of the time span; for the spectrogram 1/80."),
            "over": _option(
                "--orders", "NAME", 'Compute orders over this speed, angle or travel; "drive": speed of the drive.'
            ),
            **_SPAN,
        },
        "rig analyse spectrum recordings/golden/pendulum.mcap --orders drive --figure spectrum.png",
    ),
    "events": Analysis(
        "events",
        "List the vibration events of a channel: begin, end, frequency, level, growth rate, speed and load.",
        {
            "name": _SIGNAL,
            "at": _option(
                "--at",
                "NAMES",
                "Channels whose means during the growth are listed. Default: speed of the drive, load, temperature.",
                _names,
            ),
            "window": _window("Length of the windows. Default: 40 ms, or eight periods of the strongest tone."),
            "over": _option(
                "--over", "SCENE", "Scene whose eigenvalues over --key are compared with the events.", _scene
            ),
            "key": _option("--key", "KEY", "Key of that scene: drive.speed (default), load.force."),
            **_SPAN,
        },
        "rig analyse events bench.mcap --signal vibrometer --at belt_speed,load --over two_dof --figure events.png",
    ),
    "pressure": Analysis(
        "pressure",
        "Draw maps of the contact pressure, of a slider or of a structure, at chosen instants.",
        {
            "at": _option(
                "--at",
                "TIMES",
                'Instants, separated by commas: "0.5, 0.56 s, 600 ms". Default: chosen from the run.',
                _times,
            )
        },
        "rig analyse pressure plate.mcap --at '0.5 s, 0.56 s, 0.6 s' --figure pressure.png",
    ),
    "hysteresis": Analysis(
        "hysteresis",
        "Compute the RMS of a vibration over rising and falling drive speed, and the speeds at which the contact "
        "stuck.",
        {
            "name": _SIGNAL,
            "over": _option(
                "--over", "NAME", "Sensor or plant output that rises and falls. Default: the speed of the drive."
            ),
            "window": _window("Length of the centred window. Default: about five periods."),
            **_SPAN,
        },
        "rig analyse hysteresis recordings/runs/belt_hysteresis-20260101-120000.mcap --window '1 s'",
    ),
    "response": Analysis(
        "response",
        "Estimate the frequency response and coherence between two channels; natural frequencies and damping ratios.",
        {
            "source": Option(
                Annotated[
                    str,
                    typer.Option(
                        "--input",
                        metavar="NAME",
                        help="Channel that excites: a sensor, a plant output, or an actuator.",
                    ),
                ]
            ),
            "answer": Option(Annotated[str, typer.Option("--output", metavar="NAME", help="Channel that responds.")]),
            "window": _window("Length of the windows. Default: 1/16 of the time span; for pulses, until the next one."),
            **_SPAN,
        },
        "rig analyse response knock.mcap --input knock_force --output accelerometer --figure response.png",
    ),
    "portrait": Analysis(
        "portrait",
        "Draw a phase portrait; with --section, find the Poincare section and the period of the motion.",
        {
            "x": _option("--x", "NAME", "Horizontal axis. Default: displacement."),
            "y": _option("--y", "NAME", "Vertical axis. Default: velocity."),
            "section": _option(
                "--section",
                "NAME=VALUE",
                'Poincare section: points where a channel crosses a value upwards: "velocity = 10 mm/s".',
                _section,
            ),
            **_SPAN,
        },
        "rig analyse portrait recordings/golden/pendulum.mcap --section 'velocity = 0' --figure portrait.png",
    ),
    "amplitude": Analysis(
        "amplitudes",
        "Compute amplitude and frequency of each measurement, stage by stage, and the speeds of first and last stick.",
        _SPAN,
        "rig analyse amplitude recordings/runs/lever-20260101-120000.mcap --from '4 s'",
        table=False,
        show=_stages,
    ),
}


def sound(
    log: Log,
    signal: Microphone = "",
    out: SoundFile = None,
    figure: Figure = None,
    trust: Trust = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Find squeals in the sound of a recording: level, frequency, times. Write a WAV file."""
    from rig.analysis.recorded.sound import hear
    from rig.machine.files import draft_of
    from rig.record.wav import write

    heard = hear(opened(log, trust), signal)
    full = None
    if out is not None:
        with draft_of(out) as draft:
            full = write(heard.v, heard.rate, draft)
    if len(heard.starts) > 1:
        times = ", ".join(f"{start:.9g} s" for _, start in heard.starts)
        printing.note(f"{heard.channel}: stretches that begin at {times} follow each other without their gap")
    printing.result(heard, as_json, wav=out, full_scale=full, figure=figure)
    if full is not None and not as_json:
        printing.line(f"{out}: 24 bit, full scale is {full:.4g} {heard.unit}")
    draw(heard, figure)


def _recording_or_scene(context: typer.Context, given: str) -> str:
    if _is_scene(given):
        return scene_file(context, given) or ""
    recording(context, Path(given))
    return given


def _is_scene(given: str) -> bool:
    return given.endswith(".toml") or (not given.endswith(".mcap") and not Path(given).exists())


def _assigned(given: list[str] | None, option: str, example: str) -> dict[str, str]:
    """The texts "NAME = TEXT" of an option. Raises UsageError."""
    assigned = dict[str, str]()
    for text in given or ():
        name, equals, rest = map(str.strip, text.partition("="))
        if not equals or not name or not rest or name in assigned:
            why = "is given twice" if name in assigned else f"expected {example}"
            raise UsageError(f"{option} {text}: {why}")
        assigned[name] = rest
    return assigned


def diff(
    first: Annotated[Path, typer.Argument(metavar="A", help="A recording.", callback=recording)],
    second: Annotated[
        str,
        typer.Argument(metavar="B", help="Another one, or a scene that simulates it.", callback=_recording_or_scene),
    ],
    tolerance: Tolerance = 0.0,
    begin: First = None,
    end: Last = None,
    p: Changes = None,
    follow: Followed = None,
    pair: Pairs = None,
    velocity: Velocity = "",
    friction: Friction = "",
    drive: Drive = "",
    stiffness: Stiffness = "",
    load: Load = "",
    threshold: Threshold = "",
    smooth: Smooth = "",
    figure: Figure = None,
    trust: Trust = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Compare two recordings, or a measurement with its simulation by a scene.

    Recordings are compared at the instants that both contain: equal bit by bit,
    within the tolerance, or different from an instant on; and by measures such as
    period and amplitude. One may have additional samples between those of the
    other. A scene runs under the measured speed and load, and is compared by its
    measures; --velocity to --smooth are those of rig analyse stick. Exit code 0: equal or
    within the tolerance, 1: different.
    """
    faults = Faults()
    low = faults(lambda: seconds(begin, "--from", 0.0), None) or 0.0
    high = faults(lambda: seconds(end, "--to"), None) or float("inf")
    _empty(faults, low, high)
    ways = faults(
        lambda: _assigned(follow, "--follow", 'ACTUATOR = CHANNEL: "drive.speed = belt_speed"'), dict[str, str]()
    )
    pairs = faults(lambda: _assigned(pair, "--pair", 'CHANNEL = SIMULATED: "force = friction_force"'), dict[str, str]())
    contact = (velocity, friction, drive, stiffness, load, threshold, smooth)
    if not _is_scene(second) and (follow or pair or p or any(contact)):
        faults.found.append(f"{second} is a recording: -p, --follow, --pair and --velocity to --smooth need a scene")
    faults.raise_found()
    run = opened(first, trust)
    if not _is_scene(second):
        from rig.analysis.recorded.comparison import compare

        names = tuple(str(path) for path in (first, second))
        compared = compare(run, opened(Path(second), trust), low, high, tolerance, names)
        printing.result(compared, as_json, figure=figure)
        draw(compared, figure)
        printing.passed(compared.agree)
        return
    from rig.analysis.recorded.against_scene import against_scene

    stick = stick_arguments(run, *contact) if any(contact) else None
    scene = the_scene(second, changes(p))
    with printing.status(f"simulating {scene.name}"):
        beside = against_scene(run, scene, low, high, ways, pairs, stick)
    printing.result(beside, as_json, figure=figure)
    draw(beside, figure)
    printing.passed(not tolerance or beside.within(tolerance))


COMMANDS = {
    **{name: (analysis.command(), analysis.example) for name, analysis in ANALYSES.items()},
    "sound": (
        sound,
        "rig analyse sound recordings/runs/brake-20260101-120000.mcap --out squeal.wav --figure squeal.png",
    ),
    "diff": (diff, "rig diff first.mcap second.mcap --tolerance 1e-6 --figure difference.png"),
}
