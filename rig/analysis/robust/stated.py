"""What a user states of a design: its ranges, and what is not known of the rig. Read and checked, all faults at once.

    "friction.mu": "+-2 %"                    about the value of the scene; of a free value: its tolerance
    "shunt.delta": "-5 %:10 %", "+-0.01"      one-sided, or in its unit
    "load.force": "18 N:22 N", (18.0, 22.0)   a range
    "friction.mu": "normal(0.4, 0.02)"        a distribution: from its 0.135 % to its 99.865 % quantile

A delay in the box takes whole frames of the scene's clock.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from rig.analysis.robust.box import TAIL, Box, Limit, Uncertain, ends_of
from rig.analysis.studies.factors import IDENTIFIED, Distribution, Identified
from rig.errors import Faults, SceneError, UsageError
from rig.scenes.axis import Axis, in_words, numbers, unknown
from rig.scenes.faults import near
from rig.scenes.scene import Scene
from rig.scenes.sections import is_set_point
from rig.scenes.sections import parted as table_of
from rig.units import brief, number_or_text, parted, same_unit, si, with_units

MOST = 8
"""Most uncertain values: two levels of all of them are 256 rigs."""
_SYMMETRIC = re.compile(r"\s*(?:\+-|\+/-|±)(?P<size>[^:]+)")
_FORM = 'expected "+-2 %", "-1 %:3 %", "18 N:22 N" or "normal(20 N, 1 N)"'
# Units of what a designer of the rig chooses: stiffness, damping, mass, inertia, angle, position, size
_DESIGNED = ("N/m", "N*m/rad", "N*s/m", "N*m*s/rad", "kg", "kg*m^2", "rad", "m", "N/m^3", "N*s/m^3")
_NAMES = ("damping_ratio", "factor", "loss_factor", "ratio", "scale", "alpha", "beta")  # he chooses these as well
_ELECTRIC = ("amplifier", "piezo", "shunt")
_FACTORS = "factors"  # of parts of a matrix
# Tables without a value that eigenvalues of steady sliding depend on, and why
_WITHOUT = {
    "dither": "eigenvalues are those with dither off, or averaged over the scene's own dither",
    "faults": "a fault of a run changes no eigenvalue",
    "noise": "noise changes no eigenvalue",
    "reduction": "belongs to the computation, not to the rig",
    "sensors": "is a value of an instrument: neither designed nor varied here",
    "start": "eigenvalues of steady sliding do not depend on the start",
}
_SURROUNDINGS = ("drive", "friction", "load")  # uncertain only, but for set-points: nobody designs them
_FRAMES = ("delay", "period")  # keys of a controller that take whole frames


_TERM = re.compile(r"\s*(?P<sign>[+-]?)\s*(?:(?P<factor>\d[\d.]*(?:e[+-]?\d+)?)\s*\*?\s*)?(?P<key>[A-Za-z_][\w.]*)\s*")
_LIMITS = 'expected a sum of free keys, "spring_1.damping + 2 * spring_2.damping < 0.6 N*s/m"'


class _Range(NamedTuple):
    """Two ends in SI or, if `relative`, shares of the value of the scene; if `absolute` they are values, else
    deviations. `shown`: the unit for output.
    """

    ends: tuple[float, float]
    relative: bool
    absolute: bool
    shown: str


def box(scene: Scene, over: Mapping[str, Any], against: Mapping[str, Any]) -> Box:
    """Return the box of `scene`. `over`: free key -> range "5 ohm:300 ohm", or two numbers in SI; `against`: uncertain
    key -> range, tolerance or distribution, see the head of this file.

    Raises SceneError with every fault.
    """
    faults = Faults()
    given = {"over": over, "against": against}
    wrong = [f"{name} = {brief(each)}: expected keys with ranges" for name, each in given.items() if not _keys(each)]
    if wrong:
        raise SceneError(scene.name, wrong)
    known = numbers(scene)
    free = [faults(partial(_free, scene, key, known, each), None) for key, each in over.items()]
    uncertain = [faults(partial(_uncertain, scene, key, known, each, over), None) for key, each in against.items()]
    if len(against) > MOST:
        faults.found.append(
            f"against: {len(against)} uncertain values, and at most {MOST} can be searched; leave out those of the "
            "least influence, which a run with some of them lists"
        )
    if faults.found:
        raise SceneError(scene.name, faults.found)
    return Box(tuple(filter(None, free)), tuple(filter(None, uncertain)))


def _keys(given: Any) -> bool:
    return isinstance(given, Mapping) and all(isinstance(key, str) for key in given)


def _free(scene: Scene, key: str, known: Mapping[str, str], given: Any) -> Axis:
    """The axis of a free value with its two ends. Raises UsageError."""
    if key not in known:
        raise UsageError(f"over {unknown(key, known, scene)}")
    unit = known[key]
    if why := _not_free(scene, key, unit):
        raise UsageError(f"over {key}: {why}")
    try:
        low, high, shown = two_ends(given, unit)
        if not low < high:
            raise ValueError(f"the range must rise, from {low:g} {unit} upwards")
        return _accepted(scene, Axis(key, unit, (low, high), shown, in_words(key, scene)))
    except ValueError as fault:
        raise UsageError(f"over {key}: {fault}") from None


def _accepted(scene: Scene, axis: Axis) -> Axis:
    """The axis, if the scene accepts its ends. Raises ValueError."""
    try:
        axis.check(scene, dict.fromkeys(axis.values))
    except ValueError as fault:
        raise ValueError(f"at {fault}") from None
    return axis


def _not_free(scene: Scene, key: str, unit: str) -> str:
    """Why a key cannot be designed, in words; "" if it can."""
    room, _, inner = table_of(key)
    table, _, rest = key.partition(".")
    if table in _WITHOUT:
        return _WITHOUT[table]
    if room == "controllers":
        if inner in _FRAMES:
            sets = f"-p {key} sets it"
            return (
                f"takes whole frames, so that it has no gradient; {sets}{', --against takes it' * (inner == 'delay')}"
            )
        return ""
    if is_set_point(scene.parameters, key):
        return ""
    if table in _SURROUNDINGS:
        return f"nobody designs it; --against {key} makes it uncertain, -p sets it"
    last = rest.rpartition(".")[2]
    if table in (*_ELECTRIC, _FACTORS) or unit in _DESIGNED or last in _NAMES:
        return ""
    return (
        f"is no value that a designer sets (numbers of controllers and of a shunt, stiffness, damping, mass, angle, "
        f"position, factors of matrix parts); --against {key} makes it uncertain"
    )


def _not_uncertain(key: str) -> str:
    """Why a key cannot be uncertain, in words; "" if it can."""
    room, _, inner = table_of(key)
    table = key.partition(".")[0]
    if table in _WITHOUT:
        return _WITHOUT[table]
    if room == "controllers" and inner == "period":
        return "takes whole frames that a controller keeps exactly; -p sets it"
    return ""


def _uncertain(scene: Scene, key: str, known: Mapping[str, str], given: Any, over: Mapping[str, Any]) -> Uncertain:
    """An uncertain value. Raises UsageError."""
    if key not in known:
        raise UsageError(f"against {unknown(key, known, scene)}")
    if why := _not_uncertain(key):
        raise UsageError(f"against {key}: {why}")
    unit = known[key]
    stated = scene.values().get(key, (None, ""))[0]
    try:
        if isinstance(given, Distribution | Identified) or (isinstance(given, str) and "(" in given):
            return _distributed(scene, key, unit, given, key in over, stated)
        return _ranged(scene, key, unit, _range(given, unit), key in over, stated)
    except (ValueError, UsageError) as fault:
        raise UsageError(f"against {key}: {fault}") from None


def _ranged(scene: Scene, key: str, unit: str, given: _Range, free: bool, stated: float | None) -> Uncertain:
    """An uncertain value with a range or a tolerance. Raises ValueError, UsageError."""
    low, high = given.ends
    if not low <= high:
        raise ValueError("the range must rise")
    if free and given.absolute:
        raise ValueError('is designed: it has no range of its own; state its tolerance, "+-5 %" or "-1 %:2 %"')
    if stated is None and not given.absolute and not free:
        raise ValueError("the scene leaves it out, so that nothing deviates from it; -p states it")
    nominal = 0.5 * (low + high) if stated is None else float(stated)
    if given.relative and nominal == 0.0 and not free:
        raise ValueError("is 0 in this scene, and a share of it is 0 too; state a range FROM:TO")
    if given.absolute:
        low, high = low - nominal, high - nominal
    step = _step(scene, key)
    bare = Uncertain(Axis(key, unit, (), given.shown), nominal, (low, high), given.relative, free, step)
    ends = sorted(bare.value(share, None) for share in (0.0, 1.0))
    if step:
        exact = (nominal + low, nominal + high)
        if given.relative or any(abs(end - whole) > 1e-6 * step for end, whole in zip(exact, ends)):
            raise ValueError(
                f"a delay is searched in whole frames of {1e3 * step:g} ms; state a range of such, FROM:TO"
            )
    axis = Axis(key, unit, (ends[0], ends[1]), given.shown, in_words(key, scene))
    if not free:  # of a design outside of the scene's own values the search finds out
        axis = _accepted(scene, axis)
    return Uncertain(axis, nominal, (low, high), given.relative, free, step)


def _distributed(scene: Scene, key: str, unit: str, given: Any, free: bool, stated: float | None) -> Uncertain:
    """An uncertain value with a distribution: the box by its quantiles. Raises ValueError, UsageError."""
    if free:
        raise ValueError(f'is designed, and has no distribution of its own; state its tolerance, "+-5 %", not {given}')
    if isinstance(given, str):
        joint = given.strip().startswith(f"{IDENTIFIED}(")
        given = Identified.read(given, key) if joint else Distribution.parse(given)
    given.in_si(unit)
    if isinstance(given, Identified):
        low, high = Identified.drawn([given], np.array([[TAIL], [1.0 - TAIL]]))[:, 0].tolist()
    else:
        low, high = given.quantile(np.array(ends_of(given)), unit).tolist()
    if not low < high:
        raise ValueError(f"{given}: has no width")
    step = _step(scene, key)
    if step:
        low = math.floor(low / step) * step
        high = math.ceil(high / step) * step
    nominal = 0.5 * (low + high) if stated is None else float(stated)
    axis = _accepted(scene, Axis(key, unit, (low, high), unit, in_words(key, scene)))
    return Uncertain(axis, nominal, (low - nominal, high - nominal), step=step, given=given)


def _step(scene: Scene, key: str) -> float:
    """The step [s] of a value that takes whole frames; 0 of others."""
    return scene.frame_ns * 1e-9 if key.endswith(".delay") else 0.0


def _range(given: Any, unit: str) -> _Range:
    """What a user states of an uncertain value. Raises ValueError."""
    if isinstance(given, list | tuple) and all(isinstance(part, str) for part in given):
        given = ":".join(given)
    symmetric = _SYMMETRIC.fullmatch(given) if isinstance(given, str) else None
    if symmetric is not None:
        size = symmetric["size"].strip()
        share = _share(size)
        if share is not None:
            return _Range((-share, share), True, False, unit)
        value = number(size, unit)
        return _Range((-value, value), False, False, parted(size)[1] or unit)
    if isinstance(given, str) and "%" in given and unit != "%":
        shares = [_share(part) for part in given.split(":")]
        if len(shares) == 2 and None not in shares:
            low, high = (float(share) for share in shares if share is not None)
            return _Range((low, high), True, False, unit)
        raise ValueError(f"is {brief(given)}; {_FORM}")
    low, high, shown = two_ends(given, unit)
    return _Range((low, high), False, True, shown)


def _share(text: str) -> float | None:
    """The share that a text such as "2 %" states; None if it has no such unit."""
    number, percent, rest = text.strip().rpartition("%")
    if not percent or rest:
        return None
    value = number_or_text(number.strip())
    if isinstance(value, str) or not math.isfinite(value):
        raise ValueError(f"is {brief(text)}; {_FORM}")
    return value / 100.0


def two_ends(given: Any, unit: str, form: str = _FORM) -> tuple[float, float, str]:
    """Return both ends of a range "FROM:TO", or of two numbers, in SI, and the unit for output. Raises ValueError."""
    form = f"is {brief(given)}; {form}"
    shown = unit
    if isinstance(given, str):
        parts: Sequence[Any] = [part.strip() for part in given.split(":")]
        if len(parts) != 2 or not all(parts) or "," in given:
            raise ValueError(form)
        units = {parted(part)[1] for part in parts} - {"", "1"}
        parts = with_units(parts)
        shown = units.pop() if len(units) == 1 else unit
    elif isinstance(given, Sequence | np.ndarray) and len(given) == 2:
        parts = list(given)
    else:
        raise ValueError(form)
    low, high = (number(part, unit) for part in parts)
    return low, high, shown


def number(given: Any, unit: str) -> float:
    """Return a number in SI, or a text with its unit or without, as a number in SI. Raises ValueError."""
    value = si(number_or_text(given) if isinstance(given, str) and not parted(given)[1] else given, unit)
    if not math.isfinite(value):
        raise ValueError(f"{brief(given)} is not finite")
    return value


def limits(box: Box, given: Iterable[str]) -> tuple[Limit, ...]:
    """Return the limits of a design. Raises UsageError with every fault."""
    faults = Faults()
    texts = [given] if isinstance(given, str) else [*given]
    read = [faults(partial(_limit, box, text), None) for text in texts]
    faults.raise_found()
    return tuple(limit for limit in read if limit is not None)


def _limit(box: Box, text: str) -> Limit:
    parts = re.split(r"\s*([<>])=?\s*", text) if isinstance(text, str) else []
    if len(parts) != 3:
        raise UsageError(f"limit {brief(text)}: {_LIMITS}")
    terms, sense, level = parts
    keys = {axis.key: i for i, axis in enumerate(box.free)}
    weights = np.zeros(len(keys))
    units: list[str] = []
    at = 0
    while at < len(terms):
        term = _TERM.match(terms, at)
        if term is None or (at and not term["sign"]):
            raise UsageError(f"limit {text}: {_LIMITS}; limits are linear")
        key = term["key"]
        if key not in keys:
            raise UsageError(
                f"limit {text}: {key} is not free; {near(key, keys) if keys else 'nothing is: add --over'}"
            )
        weights[keys[key]] += (-1.0 if term["sign"] == "-" else 1.0) * float(term["factor"] or 1.0)
        units.append(box.free[keys[key]].unit)
        at = term.end()
    if not units or not all(same_unit(units[0], unit) for unit in units):
        raise UsageError(f"limit {text}: a sum of {' and '.join(dict.fromkeys(units)) or 'nothing'}; expected one unit")
    try:
        bound = si(level, units[0])
    except ValueError as fault:
        raise UsageError(f"limit {text}: {fault}") from None
    if sense == ">":
        weights, bound = -weights, -bound
    low, high = np.array([axis.values for axis in box.free]).T
    scale = float(np.abs(weights) @ np.maximum(np.abs(low), np.abs(high))) or 1.0
    slope = weights * (high - low) / scale
    limit = Limit(text, slope, (float(weights @ low) - bound) / scale, weights, bound)
    if limit.excess(np.where(slope < 0.0, 1.0, 0.0)) > 0.0:
        raise UsageError(f"limit {text}: no design within the ranges keeps it; widen a range or the limit")
    return limit
