"""Commands that analyse a recording, most of them records from which the command is made, and one that compares two."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from inspect import Parameter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, get_args

import typer

import rig
from rig.cli import printing
from rig.cli.build import Answer, Made
from rig.cli.options import recording, scene_file, the_scene
from rig.cli.printing import new
from rig.cli.recordings import opened, without_outputs
from rig.cli.stated import Stated
from rig.errors import Faults, LogError, UsageError
from rig.parameters import Argument, Begin, Channel, End, Option

if TYPE_CHECKING:
    from rig.record.run import Run

_SIGNAL = Stated("--signal", get_args(Channel)[1])
SPAN = {"begin": Stated("--from", get_args(Begin)[1]), "end": Stated("--to", get_args(End)[1])}
CONTACT = {
    "velocity": Stated(
        "--velocity", Option("NAME", "Channel of the slip speed; with --drive, of the speed of the body.")
    ),
    "friction": Stated("--friction", Option("NAME", "Channel of the friction force, or of the force of the spring.")),
    "drive": Stated("--drive", Option("NAME|VALUE", 'Speed of the drive: a channel, or a value, "1.1 mm/s".')),
    "stiffness": Stated(
        "--stiffness",
        Option("VALUE", 'Spring through which the drive pulls: "168 N/m". The slip speed then follows from the force.'),
    ),
    "load": Stated("--load", Option("NAME|VALUE", 'Normal force, for a coefficient: a channel, or a value, "16 N".')),
    "threshold": Stated(
        "--threshold",
        Option("VALUE", "Noise of the slip speed: a slip exceeds ten times as much. Default: 4 % of the drive."),
    ),
    "smooth": Stated(
        "--smooth", Option("VALUE", "Strength of the smoothing of the force, in its unit. Default: none.")
    ),
}
"""What `stick_slip` is told of a contact."""


def option(flag: str, value: str, text: str, default: Any = None) -> Stated:
    """An option of an analysis."""
    return Stated(flag, Option(value, text), default)


def stick_arguments(run: Run, contact: Mapping[str, str | None]) -> dict[str, Any]:
    """Return the arguments of `stick_slip` from the texts of `CONTACT`. Raises UsageError with all faults."""
    from rig.quantities import finite
    from rig.record.run_data import signals

    given = {name: text or "" for name, text in contact.items()}
    known = signals(run)
    rotates = given["drive"].endswith(("rpm", "rad/s"))
    speed = known.get(given["velocity"], "rad/s" if rotates else "m/s")
    newton = known.get(given["friction"], "N")
    slope = "N/m" if newton == "N" else f"{newton}/m"
    units = {"drive": speed, "load": newton, "stiffness": slope, "threshold": speed, "smooth": newton}
    faults = Faults()

    def value(name: str) -> float:
        try:
            return finite(given[name], units[name]) if given[name] else 0.0
        except ValueError as fault:
            raise UsageError(f"--{name} {given[name]}: {fault}") from None

    channels = {name for name in given if name not in units or (name in ("drive", "load") and given[name] in known)}
    arguments = {name: text if name in channels else faults(partial(value, name), 0.0) for name, text in given.items()}
    faults.raise_found()
    return arguments


def _section(run: Run, section: str) -> tuple[str, float]:
    """The channel and the value [in its unit] of a section."""
    from rig.analysis.recorded import series
    from rig.quantities import Condition

    cut = Condition.read(section, "--section", "=", 'NAME = VALUE, such as "velocity = 10 mm/s"')
    return cut.name, cut.level_in(series(run, cut.name).unit)


class Analysis(NamedTuple):
    """An analysis of a recording: a function of `rig.analysis.recorded`, which takes a run and the `options` by name.

    Its result has `text`, `to_json`, `plot`, and `csv` if `files` names it.
    """

    function: str
    about: str
    options: Mapping[str, Stated]
    example: str
    files: str = "figure csv"

    def command(self) -> Made:
        """Return the command."""

        def analyse(run: Run, begin: float | None = None, end: float | None = None, **given: Any) -> Any:
            from rig.analysis import recorded

            span = {"first": begin, "last": end}
            given |= {name: value for name, value in span.items() if value is not None}
            return getattr(recorded, self.function)(run, **given)

        def work(log: Path, trust: bool, faults: Faults, **given: Any) -> Any:
            return analysed(log, trust, faults, analyse, **given)

        work.__doc__ = self.about
        return Made(work, self.example, files=self.files, more=self.options)


def analysed(log: Path, trust: bool, faults: Faults, analyse: Callable[..., Any], **given: Any) -> Any:
    """Return what an analysis finds in a recording; all faults of its options are reported at once."""
    run = opened(log, trust)
    if nothing := without_outputs(run, log):
        raise LogError(nothing)
    if _empty(faults, given.get("begin") or 0.0, given.get("end")):
        given |= {"begin": None, "end": None}
    given = {name: value for name, value in given.items() if value not in (None, "")}
    if "section" in given:
        section = faults(partial(_section, run, given.pop("section")), None)
        given |= {"section": section} if section else {}
    result = faults(lambda: analyse(run, **given), None)
    faults.raise_found()
    return result


def _empty(faults: Faults, begin: float, end: float | None) -> bool:
    """Whether a time span is empty; then it is one of the faults."""
    empty = end is not None and begin >= end
    if empty:
        faults.found.append(f"--from {begin:g} s to {end:g} s: the time span is empty; --to must be later")
    return empty


def _window(help_text: str) -> Stated:
    return option("--window", "TIME", help_text)


ANALYSES = {
    "spectrum": Analysis(
        "spectrum",
        "Compute power spectral density and spectrogram of a measurement or output; with --orders, its orders too.",
        {
            "name": _SIGNAL,
            "window": _window("Length of the windows. Default: 1/8 of the time span; for the spectrogram 1/80."),
            "over": option(
                "--orders", "NAME", 'Compute orders over this speed, angle or travel; "drive": speed of the drive.'
            ),
            **SPAN,
        },
        "rig analyse spectrum recordings/golden/pendulum.mcap --orders drive --figure spectrum.png",
    ),
    "pressure": Analysis(
        "pressure",
        "Draw maps of the contact pressure, of a slider or of a structure, at chosen instants.",
        {
            "at": option(
                "--at",
                "TIMES",
                'Instants, separated by commas: "0.5, 0.56 s, 600 ms". Default: chosen from the run.',
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
            "over": option(
                "--over", "NAME", "Sensor or plant output that rises and falls. Default: the speed of the drive."
            ),
            "window": _window("Length of the centred window. Default: about five periods."),
            **SPAN,
        },
        "rig analyse hysteresis recordings/runs/belt_hysteresis-20260101-120000.mcap --window '1 s'",
    ),
    "response": Analysis(
        "response",
        "Estimate the frequency response and coherence between two channels; natural frequencies and damping ratios.",
        {
            "source": option(
                "--input", "NAME", "Channel that excites: a sensor, a plant output, or an actuator.", Parameter.empty
            ),
            "answer": option("--output", "NAME", "Channel that responds.", Parameter.empty),
            "window": _window("Length of the windows. Default: 1/16 of the time span; for pulses, until the next one."),
            **SPAN,
        },
        "rig analyse response knock.mcap --input knock_force --output accelerometer --figure response.png",
    ),
    "portrait": Analysis(
        "portrait",
        "Draw a phase portrait; with --section, find the Poincare section and the period of the motion.",
        {
            "x": option("--x", "NAME", "Horizontal axis. Default: displacement."),
            "y": option("--y", "NAME", "Vertical axis. Default: velocity."),
            "section": option(
                "--section",
                "NAME=VALUE",
                'Poincare section: points where a channel crosses a value upwards: "velocity = 10 mm/s".',
            ),
            **SPAN,
        },
        "rig analyse portrait recordings/golden/pendulum.mcap --section 'velocity = 0' --figure portrait.png",
    ),
    "amplitude": Analysis(
        "amplitudes",
        "Compute amplitude and frequency of each measurement, stage by stage, and the speeds of first and last stick.",
        SPAN,
        "rig analyse amplitude recordings/runs/lever-20260101-120000.mcap --from '4 s'",
        "figure",
    ),
}


def events(log: Path, trust: bool, faults: Faults, **given: Any) -> Any:
    """List the vibration events of a channel: begin, end, frequency, level, growth rate, speed and load."""
    return analysed(log, trust, faults, rig.events, **given)


def sound(
    log: Path,
    trust: bool,
    signal: Annotated[str, Option("SENSOR", "Sensor whose sound is analysed. Default: the microphone.")] = "",
    out: Annotated[Path | None, Option("FILE", "Write the sound to a WAV file.", check=new)] = None,
) -> Answer:
    """Find squeals in the sound of a recording: level, frequency, times. Write a WAV file."""
    from rig.analysis.recorded.sound import hear
    from rig.machine.files import draft_of
    from rig.record.wav import write

    heard = hear(opened(log, trust), signal)
    full = None
    told = []
    if out is not None:
        with draft_of(out) as draft:
            full = write(heard.v, heard.rate, draft)
        told = [f"{out}: 24 bit, full scale is {full:.4g} {heard.unit}"]
    if len(heard.starts) > 1:
        times = ", ".join(f"{start:.9g} s" for _, start in heard.starts)
        printing.note(f"{heard.channel}: stretches that begin at {times} follow each other without their gap")
    return Answer(heard, more={"wav": out, "full_scale": full}, then=lambda: told)


def _recording_or_scene(context: typer.Context, given: str) -> str:
    if _is_scene(given):
        return scene_file(context, given) or ""
    recording(context, Path(given))
    return given


def _is_scene(given: str) -> bool:
    return given.endswith(".toml") or (not given.endswith(".mcap") and not Path(given).exists())


def diff(
    first: Annotated[Path, Argument("A", "A recording.", check=recording)],
    second: Annotated[str, Argument("B", "Another one, or a scene that simulates it.", check=_recording_or_scene)],
    tolerance: float,
    begin: float,
    end: float,
    overrides: Mapping[str, object],
    follow: Mapping[str, str],
    pair: Mapping[str, str],
    trust: bool,
    faults: Faults,
    **contact: str | None,
) -> Answer:
    """Compare two recordings, or a measurement with its simulation by a scene.

    Recordings are compared at the instants that both contain: equal bit by bit,
    within the tolerance, or different from an instant on; and by measures such as
    period and amplitude. One may have additional samples between those of the
    other. A scene runs under the measured speed and load, and is compared by its
    measures; --velocity to --smooth are those of rig analyse stick. Exit code 0: equal or
    within the tolerance, 1: different.
    """
    _empty(faults, begin, end)
    if not _is_scene(second) and (follow or pair or overrides or any(contact.values())):
        faults.found.append(f"{second} is a recording: -p, --follow, --pair and --velocity to --smooth need a scene")
    faults.raise_found()
    run = opened(first, trust)
    if not _is_scene(second):
        from rig.analysis.recorded.comparison import compare

        names = tuple(str(path) for path in (first, second))
        compared = compare(run, opened(Path(second), trust), begin, end, tolerance, names)
        return Answer(compared, compared.agree)
    from rig.analysis.recorded.against_scene import against_scene

    stick = stick_arguments(run, contact) if any(contact.values()) else None
    scene = the_scene(second, overrides)
    with printing.status(f"simulating {scene.name}"):
        beside = against_scene(run, scene, begin, end, follow, pair, stick)
    return Answer(beside, not tolerance or beside.within(tolerance))


COMMANDS = {
    **{name: analysis.command() for name, analysis in ANALYSES.items()},
    "events": Made(
        events,
        "rig analyse events bench.mcap --signal vibrometer --at belt_speed,load --over two_dof --figure events.png",
        rig.events,
        "figure csv",
    ),
    "sound": Made(
        sound,
        "rig analyse sound recordings/runs/brake-20260101-120000.mcap --out squeal.wav --figure squeal.png",
        files="figure",
    ),
    "diff": Made(
        diff, "rig diff first.mcap second.mcap --tolerance 1e-6 --figure difference.png", rig.diff, "figure", CONTACT
    ),
}
