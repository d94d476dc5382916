"""The parameters that a study varies: values of a grid, or a distribution; and a scene with values of them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rig.analysis.axis import MOST, Axis, in_words, sweepable, unknown
from rig.analysis.studies.distributions import Distribution
from rig.bench.rig_variant import with_values
from rig.errors import SceneError, UsageError
from rig.scenes.faults import shortened
from rig.scenes.scene import Scene
from rig.units import brief, parted, si, with_units

FORM = 'expected values such as [10, 20], "10 N:30 N:5", "10 N, 20 N" or "normal(20 N, 2 N)"'
_SECTIONS = ("sensors", "controllers")


@dataclass(frozen=True)
class Factor:
    """A varied parameter: the values of `axis`, or with `distribution` values drawn from it."""

    axis: Axis
    distribution: Distribution | None = None

    @property
    def key(self) -> str:
        """Dotted key of the parameter."""
        return self.axis.key


def factors(scene: Scene, over: Mapping[str, Any]) -> tuple[Factor, ...]:
    """Return the factors of `over`: key -> values, text or distribution. Raises SceneError with every fault."""
    if not isinstance(over, Mapping):
        raise SceneError(
            scene.name, [f'over = {brief(over)}: expected keys with values, such as {{"load.force": [10, 20]}}']
        )
    known, found, faults = numbers(scene), [], []
    for key, given in over.items():
        if key not in known:
            faults.append(unknown(str(key), known, scene))
            continue
        try:
            found.append(_factor(scene, key, known[key], given))
        except (ValueError, UsageError) as fault:
            faults.append(f"{key}: {fault}")
        except SceneError as error:
            faults += error.faults
    if not over:
        faults.append(f"no parameter is varied; {FORM}")
    if faults:
        raise SceneError(scene.name, faults)
    return tuple(found)


def numbers(scene: Scene) -> dict[str, str]:
    """Return key and unit of every number of the rig, its sensors and its controllers."""
    found = dict(sweepable(scene.parameters))
    for room in _SECTIONS:
        for name, section in getattr(scene, room).items():
            found |= sweepable(section, f"{room}.{name}")
    return found


def changed(scene: Scene, values: Mapping[str, float], seed: int | None = None) -> Scene:
    """Return `scene` with values (SI) of dotted keys, and a seed. Raises SceneError if it refuses one."""
    by_part: dict[tuple[str, str], dict[str, float]] = {}
    for key, value in values.items():
        room, _, rest = key.partition(".")
        name, _, field = rest.partition(".") if room in _SECTIONS else ("", "", key)
        by_part.setdefault((room if name else "", name), {})[field] = value
    changes: dict[str, Any] = {} if seed is None else {"seed": seed}
    for (room, name), given in by_part.items():
        if not room:
            changes["parameters"] = with_values(scene.parameters, given)
        else:
            sections = changes.setdefault(room, dict(getattr(scene, room)))
            sections[name] = with_values(sections[name], given)
    return replace(scene, **changes)


def _factor(scene: Scene, key: str, unit: str, given: Any) -> Factor:
    if isinstance(given, str) and "(" in given:
        given = Distribution.parse(given)
    words = in_words(key, scene)
    if isinstance(given, Distribution):
        given.in_si(unit)  # the values have units that fit
        return Factor(Axis(key, unit, (), unit, words=words), given)
    values, shown = _spaced(given, unit) if isinstance(given, str) and ":" in given else _listed(given, unit)
    if not values:
        raise ValueError(f"the list is empty; {FORM}")
    if len(set(values)) < len(values):
        raise ValueError("a value is given twice")
    scale = 1.0 if shown == unit else si(f"1 {shown}", unit) - si(f"0 {shown}", unit)
    axis = Axis(key, unit, tuple(values), shown, scale, words)
    refused(scene, axis, values)
    return Factor(axis)


def _spaced(given: str, unit: str) -> tuple[list[float], str]:
    """The evenly spaced values of FROM:TO:COUNT in SI, and the unit in which they are shown."""
    parts = [part.strip() for part in given.split(":")]
    if len(parts) != 3 or not all(parts):
        raise ValueError(f"{shortened(given)}: {FORM}")
    count = int(parts[2]) if re.fullmatch("[0-9]{1,9}", parts[2]) else 0
    if not 2 <= count <= MOST:
        raise ValueError(f"count = {shortened(parts[2])}: must be a whole number from 2 to {MOST}")
    if any("," in part for part in parts):
        raise ValueError(f"{shortened(given)}: {FORM}; a number has a point, 0.5, not a comma")
    (low, high), shown = _listed(f"{parts[0]}, {parts[1]}", unit)
    return np.linspace(low, high, count).tolist(), shown


def _listed(given: Any, unit: str) -> tuple[list[float], str]:
    """The values of a list in SI, and the unit in which they are shown."""
    if isinstance(given, str):
        texts = with_units([part for part in map(str.strip, given.split(",")) if part])
        parts: list[Any] = [text if parted(text)[1] else _plain(text) for text in texts]
    elif isinstance(given, Iterable) and not isinstance(given, bytes | Mapping) and getattr(given, "shape", 1) != ():
        parts = list(given)
    else:
        parts = [given]
    units = {parted(part)[1] for part in parts if isinstance(part, str)} - {"", "1"}
    values = []
    for part in parts:
        value = si(part, unit)
        if not np.isfinite(value):
            raise ValueError(f"{brief(part)} is not finite")
        values.append(value)
    return values, units.pop() if len(units) == 1 else unit


def _plain(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def refused(scene: Scene, axis: Axis, values: Iterable[float], remedy: str = "") -> None:
    """Raise ValueError if the scene refuses one of the values (SI) of a parameter; `remedy` ends the message."""
    wrong = []
    for value in values:
        try:
            changed(scene, {axis.key: value})
        except SceneError as error:
            wrong.append((value, "; ".join(error.faults)))
    if wrong:
        value, why = wrong[0]
        others = f" (and {len(wrong) - 1} more values)" if len(wrong) > 1 else ""
        raise ValueError(f"{axis.text(value)}{others}: {why}{remedy}")
