"""What several commands take.

Commands: their help shows an option that takes no value without a type, and their faults are in our words.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import BadParameter
from typer.core import TyperCommand, TyperGroup

from rig.cli import printing
from rig.cli.printing import named as not_empty
from rig.cli.printing import new_recording, reads
from rig.errors import UsageError
from rig.parameters import Argument, Option
from rig.units import number_or_text, with_point

if TYPE_CHECKING:
    from rig.bench.live.outcome import Pace as LivePace
    from rig.record.windows import Trigger
    from rig.scenes.places import Place
    from rig.scenes.scene import Scene

_EXAMPLES = {
    "--against": 'KEY=RANGE, e.g. --against "friction.mu=+-2 %"',
    "--over": 'KEY=VALUES, such as --over "load.force=10 N:30 N:5"',
    "--follow": 'ACTUATOR = CHANNEL: "drive.speed = belt_speed"',
    "--pair": 'CHANNEL = SIMULATED: "force = friction_force"',
}
"""Option -> how it is written."""
SHORTEST, LONGEST = 1e-9, 1e6
"""Shortest and longest time [s] that can be asked for."""
PACES = (1e-3, 1e6)
"""Slowest and fastest pace."""


class _Flags:
    """Removes the type `<bool>` behind flags in the help, which would invite a value: `--view true`.

    Texts, and what is not given, are not converted: typer imports pydantic for that, which takes 70 ms.
    """

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters, flags with an empty type."""
        parameters: list[Any] = super().get_params(ctx)  # type: ignore[misc]
        for parameter in parameters:
            if getattr(parameter, "is_flag", False):
                parameter.metavar = ""
            parameter.process_value = partial(_converted, parameter)
        return parameters

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the arguments. Raises typer.BadParameter, which states what was given and what is allowed."""
        try:
            return super().parse_args(ctx, args)  # type: ignore[misc, no-any-return]
        except BadParameter as error:
            from pydantic import ValidationError  # only where something is wrong: start-up counts

            from rig.quantities import faults_of

            if isinstance(cause := error.__cause__, ValidationError):
                error.message = "; ".join(f"{fault} (given: {given})" for _, fault, given in faults_of(cause))
            raise


def _converted(parameter: Any, ctx: Any, value: Any) -> Any:
    kind = parameter.type_descriptor.annotation
    several = parameter.multiple or parameter.nargs == -1
    if several and kind == list[str] and (value or not parameter.required):
        value = [*(value or ())]
    elif several or not ((kind is str and isinstance(value, str)) or (value is None and not parameter.required)):
        return type(parameter).process_value(parameter, ctx, value)
    return parameter.callback(ctx, parameter, value) if parameter.callback else value


class Command(_Flags, TyperCommand):
    """A command."""


class Group(_Flags, TyperGroup):
    """A command with commands below it."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command that the first argument names. Raises UsageError, which names those that are like it."""
        if args and self.get_command(ctx, args[0]) is None and not ctx.resilient_parsing:
            from rig.scenes.faults import near

            known = self.list_commands(ctx)
            below = [name for name in known if args[0] in getattr(self.get_command(ctx, name), "commands", ())]
            longer = [f"{name} {args[0]}" for name in below] or [name for name in known if name.startswith(args[0])]
            hint = f"did you mean {' or '.join(longer)}?" if longer else near(args[0], known, f"{ctx.command_path} -h")
            raise UsageError(f"{ctx.command_path} has no command {args[0]!r:.60}: {hint}")
        return super().resolve_command(ctx, args)


def scene_file(context: typer.Context, name: str | None) -> str | None:
    """The name of a scene; one of a file is not to be overwritten."""
    if name is not None:
        reads(context, Path(name))
    return name


def recording(context: typer.Context, path: Path | None) -> Path | None:
    """Check the path of a recording: no folder, pipe or device. Whoever reads it reports a file that does not exist."""
    from rig.machine.files import regular

    if path is not None:
        not_empty("recording", path)
        try:
            regular(path)
        except FileNotFoundError:
            pass
        except OSError as error:
            raise UsageError(f"{path}: cannot be read: {error.strerror}") from None
        reads(context, path)
    return path


def ticket_file(path: Path | None) -> Path | None:
    """Check the path of a ticket: "" would be no ticket, and another run."""
    if path is not None:
        not_empty("--ticket", path)
    return path


SceneName = Annotated[str, Argument("SCENE", "Name of a shipped scene (see rig list), or a TOML file.")]


def paired(parameter: typer.CallbackParam, given: list[str] | None) -> list[str] | None:
    """Check that each `-p` has a key and a value; before the arguments are counted, where -p KEY VALUE has one more."""
    option = parameter.opts[0]
    for text in given or []:
        key, equals, _ = text.partition("=")
        if not equals or not key.strip():
            example = f'{option} drive.speed="2 rpm"'
            raise UsageError(f'{option} {text}: expected KEY=VALUE with "=" between them, e.g. {example}')
    return given


