"""An axis of a sweep: one parameter of the rig at evenly spaced values, parsed from the user's text.

    drive.speed=0.05 m/s:0.4 m/s:50      drive.speed=0:8 rpm:81      load.force=10:30:21

An end without a unit takes the unit of the other end. If neither has a unit, the numbers are SI. A figure over axes
names what it holds constant.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from rig.errors import SceneError
from rig.printable import counted, with_unit
from rig.results import Column
from rig.scenes.belief import varied
from rig.scenes.faults import near, shortened, shown, unit_of
from rig.scenes.scene import Scene
from rig.scenes.sections import PARTS
from rig.units import parted, si, with_point

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
MOST = 100_000
"""Largest number of values of one axis."""
POINTS = 10_000_000
"""Largest number of points of all axes together."""
FORM = 'expected KEY=FROM:TO:COUNT, e.g. drive.speed="0.05 m/s:0.4 m/s:50"'
_LETTERS = 12.0  # letters of the second line in an inch


@dataclass(frozen=True)
class Axis:
    """Parameter `key` at `values` (SI, in `unit`), in the given order. `shown` is the unit for output.

    `words`: the parameter in words, for a figure.
    """

    key: str
    unit: str
    values: tuple[float, ...]
    shown: str
    words: str = ""

    @classmethod
    def parse(cls, text: str, scene: Scene, controller: str = "", count: int = 0) -> Self:
        """Parse `text` as an axis of `scene`, or of its `controller`; `count`: of values, for a text without it.

        Raises SceneError with every fault.
        """
        key, equals, rest = text.partition("=")
        parts = [with_point(part.strip(), key) for part in rest.split(":")]
        key = key.strip()
        if count and len(parts) == 2:
            parts.append(str(count))
        if not equals or not key or len(parts) != 3 or not all(parts):
            raise SceneError(shortened(text), [FORM.replace(":COUNT", "").replace(":50", "") if count else FORM])
        known = numbers(scene, [f"controllers.{controller}"])
        faults = [] if key in known else [unknown(key, known, scene)]
        try:
            values_in_all = value_count(parts[2])
        except ValueError as error:
            faults.append(str(error))
        if key not in known:
            raise SceneError(shortened(text), faults)
        unit = known[key]
        shown = next((u for _, u in map(parted, parts[:2]) if u), unit)
        ends = []
        for name, part in zip(("from", "to"), parts):
            try:
                ends.append(si(part if parted(part)[1] else f"{part} {shown if shown != '1' else ''}".strip(), unit))
            except ValueError as error:
                faults.append(f"{name} {error}")
        if len(ends) == 2 and ends[0] == ends[1]:
            faults.append(f"from {parts[0]} to {parts[1]}: the ends are the same; -p {key}=... sets a single value")
        if faults:
            raise SceneError(shortened(text), faults)
        whole = bool(np.isfinite(ends).all())  # else the values between are undefined, and the scene refuses the ends
        values = np.linspace(ends[0], ends[1], values_in_all).tolist() if whole else ends
        return cls(key, unit, tuple(values), shown, in_words(key, scene)).accepted(text, scene)

    @classmethod
    def of(cls, key: str, values: Iterable[float], scene: Scene, controller: str = "") -> Self:
        """Make the axis of `key` of `scene` or of its `controller` from values in SI, rising or falling.

        Raises SceneError with every fault.
        """
        known = numbers(scene, [f"controllers.{controller}"])
        along = tuple(float(value) for value in values)
        faults = [] if key in known else [unknown(key, known, scene)]
        steps = np.diff(along)
        if not 2 <= len(along) <= MOST:
            faults.append(f"{counted(len(along), 'value')}: must be from 2 to {MOST}")
        elif not (np.all(steps > 0.0) or np.all(steps < 0.0)):
            faults.append("values must rise or fall throughout")
        if faults:
            raise SceneError(key, faults)
        return cls(key, known[key], along, known[key], in_words(key, scene)).accepted(key, scene)

    def accepted(self, text: str, scene: Scene) -> Self:
        """Return the axis. Raises SceneError if the scene refuses one of the values."""
        try:
            self.check(scene, self.values)
        except ValueError as fault:
            raise SceneError(shortened(text), [f"{self.key} = {fault}"]) from None
        return self

    def check(self, scene: Scene, values: Iterable[float], remedy: str = "") -> None:
        """Raise ValueError if the scene refuses one of the values (SI); `remedy` ends the message."""
        refused = []
        for value in values:
            try:
                self.at(scene, value)
            except SceneError as error:
                refused.append((value, "; ".join(error.faults)))
        if refused:
            value, why = refused[0]
            others = f" (and {len(refused) - 1} more values)" if len(refused) > 1 else ""
            raise ValueError(f"{self.text(value)}{others}: {why}{remedy}")

    def at(self, scene: Scene, value: float) -> Scene:
        """Return `scene` with this parameter at `value` (SI). Raises SceneError if the scene refuses the value."""
        return varied(scene, {self.key: value})

    @cached_property
    def scale(self) -> float:
        """SI value of one `shown`."""
        return 1.0 if self.shown == self.unit else si(f"1 {self.shown}", self.unit) - si(f"0 {self.shown}", self.unit)

    def idle(self, scene: Scene) -> str:
        """Why the parameter changes nothing in a rig that runs no protocol: its effect is off. "" if it is on."""
        table, _, value = self.key.partition(".")
        section = getattr(scene.parameters, table, None)
        switch = getattr(getattr(section, "declares", None), "switch", "")
        if not switch or value == switch or getattr(section, switch):
            return ""
        return (
            f"{self.key} has no effect: {table} is off at the start of {scene.name} ({table}.{switch} = false)\n"
            f"  add -p {table}.{switch}=true"
        )

    def text(self, value: float, digits: int = 6) -> str:
        """Return a value (SI) as text in the unit `shown`."""
        return f"{value / self.scale:.{digits}g} {self.shown_unit}".rstrip()

    @property
    def shown_unit(self) -> str:
        """The unit `shown` beside a number; "" for one without a unit."""
        return "" if self.shown == "1" else self.shown

    @property
    def label(self) -> str:
        """The key with its unit, for a table."""
        return with_unit(self.key, self.shown)

    def column(self, name: str = "", digits: str = ".6g") -> Column:
        """Return the column `name`, by default the key, of a table with values in SI and texts in the unit `shown`."""
        return Column(name or self.key, self.unit, digits, self.shown, self.scale)

    @property
    def title(self) -> str:
        """The parameter in words with its unit, for a figure."""
        return with_unit(self.words or self.key, self.shown)

    @property
    def shown_values(self) -> Array:
        """The values in the unit `shown`, for a figure."""
        return np.array(self.values) / self.scale


def axes(scene: Scene, given: Mapping[str, str | None], controller: str = "") -> list[Axis]:
    """Parse the axes of those options (`--x`, `--y`) that were given. Raises SceneError with all their faults.

    `controller`: the controller whose numbers may be swept too.
    """
    parsed = []
    faults = []
    for option, text in given.items():
        if text is None:
            continue
        try:
            parsed.append(Axis.parse(text, scene, controller))
        except SceneError as error:
            faults += [f"{option} {text}: {fault}" for fault in error.faults]
    keys = [axis.key for axis in parsed]
    repeated = {key for key in keys if keys.count(key) > 1}
    faults += [f"{key}: is on more than one axis" for key in repeated]
    points = math.prod(len(axis.values) for axis in parsed)
    if points > POINTS:
        faults.append(f"{points} points: must be at most {POINTS}; fewer values on one of the axes")
    if faults:
        raise SceneError(scene.name, faults)
    return parsed


def value_count(text: str) -> int:
    """Read the number of values of an axis. Raises ValueError."""
    if re.fullmatch("[0-9]{1,9}", text) and 2 <= int(text) <= MOST:
        return int(text)
    raise ValueError(f"count = {shortened(text)}: must be a whole number from 2 to {MOST}")


def numbers(scene: Scene, parts: Iterable[str] | None = None) -> dict[str, str]:
    """Return key and unit of every number of the rig and of `parts`, such as controllers.nf; None: of all parts."""
    units = dict(sweepable(scene.parameters))
    for room in PARTS:
        for name, section in getattr(scene, room).items():
            if parts is None or f"{room}.{name}" in parts:
                units |= sweepable(section, f"{room}.{name}")
    return units


def unknown(key: str, known: Iterable[str], scene: Scene) -> str:
    """The fault of a key that is no number of a scene: names that are like it, or how a choice is changed."""
    at: Any = scene if key.partition(".")[0] in PARTS else scene.parameters
    for part in key.split("."):
        at = at.get(part) if isinstance(at, Mapping) else getattr(at, part, None)
    if isinstance(at, bool | str):
        return f"{key}: is {shown(at)} here, not a number; -p {key}=... changes it"
    return f"{shortened(key)}: is not a numeric parameter of this scene; {near(key, known)}"


def sweepable(section: BaseModel, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yield (dotted key, unit) of every number of a section and of its subsections, including omitted optional ones."""
    for name, info in type(section).model_fields.items():
        value = getattr(section, name)
        key = f"{prefix}.{name}" if prefix else name
        if isinstance(value, BaseModel):
            yield from sweepable(value, key)
        elif isinstance(value, dict):
            for entry, part in value.items():
                if isinstance(part, BaseModel):
                    yield from sweepable(part, f"{key}.{entry}")
                elif isinstance(part, float) and unit_of(info):
                    yield f"{key}.{entry}", unit_of(info)
        elif (value is None or (isinstance(value, float | int) and not isinstance(value, bool))) and unit_of(info):
            yield key, unit_of(info)


