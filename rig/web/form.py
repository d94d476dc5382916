"""The values of a scene as a form: key, value, unit, range, origin, and what may change while the rig runs."""

from __future__ import annotations

import types
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, Literal, NamedTuple, Union, get_args, get_origin

import numpy as np

from rig.bench.live.outcome import AUTO, Pace, keeps_up
from rig.bench.run.before import findings, meets_edge
from rig.bench.run.protocol import Protocol
from rig.controllers import controller_drives
from rig.errors import UsageError
from rig.model.assembly import Assembly
from rig.plants import PLANTS
from rig.quantities import Hand, Range, finite
from rig.scenes.explain import Value, explain
from rig.scenes.protocol import Mark, Ramp, Repeat, Set, flat
from rig.scenes.scene import Scene
from rig.scenes.sections import field_of, known, range_of
from rig.sensors.stream import AGE, streams
from rig.units import with_point
from rig.view.channels import Channels
from rig.web.picture import MovingPicture

WIDE = 20.0
"""A range that reaches beyond this multiple of the present value is not the range of a slider. # chosen"""
LEAST = 1e-6
"""Least size [SI] on a logarithmic slider beside 0. # chosen"""
_STRONG = {"gain": "gain of the controller", "amplitude": "amplitude of the controller"}
"""Values of a controller that matter at the bench, in words."""
PACES = (1e-3, 1e6)
"""Slowest and fastest pace."""
LONGEST = 1e6
"""Longest duration of a run [s]."""


def form(scene: Scene, duration: float | None = None) -> dict[str, Any]:
    """Everything that the page shows of `scene` before a run of `duration` s (None: as long as its protocol)."""
    assembly = scene.assemble()
    taken_apart = explain(scene)
    length = scene.duration_ns
    return {
        "scene": scene.name,
        "title": scene.title,
        "about": scene.about,
        "based_on": list(scene.bases),
        "notes": list(scene.notes),
        "warnings": warnings(scene, duration),
        "plant": scene.plant,
        "slow": scene.slow,
        "pace_limit": scene.clock.pace_limit,
        "duration_s": None if length is None else length / 1e9,
        "frame_s": scene.frame_ns / 1e9,
        "states": taken_apart.states,
        "effects": [
            {"name": e.name, "on": e.on, "states": e.states_text, "about": e.about} for e in taken_apart.effects
        ],
        "protocol": protocol(scene, assembly),
        "sections": sections(scene, assembly, taken_apart.values),
        "picture": picture(scene, assembly),
        "hands": {key: hand.words for key, hand in hands(scene).items()},
        "controllers": drives(scene),
    }


def drives(scene: Scene) -> dict[str, list[str]]:
    """The actuators that each controller drives."""
    return {name: list(controller_drives(section)) for name, section in scene.controllers.items()}


def hands(scene: Scene) -> dict[str, Hand]:
    """The values that matter at the bench, by key: three of the plant, controllers, the rest of the plant."""
    declared = list(PLANTS[scene.plant].__dict__.get("HANDS", {}).items())
    strong = {}
    for name, section in scene.controllers.items():
        for key, words in _STRONG.items():
            if isinstance(getattr(section, key, None), float):
                strong[f"controllers.{name}.{key}"] = Hand(words)
    return {**dict(declared[:3]), **strong, **dict(declared[3:])}


def picture(scene: Scene, assembly: Assembly) -> dict[str, Any] | None:
    """The picture of the rig before a run, with its frame in `at`; None for a plant without a picture.

    Of a drawer that fails, which a plant of the user may have, the entry `fault` says why.
    """
    system = assembly.system()
    channels = Channels((scene, assembly), {name: output.unit for name, output in assembly.outputs.items()}, {})
    try:
        moving = MovingPicture.of(scene, assembly, system, channels.colours)
        return None if moving is None else {**moving.still, "at": moving.at_rest(assembly, system)}
    except Exception as fault:
        return {"fault": f"{type(fault).__name__}: {fault}"}