Net = Annotated[
    list[str] | None,
    Option(
        "LINK: FAULTS",
        'Make a link between plant and controllers worse: "meas/vibrometer: delay 2 ms, jitter 0.5 ms, loss 1 %, '
        'duplicate 0.1 %, reorder; seed 3", or "act/CONTROLLER: ...". Short for -p network... . Repeatable.',
        "--net",
    ),
]
Out = Annotated[
    Path | None,
    Option("FILE", "Recording to write (MCAP). Default: a new file in recordings/runs.", check=new_recording),
]
RunName = Annotated[str | None, Option("RUN", "Name of the run. Default: the only live run.", "--run")]
Ticket = Annotated[
    Path | None,
    Option(
        "FILE",
        "Ticket of a run on another host (rig run --listen). Default: the file that RIG_TICKET names, if any.",
        "--ticket",
        check=ticket_file,
    ),
]
NewName = Annotated[str | None, Option("RUN", "Name of the run.", "--run")]
Pace = Annotated[
    str | None,
    Option(
        "FACTOR",
        'Real-time factor: simulated seconds per second; "auto": 1, or the largest that holds on this machine; '
        '"max". Default: 1; with --lockstep: max.',
        "--pace",
    ),
]
Lockstep = Annotated[
    bool, Option("", "Wait for every controller at every step, instead of following the wall clock.", "--lockstep")
]
Wait = Annotated[float, Option("TIME", "Longest wait for the run, in seconds or with a unit.", low=0)]
When = Annotated[
    str | None,
    Option(
        "CONDITION",
        'Record only around the instants at which a sensor or plant output is beyond a level: "vibrometer > 0.1 '
        'm/s"; < for below, |NAME| for the absolute value. Writes NAME-001.mcap, NAME-002.mcap, ...',
        "--trigger",
    ),
]
Before = Annotated[float | None, Option("TIME", "With --trigger: recorded time before it. Default: 2 s.", low=0)]
After = Annotated[float | None, Option("TIME", "With --trigger: recorded time after it. Default: 5 s.", low=0)]
Most = Annotated[
    int | None, Option("N", "With --trigger: largest number of recordings. Default: 100.", low=1, high=999)
]
Budget = Annotated[
    str | None,
    Option(
        "SHARE", "Share of a frame that computing may take (99th percentile): 40%. Selects method and step.", "--budget"
    ),
]
Accuracy = Annotated[
    float | None,
    Option(
        "ERROR",
        "Target relative error, e.g. 1e-4. Selects the cheapest method and step that rig cost measured here.",
        "--accuracy",
    ),
]


def refuse_all(*mistakes: tuple[object, str]) -> None:
    """Raise UsageError with the text of every mistake that was made, all at once; each is a condition and its text."""
    if texts := [text for made, text in mistakes if made]:
        raise UsageError("\n".join(texts))


def separated(names: str | None) -> list[str]:
    """The names in a text, separated by commas."""
    return [name.strip() for name in (names or "").split(",") if name.strip()]


def changes(given: list[str] | None, option: str = "-p") -> dict[str, str]:
    """Dotted key -> value as text, of all `-p`."""
    pairs = (text.partition("=") for text in given or [])
    return {key.strip(): with_point(value.strip(), f"{option} {key.strip()} =") for key, _, value in pairs}


def assigned(given: Iterable[str] | None, option: str) -> dict[str, str]:
    """Name -> text of all options "NAME = TEXT" with this name. Raises UsageError."""
    texts: dict[str, str] = {}
    for assignment in given or ():
        name, _, text = (part.strip() for part in assignment.partition("="))
        if not name or not text:
            raise UsageError(f"{option} {assignment}: expected {_EXAMPLES[option]}")
        if name in texts:
            raise UsageError(f"{option} {assignment}: {name} is given twice")
        texts[name] = text
    return texts


def named(given: Iterable[str] | None) -> dict[str, str]:
    """Name -> file of all `--controller`; "" for one that is named without a file. Raises UsageError."""
    files: dict[str, str] = {}
    for text in given or ():
        name, equals, file = text.partition("=")
        if not equals or "/" in name:
            name, file = (text, "") if text.isidentifier() else (Path(text).stem, text)
        if not name.isidentifier() or (equals and not file):
            raise UsageError(
                f"--controller {text}: expected FILE, or NAME=FILE with a name of letters, digits and _, "
                "or the NAME of a controller of the scene"
            )
        if name in files:
            raise UsageError(f"--controller {text}: {name} is given twice")
        files[name] = file
    return files


def added(given: Iterable[str] | None) -> dict[str, object]:
    """The changes of a scene by all `--controller` with a file. Raises UsageError for what names no file."""
    files = {name: file for name, file in named(given).items() if file}
    if not files:
        return {}
    from rig.scenes.sections import changes as with_files

    return with_files(files)


