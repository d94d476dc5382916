"""What a user asks for: free values, what is not known of the rig, measure and limits; all faults are told at once.

    "friction.mu": "+-2 %"                    about the value of the scene; of a free value: its tolerance
    "shunt.delta": "-5 %:10 %", "+-0.01"      one-sided, or in its unit
    "load.force": "18 N:22 N", (18.0, 22.0)   a range
    "friction.mu": "normal(0.4, 0.02)"        a distribution: from its 0.135 % to its 99.865 % quantile

A delay in the box takes whole frames of the scene's clock.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import scipy
from annotated_types import Ge

from rig.analysis.pool import Work, digest
from rig.analysis.robust.box import Box, Limit, Uncertain, ends_of
from rig.analysis.robust.design import AUDIT
from rig.analysis.robust.growth import LOOP, MODES, Growth
from rig.analysis.robust.series import checked
from rig.analysis.robust.tasks import CHUNK, Computer
from rig.analysis.studies.factors import IDENTIFIED, Distribution, Identified, drawn, listed, pair, ranges
from rig.analysis.studies.runs import MOST as MOST_UNITS
from rig.analysis.studies.runs import first_seed
from rig.controllers import controller_class
from rig.errors import Faults, SceneError, UsageError
from rig.quantities import Condition, finite
from rig.scenes.axis import Axis, in_words, numbers, unknown
from rig.scenes.faults import near
from rig.scenes.scene import Scene
from rig.scenes.sections import is_set_point
from rig.scenes.sections import parted as table_of
from rig.units import brief, number_or_text, same_unit

MOST = 8
"""Most uncertain values: two levels of all of them are 256 rigs."""
TOLERANCE = "tolerance"
_MEASURES = f"{MODES} or {LOOP} to minimise, or {TOLERANCE} or {TOLERANCE}.KEY to maximise"
_BANDS = 'expected two frequencies, "2 kHz:5 kHz"'
_ROUND = 20  # units of work in a round of a search, about,
_ROUNDS = 12  # rounds of a design,
_SEARCHES = 6  # and searches for a tolerance
_SYMMETRIC = re.compile(r"\s*(?:\+-|\+/-|±)\s*(?P<size>[^:]+?)\s*")
_FORM = 'expected "+-2 %", "-1 %:3 %", "18 N:22 N" or "normal(20 N, 1 N)"'
# Units of what a designer of the rig chooses: stiffness, damping, mass, inertia, angle, position, size
_DESIGNED = ("N/m", "N*m/rad", "N*s/m", "N*m*s/rad", "kg", "kg*m^2", "rad", "m", "N/m^3", "N*s/m^3")
_NAMES = ("damping_ratio", "factor", "loss_factor", "ratio", "scale", "alpha", "beta")  # he chooses these as well
_TABLES = ("amplifier", "piezo", "shunt", "factors")  # and all numbers of these
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
_WHOLE = 1e-6  # of a frame, by which the end of a delay may miss it
_TERM = re.compile(r"\s*(?P<sign>[+-]?)\s*(?:(?P<factor>\d[\d.]*(?:e[+-]?\d+)?)\s*\*?\s*)?(?P<key>[A-Za-z_][\w.]*)\s*")
_LIMITS = 'a sum of free keys, "spring_1.damping + 2 * spring_2.damping < 0.6 N*s/m"'


@dataclass(frozen=True)
class Job:
    """A robust design of `scene`: the values of `box`, the `measure` (modes.growth, loop.growth), the `band` [Hz].

    `tolerance`: the growth is not made small, but the range of this key (or, "", of all keys) large, at which nothing
    grows, or decays with `decay` [1/s]; None: the growth is. `series`: of the components of the design; "": any value.
    """

    scene: Scene = field(repr=False)
    box: Box
    measure: str
    band: tuple[float, float]
    limits: tuple[Limit, ...]
    tolerance: str | None
    decay: float
    seed: int
    series: str = ""

    @property
    def target(self) -> float:
        """The largest growth [1/s] that a tolerance allows."""
        return -self.decay

    @property
    def number(self) -> int | None:
        """Number of the uncertain value whose tolerance is searched; None: all."""
        return self.box.keys.index(self.tolerance) if self.tolerance else None

    @property
    def expected(self) -> int:
        """Number of units of work that the search takes, about."""
        audits, rounds = (2, _ROUNDS) if self.box.free else (1, 1)
        searches = 1 if self.tolerance is None else _SEARCHES
        return audits * AUDIT // CHUNK + searches * rounds * _ROUND

    @property
    def work(self) -> Work:
        """Its units as a work (rig.analysis.pool)."""
        files = [value.given.content for value in self.box.uncertain if isinstance(value.given, Identified)]
        identity = digest(self.scene, repr([self, AUDIT, *files, scipy.__version__]))
        return Work(Computer(self.grown, self.limits, self.target), range(MOST_UNITS), self.scene.name, identity)

    def grown(self) -> Growth:
        """The growth of its rigs."""
        return Growth(self.scene, self.box, self.measure, self.band)


def prepared(
    scene: Scene,
    over: Mapping[str, Any],
    against: Mapping[str, Any],
    minimise: Any = None,
    maximise: Any = None,
    band: Any = None,
    limit: Iterable[str] | None = None,
    decay: Any = None,
    seed: int | None = None,
    series: str | None = None,
) -> Job:
    """Return a checked design of `scene`; see `rig.optimise`. Raises SceneError, UsageError with every fault."""
    if not against:
        raise UsageError(
            "band, limit, decay, series and prove belong to a design against what is not known of the rig; state that "
            'as well: --against "friction.mu=+-2 %"'
        )
    faults = Faults()
    nothing: tuple[str, str | None] = (MODES, None)
    values = faults(lambda: box(scene, over, against), Box((), ()))
    measure, key = faults(lambda: _measure(scene, values, minimise, maximise), nothing)
    within = faults(lambda: _band(band), (0.0, math.inf))
    least = faults(lambda: _decay(decay, key), 0.0)
    first = faults(lambda: first_seed(scene, seed), 0)
    kept: tuple[Limit, ...] = ()
    components = ""
    if values.uncertain:
        kept = faults(lambda: limits(values, limit or ()), ())
        components = faults(lambda: checked(series, values, key is not None), "")
    if not faults.found:
        faults.found += [*_useless(scene, values, measure), *_no_tolerance(values, key)]
    faults.raise_found()
    return Job(scene, values, measure, within, kept, key, least, first, components)


def _measure(scene: Scene, values: Box, minimise: Any, maximise: Any) -> tuple[str, str | None]:
    """The growth that counts, and of a tolerance its key. Raises UsageError."""
    given = {name: each for name, each in {"minimise": minimise, "maximise": maximise}.items() if each is not None}
    if len(given) != 1:
        raise UsageError(f"state one measure: {_MEASURES}")
    if minimise in (MODES, LOOP):
        return str(minimise), None
    name, _, key = str(maximise).partition(".")
    if name != TOLERANCE:
        ((what, each),) = given.items()
        raise UsageError(f"{what} {brief(each)}: no growth of a rig against uncertain values; expected {_MEASURES}")
    if key and values.keys and key not in values.keys:
        raise UsageError(f"maximise {maximise}: {key} is not uncertain; --against {key}=... states its range")
    linear = [hasattr(controller_class(section), "linear") for section in scene.controllers.values()]
    return LOOP if linear and all(linear) else MODES, key


def _band(given: Any) -> tuple[float, float]:
    """The band [Hz]. Raises UsageError."""
    if given is None:
        return 0.0, math.inf
    try:
        (low, high), _ = _ends(given, "Hz", _BANDS)
    except ValueError as fault:
        raise UsageError(f"band {brief(given)}: {fault}") from None
    if not 0.0 <= low < high:
        raise UsageError(f"band {brief(given)}: from {low:g} Hz to {high:g} Hz; it must rise, from 0 Hz or more")
    return low, high


def _ends(given: Any, unit: str, form: str) -> tuple[tuple[float, float], str]:
    """Both ends of a range in SI, and the unit in which they are shown. Raises ValueError."""
    ends = pair(given)
    if ends is None:
        raise ValueError(f"is {brief(given)}; {form}")
    (low, high), shown = listed(ends, unit)
    return (low, high), shown


def _decay(given: Any, key: str | None) -> float:
    """The least decay [1/s] of a tolerance. Raises UsageError."""
    if given is None:
        return 0.0
    if key is None:
        raise UsageError("decay: belongs to a tolerance (--maximise tolerance); a growth is made as small as possible")
    try:
        return finite(number_or_text(given) if isinstance(given, str) else given, "1/s", Ge(0.0))
    except ValueError as fault:
        raise UsageError(f"decay {brief(given)}: {fault}") from None


def _useless(scene: Scene, values: Box, measure: str) -> list[str]:
    """Keys of controllers in a measure of the plant alone, which they cannot change."""
    if measure == LOOP and not scene.controllers:
        return [f"{LOOP}: {scene.name} has no controller that closes a loop; minimise {MODES}"]
    keys = dict.fromkeys([*(axis.key for axis in values.free), *values.keys])
    of_controllers = ", ".join(key for key in keys if key.startswith("controllers."))
    if measure == LOOP or not of_controllers:
        return []
    return [f"{of_controllers}: changes no mode of the plant alone ({MODES}); minimise {LOOP}"]


def _no_tolerance(values: Box, key: str | None) -> list[str]:
    """Ranges that cannot be made wider or narrower about their nominal value."""
    faults = []
    for value in values.uncertain:
        if key is None or key not in ("", value.key):
            continue
        if not value.ends[0] < value.ends[1]:
            faults.append(f"against {value.key}: its range has no width, so that no factor of it is a tolerance")
        elif not 0.0 <= value.centre <= 1.0:
            at = value.axis.text(value.nominal)
            faults.append(f"against {value.key}: its range leaves out the value of the scene, {at}, which it is about")
    return faults


class _Range(NamedTuple):
    """Two ends in SI or, if `relative`, shares of the value of the scene; if `absolute` they are values, else
    deviations. `shown`: the unit for output. `given`: the distribution that they are quantiles of.
    """

    ends: tuple[float, float]
    shown: str
    relative: bool = False
    absolute: bool = True
    given: Distribution | Identified | None = None


def box(scene: Scene, over: Mapping[str, Any], against: Mapping[str, Any]) -> Box:
    """Return the box of `scene`. `over`: free key -> range "5 ohm:300 ohm", or two numbers in SI; `against`: uncertain
    key -> range, tolerance or distribution, see the head of this file.

    Raises SceneError with every fault.
    """
    for name, given in (("over", over), ("against", against)):
        if not isinstance(given, Mapping) or not all(isinstance(key, str) for key in given):
            raise SceneError(scene.name, [f"{name} = {brief(given)}: expected keys with ranges"])
    faults = Faults()
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


def _free(scene: Scene, key: str, known: Mapping[str, str], given: Any) -> Axis:
    """The axis of a free value with its two ends. Raises UsageError."""
    why = _not_free(scene, key, known[key]) if key in known else ""
    if why:
        raise UsageError(f"over {key}: {why}")
    try:
        return ranges(scene, {key: given})[0].axis
    except SceneError as error:
        raise UsageError("\n".join(f"over {fault}" for fault in error.faults)) from None


def _not_free(scene: Scene, key: str, unit: str) -> str:
    """Why a key cannot be designed, in words; "" if it can."""
    room, _, inner = table_of(key)
    table, _, rest = key.partition(".")
    if table in _WITHOUT:
        return _WITHOUT[table]
    if room == "controllers" and inner in _FRAMES:
        taken = ", --against takes it" if inner == "delay" else ""
        return f"takes whole frames, so that it has no gradient; -p {key} sets it{taken}"
    if room == "controllers" or is_set_point(scene.parameters, key):
        return ""
    if table in _SURROUNDINGS:
        return f"nobody designs it; --against {key} makes it uncertain, -p sets it"
    if table in _TABLES or unit in _DESIGNED or rest.rpartition(".")[2] in _NAMES:
        return ""
    return (
        f"is no value that a designer sets (numbers of controllers and of a shunt, stiffness, damping, mass, angle, "
        f"position, factors of matrix parts); --against {key} makes it uncertain"
    )


def _uncertain(scene: Scene, key: str, known: Mapping[str, str], given: Any, over: Mapping[str, Any]) -> Uncertain:
    """An uncertain value. Raises UsageError."""
    if key not in known:
        raise UsageError(f"against {unknown(key, known, scene)}")
    room, _, inner = table_of(key)
    why = _WITHOUT.get(key.partition(".")[0], "")
    if room == "controllers" and inner == "period":
        why = "takes whole frames that a controller keeps exactly; -p sets it"
    if why:
        raise UsageError(f"against {key}: {why}")
    step = scene.frame_ns * 1e-9 if key.endswith(".delay") else 0.0
    try:
        return _about(scene, key, known[key], _range(given, key, known[key], step), key in over, step)
    except (ValueError, UsageError) as fault:
        raise UsageError(f"against {key} = {given if isinstance(given, str) else brief(given)}: {fault}") from None


def _about(scene: Scene, key: str, unit: str, given: _Range, free: bool, step: float) -> Uncertain:
    """An uncertain value about that of the scene, or of the design. Raises ValueError."""
    stated = scene.values().get(key, (None, ""))[0]
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
    axis = Axis(key, unit, (), given.shown, in_words(key, scene))
    value = Uncertain(axis, nominal, (low, high), given.relative, free, step, given.given)
    first, last = sorted(value.value(share, None) for share in (0.0, 1.0))
    missed = max(abs(nominal + low - first), abs(nominal + high - last))
    if step and (given.relative or missed > _WHOLE * step):
        raise ValueError(f"a delay is searched in whole frames of {1e3 * step:g} ms; state a range of such, FROM:TO")
    value = replace(value, axis=replace(axis, values=(first, last)))
    if not free:  # of a design outside of the scene's own values the search finds out
        value.axis.check(scene, dict.fromkeys(value.axis.values))
    return value


def _range(given: Any, key: str, unit: str, step: float) -> _Range:
    """What a user states of an uncertain value. Raises ValueError, UsageError."""
    if isinstance(given, list | tuple) and all(isinstance(part, str) for part in given):
        given = ":".join(given)
    if isinstance(given, str) and "(" in given:
        joint = given.strip().startswith(f"{IDENTIFIED}(")
        given = Identified.read(given, key) if joint else Distribution.parse(given)
    if isinstance(given, Distribution | Identified):
        given.in_si(unit)
        low, high = drawn([given], [unit], np.array([ends_of(given, tails=True)]).T)[:, 0].tolist()
        if step:
            low = math.floor(low / step) * step
            high = math.ceil(high / step) * step
        return _Range((low, high), unit, given=given)
    symmetric = _SYMMETRIC.fullmatch(given) if isinstance(given, str) else None
    text = f"-{symmetric['size']}:{symmetric['size']}" if symmetric else given
    if isinstance(text, str) and "%" in text and unit != "%":
        if text.count("%") != 2:
            raise ValueError(f"is {brief(given)}; {_FORM}")
        (low, high), _ = _ends(text.replace("%", ""), "1", _FORM)
        return _Range((low / 100.0, high / 100.0), unit, relative=True, absolute=False)
    ends, shown = _ends(text, unit, _FORM)
    return _Range(ends, shown, absolute=symmetric is None)


def limits(box: Box, given: Iterable[str]) -> tuple[Limit, ...]:
    """Return the limits of a design. Raises UsageError with every fault."""
    faults = Faults()
    texts = [given] if isinstance(given, str) else [*given]
    read = [faults(partial(_limit, box, text), None) for text in texts]
    faults.raise_found()
    return tuple(limit for limit in read if limit is not None)


def _limit(box: Box, text: str) -> Limit:
    """A limit as it is stated. Raises UsageError."""
    given = Condition.read(str(text).replace("=", ""), "limit", "<>", _LIMITS)
    terms = [*_TERM.finditer(given.name)]
    if "".join(term[0] for term in terms) != given.name or not all(term["sign"] for term in terms[1:]):
        raise UsageError(f"limit {text}: expected {_LIMITS}; limits are linear")
    axes = {axis.key: axis for axis in box.free}
    for term in terms:
        if term["key"] not in axes:
            known = near(term["key"], axes) if axes else "nothing is: add --over"
            raise UsageError(f"limit {text}: {term['key']} is not free; {known}")
    units = [axes[term["key"]].unit for term in terms]
    if not all(same_unit(units[0], unit) for unit in units):
        raise UsageError(f"limit {text}: a sum of {' and '.join(dict.fromkeys(units))}; expected one unit")
    weights = np.zeros(len(axes))
    for term in terms:
        weights[[*axes].index(term["key"])] += float(f"{term['sign']}{term['factor'] or 1.0}")
    sense = 1.0 if given.sense == "<" else -1.0
    weights *= sense
    low, high = np.array([axis.values for axis in box.free]).T
    scale = float(np.abs(weights) @ np.maximum(np.abs(low), np.abs(high))) or 1.0
    slope = weights * (high - low) / scale
    limit = Limit(text, slope, (float(weights @ low) - sense * given.level_in(units[0])) / scale)
    if limit.excess(np.where(slope < 0.0, 1.0, 0.0)) > 0.0:
        raise UsageError(f"limit {text}: no design within the ranges keeps it; widen a range or the limit")
    return limit