def warnings(scene: Scene, duration: float | None) -> list[str]:
    """What `rig run` warns of before it starts this scene."""
    levels = ("error", "warning") if scene.clock.unstable == "run" else ("warning",)  # an error refuses the run itself
    texts = [f"{finding.what}\n{finding.remedy}" for finding in findings(scene) if finding.level in levels]
    return [*texts, *filter(None, [meets_edge(scene, duration)])]


def protocol(scene: Scene, assembly: Any) -> list[Any]:
    """The steps of the protocol in words; steps that repeat as {"times": number or "forever", "steps": [...]}."""
    units = {name: sensor.unit for name, sensor in scene.sensors.items()}
    return _steps(Protocol((), scene.frame_ns, units, assembly.inputs), scene.protocol)


def _steps(words: Protocol, steps: Sequence[Any]) -> list[Any]:
    return [_step(words, step) for step in steps]


def _step(words: Protocol, step: Any) -> Any:
    if isinstance(step, Repeat):
        return {"times": step.times, "steps": _steps(words, step.steps)}
    if isinstance(step, Mark):
        return f"mark: {step.text}"
    return words.described(step)


def sections(scene: Scene, assembly: Any, values: Sequence[Value]) -> list[dict[str, Any]]:
    """The values in tables, in the order of the scene: name of the table, entries."""
    may = known(assembly, scene.parameters, scene.sensors, scene.controllers)
    owners = {drive: name for name, section in scene.controllers.items() for drive in controller_drives(section)}
    tables: dict[str, list[dict[str, Any]]] = {}
    unseen = [f"sensors.{name}." for name, section in streams(scene.sensors).items() if section.channel == AGE]
    unseen.append("protocol[")  # it is shown in words
    of_scene = {value.key: value for value in values if not value.key.startswith(tuple(unseen))}
    for key in dict.fromkeys((*of_scene, *assembly.inputs)):
        table, _, name = key.rpartition(".")
        value = of_scene.get(key)
        actuator = assembly.inputs.get(key)
        shown = value or actuator
        entry = entry_of(scene, key, name, shown.value, shown.unit, within(scene, key, actuator))
        entry |= {"kind": "fixed", "origin": "", "note": "", "place": ""}
        if value is not None:
            entry |= kind_of(scene, key, value.value)
            entry |= {"origin": value.origin.origin, "note": value.origin.note, "place": str(value.place or "")}
        live = key in may.settable or actuator is not None
        entry |= {"live": live, "actuator": actuator is not None, "owner": owners.get(key, "")}
        tables.setdefault(table or "scene", []).append(entry)
    return [{"name": table, "values": entries} for table, entries in tables.items()]


def entry_of(
    scene: Scene, key: str, name: str, value: Any, unit: str, limits: tuple[float, float] | None
) -> dict[str, Any]:
    """One value with its limits [low, high], and its slider; null without them."""
    plain = isinstance(value, int | float) and not isinstance(value, bool)
    slider = None
    if limits and plain and np.isfinite(limits).all():
        slider = slider_of(usual(scene, key, float(value)), *limits, hands(scene).get(key))._asdict()
    return {"key": key, "name": name, "value": value, "unit": unit, "limits": limits, "slider": slider}


class Slider(NamedTuple):
    """The ends of a slider, and its least size beside 0 if its scale is logarithmic (0.0: it is linear)."""

    low: float
    high: float
    least: float = 0.0


def usual(scene: Scene, key: str, value: float) -> float:
    """`value`, or if it is 0 the largest to which the protocol moves it."""
    if value:
        return value
    moved = (step.to for step in flat(scene.protocol) if isinstance(step, Ramp | Set) and step.target == key)
    return max(moved, key=abs, default=0.0)