def check_controllers(given: Iterable[str] | None, scene: Scene) -> None:
    """Raise UsageError for a --controller that `scene` does not have."""
    for name in named(given):
        if name not in scene.controllers:
            known = ", ".join(scene.controllers) or "none"
            raise UsageError(
                f"--controller {name}: {scene.name} has no controller {name}; there are: {known}. "
                f"One from a file is {name}=FILE"
            )


def linked(net: list[str] | None, given: Mapping[str, str]) -> dict[str, str]:
    """Dotted key -> value as text, of all `--net`; `given`: those of -p, which may not give the same keys."""
    if not net:
        return {}
    from rig.scenes.network import keys

    return keys(net, given)


def the_scene(
    name: str,
    given: Mapping[str, object],
    options: Mapping[str, Mapping[str, object]] | None = None,
    untold: Mapping[str, object] | None = None,
    redesign: bool = False,
) -> Scene:
    """The scene of a command with the changes `given` with -p; `options`: other option -> its changes; -p wins.

    `untold`, `redesign`: what its controllers believe of the rig (rig.scenes.belief). Values that a change dropped are
    reported on stderr.
    """
    from rig.scenes import load
    from rig.scenes.belief import believing

    overrides: dict[str, object] = {}
    places: dict[str, Place] = {}
    for option, changed in {**(options or {}), "-p": given}.items():
        overrides |= changed
        places |= with_option(option, changed)
    scene = load(name, overrides, places)
    for line in scene.notes:
        printing.note(line)
    return believing(scene, untold or {}, redesign)


def with_option(option: str, keys: Iterable[str]) -> dict[str, Place]:
    """The place of each of these keys, which `option` changes."""
    from rig.scenes.places import Place

    return dict.fromkeys(keys, Place(f"with {option}", 0))


def number(given: str, option: str, unit: str, low: float, high: float, also: str = "") -> float:
    """A number from `low` to `high`, plain or with a unit. Raises UsageError; `also`: what else may be said."""
    from rig.units import brief, si

    given = with_point(given, option)
    try:
        value = si(number_or_text(given), unit)
    except ValueError as error:
        raise UsageError(f"{option} {error}{also}") from None
    if not low <= value <= high:
        allowed = f"{low:g} to {high:g}" + ("" if unit == "1" else f" {unit}")
        raise UsageError(f"{option} {brief(given)[1:-1]}: must be {allowed}{also}")
    return value


def seconds(given: str, option: str, low: float = SHORTEST) -> float:
    """A duration in seconds; a plain number is seconds."""
    return number(given, option, "s", low, LONGEST, ', such as 2.5 or "500 ms"')


def trigger(when: str | None, before: float | None, after: float | None, most: int | None) -> Trigger | None:
    """The trigger of a recorder; None without a condition. Raises UsageError."""
    if when is None:
        given = {"--before": before, "--after": after, "--most": most}
        if alone := [name for name, value in given.items() if value is not None]:
            raise UsageError(f'{alone[0]}: needs --trigger, such as --trigger "vibrometer > 0.1 m/s"')
        return None
    from rig.record.windows import Trigger, condition

    earlier = 2.0 if before is None else before
    later = 5.0 if after is None else after
    return Trigger(condition(when), earlier, later, most or 100)


def pace(given: str, others: str = ', or "max"') -> float | None:
    """Simulated seconds for each second of the clock; None for as fast as it goes. `others`: words that it may be."""
    return None if given == "max" else number(given, "--pace", "1", *PACES, others)


def live_pace(given: str | None, lockstep: bool) -> LivePace:
    """The pace of a live run; by default 1, in lockstep as fast as it goes."""
    if given is None:
        return None if lockstep else 1.0
    return "auto" if given == "auto" else pace(given, ', "auto" or "max"')


def share(given: str | None) -> float | None:
    """A share of a frame: "40%" or "0.4"."""
    if given is None:
        return None
    return number(given.strip(), "--budget", "1", 1e-6, 1.0, ", a share of a frame such as 40%")


def at(folder: Path) -> Path:
    """A folder that exists or can be made, and be written to."""
    try:
        existing = next(path for path in (folder, *folder.parents) if path.exists())
    except OSError as fault:  # a name that is too long
        raise UsageError(f"--out {folder} cannot be written: {fault.strerror}") from None
    if not existing.is_dir():
        what = "is a file" if existing == folder else f"{existing} is a file"
        raise UsageError(f"--out {folder}: {what}; expected a folder (it is made if it does not exist)")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise UsageError(f"--out {folder} cannot be written: you may not write to {existing}; name another folder")
    return folder


def accuracy(given: float | None, option: str) -> float | None:
    """A relative error."""
    if given is not None and not 1e-15 <= given < 1.0:
        raise UsageError(f"{option} {given:g}: expected a relative error of at least 1e-15 and below 1, as 1e-4")
    return given