def in_words(key: str, scene: Scene, declared: bool = False) -> str:
    """A parameter in words: the title that its field declares, else its key without dots and underscores.

    `declared`: "" without a title.
    """
    room, _, rest = key.partition(".")
    of_parts = room in PARTS
    *path, name = (rest if of_parts else key).split(".")
    section: Any = getattr(scene, room) if of_parts else scene.parameters
    for part in path:
        section = section[part] if isinstance(section, Mapping) else getattr(section, part)
    title = "" if isinstance(section, Mapping) else type(section).model_fields[name].title
    return title or ("" if declared else " ".join([*path, name]).replace("_", " "))


def main(scene: Scene) -> dict[str, tuple[str, str]]:
    """Return the main parameters of `scene` by key: each in words with its value, and in words.

    Main are those whose field declares words for them: speed of the drive, load, coefficients of friction.
    """
    values = scene.values()
    shown = {}
    for key, unit in sweepable(scene.parameters):
        words = in_words(key, scene, declared=True)
        if words and values[key][0] is not None:
            shown[key] = f"{words} {values[key][0]:.4g}{'' if unit == '1' else f' {unit}'}", words
    return shown


def fixed(scene: Scene, axes: Iterable[Axis]) -> str:
    """Return the main parameters of `scene` that are on none of the axes, with their values."""
    varied = {axis.key for axis in axes}
    return ", ".join(words for key, (words, _) in main(scene).items() if key not in varied)


def heading(figure: Figure, scene: Scene, axes: Iterable[Axis], what: str) -> None:
    """Write the title, the scene and `what` is shown of it, and below it what is held constant."""
    constant = fixed(scene, axes)
    figure.suptitle(f"{scene.name}: {what}", x=0.01, ha="left")
    if constant:
        text = textwrap.fill(f"fixed: {constant}", round(_LETTERS * figure.get_figwidth()))
        figure.get_axes()[0].set_title(text, loc="left", fontsize=10)
