"""Commands that analyse a recording; each is a record, from which the command is made, and one that compares two."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from inspect import Parameter, Signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from rig.cli import printing
from rig.cli.options import Figure, Force, Json, Trust, seconds
from rig.cli.printing import draw, new
from rig.cli.recordings import Log, opened, recording, without_outputs
from rig.errors import Faults, LogError, UsageError

if TYPE_CHECKING:
    from rig.record.run import Run

Table = Annotated[Path | None, typer.Option("--csv", metavar="FILE", callback=new, help="Write all numbers as CSV.")]
First = Annotated[str | None, typer.Option("--from", metavar="TIME", help="Start of the evaluated time span.")]
Last = Annotated[str | None, typer.Option("--to", metavar="TIME", help="End of the evaluated time span.")]


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
            log: Path, figure: Path | None, trust: bool, as_json: bool, csv: Path | None = None, force: bool = False,
            **given: str | None,
        ) -> None:  # fmt: skip
            from rig.analysis import recorded
            from rig.machine.files import write_file

            run, faults = opened(log, trust), Faults()
            if nothing := without_outputs(run, log):
                raise LogError(nothing)
            asked = {
                name: faults(partial(option.read, text, option.flag, run), None)
                for name, option in self.options.items()
                if (text := given[name]) is not None
            }
            values: dict[str, Any] = {name: value for name, value in asked.items() if value is not None}
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
        run_it.__doc__, run_it.__annotations__ = self.about, kinds
        run_it.__signature__ = Signature([  # type: ignore[attr-defined]
            Parameter(name, Parameter.KEYWORD_ONLY, annotation=kind,
                      default=unset.get(kind.__origin__))
            for name, kind in kinds.items()
        ])  # fmt: skip
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
        "rig spectrum recordings/golden/pendulum.mcap --orders drive --figure spectrum.png",
    ),
    "pressure": Analysis(
        "pressure",
        "Draw maps of the contact pressure under a slider at chosen instants.",
        {
            "at": _option(
                "--at",
                "TIMES",
                'Instants, separated by commas: "0.5, 0.56 s, 600 ms". Default: chosen from the run.',
                _times,
            )
        },
        "rig pressure plate.mcap --at '0.5 s, 0.56 s, 0.6 s' --figure pressure.png",
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
        "rig hysteresis recordings/runs/belt_hysteresis-20260101-120000.mcap --window '1 s'",
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
        "rig response knock.mcap --input knock_force --output accelerometer --figure response.png",
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
        "rig portrait recordings/golden/pendulum.mcap --section 'velocity = 0' --figure portrait.png",
    ),
    "amplitude": Analysis(
        "amplitudes",
        "Compute amplitude and frequency of each measurement, stage by stage, and the speeds of first and last stick.",
        _SPAN,
        "rig amplitude recordings/runs/lever-20260101-120000.mcap --from '4 s'",
        table=False,
        show=_stages,
    ),
}


def sound(
    log: Log,
    signal: Annotated[
        str, typer.Option("--signal", metavar="SENSOR", help="Sensor whose sound is analysed. Default: the microphone.")
    ] = "",
    channel: Annotated[str, typer.Option("--channel", hidden=True)] = "",
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", callback=new, help="Write the sound to a WAV file.")
    ] = None,
    figure: Figure = None,
    trust: Trust = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Find squeals in the sound of a recording: level, frequency, times. Write a WAV file."""
    from rig.analysis.recorded.sound import hear
    from rig.machine.files import draft_of
    from rig.record.wav import write

    if channel and signal:
        raise UsageError(f"--channel {channel} and --signal {signal}: --channel is the former name of --signal; give "
                         "one of them")  # fmt: skip
    if channel:
        printing.note("--channel is now called --signal")
    heard = hear(opened(log, trust), signal or channel)
    full = None
    if out is not None:
        with draft_of(out) as draft:
            full = write(heard.v, heard.rate, draft)
    printing.result(heard, as_json, wav=out, full_scale=full, figure=figure)
    if full is not None and not as_json:
        printing.line(f"{out}: 24 bit, full scale is {full:.4g} {heard.unit}")
    draw(heard, figure)


def diff(
    first: Annotated[Path, typer.Argument(metavar="A", help="A recording.", callback=recording)],
    second: Annotated[Path, typer.Argument(metavar="B", help="Another one.", callback=recording)],
    tolerance: Annotated[
        float,
        typer.Option(
            "--tolerance", metavar="REL", help="Allowed deviation, as a share of the range of each channel: 1e-6."
        ),
    ] = 0.0,
    begin: First = None,
    end: Last = None,
    figure: Figure = None,
    trust: Trust = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Compare two recordings: scenes, channels, and measures such as period, amplitude and growth rate.

    Channels are compared at the instants that both recordings contain: equal bit
    by bit, within the tolerance, or different from an instant on. Exit code 0:
    equal or within the tolerance, 1: different. One recording may have
    additional samples between those of the other.
    """
    from rig.analysis.recorded.comparison import compare

    faults = Faults()
    low = faults(lambda: seconds(begin, "--from", 0.0), None) or 0.0
    high = faults(lambda: seconds(end, "--to"), None) or float("inf")
    _empty(faults, low, high)
    faults.raise_found()
    compared = compare(opened(first, trust), opened(second, trust), low, high, tolerance)
    printing.result(compared, as_json, figure=figure)
    draw(compared, figure)
    printing.passed(compared.agree)


COMMANDS = {
    **{name: (analysis.command(), analysis.example) for name, analysis in ANALYSES.items()},
    "sound": (sound, "rig sound recordings/runs/brake-20260101-120000.mcap --out squeal.wav --figure squeal.png"),
    "diff": (diff, "rig diff first.mcap second.mcap --tolerance 1e-6 --figure difference.png"),
}