def slider_of(value: float, low: float, high: float, hand: Hand | None = None) -> Slider:
    """The slider of `value`: as its `hand` declares, else the whole range, or half to twice the value if it is wider.

    A value of zero in a wide range has no size to go by: its slider is logarithmic on both sides of 0.
    """
    if value and hand is not None:
        lowest, highest = sorted((hand.low * value, hand.high * value))
        return Slider(max(low, lowest), min(high, highest))
    if value == 0.0:
        return Slider(low, high, LEAST if max(high, -low) > WIDE else 0.0)
    size = abs(value)
    if high <= WIDE * size and low >= -WIDE * size:
        return Slider(low, high)
    least = 0.0 if low == 0.0 else 0.5 * size
    if value > 0.0:
        return Slider(max(low, least), min(high, 2.0 * size))
    return Slider(max(low, -2.0 * size), -least)


def within(scene: Scene, key: str, actuator: Any = None) -> tuple[float, float] | None:
    """The allowed range of a value (SI): that of its `actuator`, else of its declaration; None without any."""
    if actuator is not None:
        return actuator.low, actuator.high
    declared = range_of(*_section(scene, key))
    return (declared.low, declared.high) if isinstance(declared, Range) else None


def kind_of(scene: Scene, key: str, value: Any) -> dict[str, Any]:
    """How a value is edited: a number, a switch, a choice (with `choices`), a text, or not at all (fixed)."""
    if isinstance(value, bool | int | float):
        return {"kind": "switch" if isinstance(value, bool) else "number"}
    info = field_of(*_section(scene, key))
    choices = _choices(info.annotation) if info is not None else ()
    if choices:
        return {"kind": "choice", "choices": list(choices)}
    return {"kind": "text" if isinstance(value, str) else "fixed"}


def _choices(annotation: Any) -> tuple[str, ...]:
    if get_origin(annotation) is Literal:
        return tuple(str(choice) for choice in get_args(annotation))
    if get_origin(annotation) in (Union, types.UnionType):
        return next((choices for kind in get_args(annotation) if (choices := _choices(kind))), ())
    return ()


def _section(scene: Scene, key: str) -> tuple[Any, str]:
    """The section of a scene that contains a value, and its key there."""
    room, _, rest = key.partition(".")
    if room == "clock":
        return scene.clock, rest
    rooms: Mapping[str, Mapping[str, Any]] = {"sensors": scene.sensors, "controllers": scene.controllers}
    if room in rooms:
        name, _, inner = rest.partition(".")
        return rooms[room].get(name), inner
    return scene.parameters, key


def as_text(value: Any, key: str) -> str:
    """The value of `key` on the page as the command line would give it. Raises UsageError for what is no value."""
    if isinstance(value, str):
        return with_point(value, key)
    if isinstance(value, bool | int | float):
        return repr(value).lower()
    raise UsageError(f"{key} {value!r:.80} is not a value; expected a number, a truth value or a text such as '2 rpm'")


def plain(value: Any, name: str) -> Any:
    """What stands in the field `name`: a text that is a number becomes one; a decimal comma becomes a point.

    Raises UsageError.
    """
    if isinstance(value, str):
        value = with_point(value, name)
        with suppress(ValueError):
            return float(value)
    return value


def timing(scene: Scene, pace: Any, duration: Any) -> tuple[Pace, float | None]:
    """Pace and duration [s] (None: that of the protocol) of a run. Raises UsageError."""
    what = "pace"
    try:
        factor = _pace(plain(pace, what))
        what = "duration"
        length = None if duration in (None, "") else finite(plain(duration, what), "s")
        if length is not None and not 1e-9 <= length <= LONGEST:
            raise ValueError(f"is {length:g} s; must be 1e-09 to {LONGEST:g} s")
    except ValueError as fault:
        raise UsageError(f"the {what} {fault}") from None
    keeps_up(scene, factor)
    return factor, length


def _pace(pace: Any) -> Pace:
    """The pace that the page asks for. Raises ValueError."""
    if pace == "max":
        return None
    if pace == AUTO:
        return AUTO
    factor = 1.0 if pace in (None, "") else finite(pace, "1")
    if not PACES[0] <= factor <= PACES[1]:
        raise ValueError(f"is {factor:g}; must be {PACES[0]:g} to {PACES[1]:g}, auto or max")
    return factor
