"""One channel of a recording on an even grid of times: a measurement, a plant output, or the commands to an actuator.

Samples that were lost or dropped out are NaN and counted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from rig.errors import Faults, Untrusted, UsageError
from rig.plants import plate
from rig.printable import counted
from rig.record.contents import commanded, held, unit_of
from rig.record.film_points import listed, read
from rig.record.run import Reals, Run, Samples
from rig.record.run_data import MEASURED, TRUE, gaps, increasing, places, signals, stretch_list, stretches, unknown
from rig.record.run_list import drives
from rig.view.curves import described

_VIBRATION = ("m/s^2", "m/s", "Pa", "m")  # units of a vibration, the most informative first
# Places of the grid for each sample, and in all, that are too many. chosen: 512 MiB
_SPARSE = 64
_LARGE = 1 << 26
_WHOLE = 0.99  # share of the plant's steps: an output with fewer recorded steps counts as decimated


@dataclass(frozen=True)
class Series:
    """Samples `v` [n] of `name` in `unit`, at `rate` [Hz], the first at `start` [s]; missing samples are NaN.

    `note`: a warning about the samples, in words.
    """

    name: str
    unit: str
    rate: float
    start: float
    v: Reals
    note: str = ""

    @property
    def t(self) -> Reals:
        """Times of the samples [s]."""
        return np.asarray(self.start + np.arange(self.v.size) / self.rate)

    @property
    def seconds(self) -> float:
        """Duration from the first sample to the end of the last [s]."""
        return self.v.size / self.rate

    @property
    def missing(self) -> int:
        """Number of missing samples."""
        return int(self.v.size - np.count_nonzero(np.isfinite(self.v)))

    @property
    def gaps(self) -> list[tuple[int, int]]:
        """The gaps: index of the first missing sample and of the sample after the last one."""
        return gaps(self.v)

    def notes(self) -> str:
        """Return the missing samples and the note, in words; "" if there is neither."""
        if not self.missing:
            return self.note
        longest = max(b - a for a, b in self.gaps)
        lost = (
            f"{self.missing} of {self.v.size} samples of {self.name} are missing, in {counted(len(self.gaps), 'gap')}; "
            f"the longest takes {longest / self.rate:.3g} s"
        )
        return "; ".join(filter(None, (lost, self.note)))


def known(run: Run) -> dict[str, str]:
    """Return name and unit of every sensor, plant output and commanded actuator of a recording."""
    return signals(run) | {name: unit_of(run, name) for name in commanded(run)}


def vibration(run: Run) -> str:
    """Return the default signal: a sensor of a vibration if there is one, else an output.

    Raises UsageError without any, and Untrusted where only code of the recording tells which of several it is.
    """
    untrusted = ""
    driven: Sequence[str] = ()
    try:
        driven = drives(run)
    except Untrusted as fault:
        untrusted = str(fault)
    others = {*driven, *(name for name, reads in _reads(run).items() if reads in driven)}
    for prefix, names in ((MEASURED, run.measurements), (TRUE, run.signals)):
        units = {name: run.units.get(name if prefix == TRUE else prefix + name, "") for name in names}
        for unit in _VIBRATION:
            fitting = [name for name in units if units[name] == unit and name not in others]
            if untrusted and len(fitting) > 1:
                raise Untrusted(f"which of {', '.join(fitting)} is the vibration? Name it, or: {untrusted}")
            if fitting:
                return prefix + fitting[0]
    raise UsageError(f"no channel of this recording is a vibration ({', '.join(_VIBRATION)}); name one: {_listed(run)}")


def drive(run: Run) -> str:
    """Return the output that holds the speed of the drive.

    Raises UsageError for a recording without one, or without its scene, and Untrusted as `drives` does.
    """
    if names := drives(run):
        return TRUE + names[0]
    lost = "" if run.scene or run.measured else " (the recording has lost its scene)"
    raise UsageError(f"no output is known to be the speed of a drive{lost}; name one: {_listed(run)}")


def series(run: Run, name: str, first: float = 0.0, last: float = float("inf")) -> Series:
    """Return channel `name` of `run` from `first` to `last` [s]: a sensor, an output of the plant, or an actuator.

    If a sensor and an output have that name, the sensor is returned; `truth/NAME` selects the output. An actuator is
    the command of a controller in force at every frame. Raises UsageError for an unknown name, for less than two
    samples, and for several stretches that lie far apart: take one of `spans`.
    """
    plain, samples, unit = _samples(run, name)
    t = samples.t_ns * 1e-9
    inside = (t >= first) & (t <= last)
    t_ns = samples.t_ns[inside]
    v = samples.v[inside]
    v = np.where(np.isfinite(v), v, np.nan)
    if t_ns.size < 2 or not np.isfinite(v).any():
        end = f"{last:g} s" if last < np.inf else "the end"
        number = int(np.isfinite(v).sum())
        raise UsageError(
            f"{plain}: {number} sample{'s' * (number != 1)} from {first:g} s to {end}; "
            f"the recording ends at {run.span[1] if run.span else 0.0:g} s"
        )
    if not increasing(t_ns):
        raise UsageError(f"{plain}: its times do not increase")
    parts = stretches(t_ns)
    if len(parts) > 1:
        raise UsageError(f"{plain}: it lies in {stretch_list(t_ns, parts)}; take one of them (--from, --to)")
    at = places(t_ns)
    if at[-1] > max(_SPARSE * t_ns.size, _LARGE):
        raise UsageError(
            f"{plain}: {t_ns.size} samples in {at[-1]} periods of the shortest distance between two: its times are "
            "too uneven for an even grid"
        )
    grid = np.full(int(at[-1]) + 1, np.nan)
    grid[at] = v
    rate = 1e9 * int(at[-1]) / int(t_ns[-1] - t_ns[0])
    output = plain in run.signals and (name.startswith(TRUE) or plain not in run.measurements)
    note = ""
    if output and rate * run.step_ns * 1e-9 < _WHOLE:
        note = (
            f"{plain} is an output of the plant, recorded at {rate:.4g} Hz and not filtered: vibration above "
            f"{0.5 * rate:.4g} Hz is aliased; a sensor keeps all of its samples"
        )
    else:
        note = _folded(run, plain, output, rate)
    return Series(plain, unit, rate, float(t_ns[0] * 1e-9), grid, note)


def spans(run: Run, name: str, first: float = 0.0, last: float = float("inf")) -> list[tuple[float, float]]:
    """Return begin and end [s] of the stretches of channel `name` from `first` to `last` [s] that lie far apart.

    Most recordings have one. The limits of two stretches meet in the middle of the gap between them. Raises UsageError
    for an unknown name.
    """
    _, samples, _ = _samples(run, name)
    t = samples.t_ns * 1e-9
    t_ns = samples.t_ns[(t >= first) & (t <= last)]
    if not increasing(t_ns):
        return [(first, last)]
    parts = stretches(t_ns)
    middles = [0.5e-9 * (int(t_ns[a][-1]) + int(t_ns[b][0])) for a, b in pairwise(parts)]
    return [*pairwise([first, *middles, last])]


def of_spans(run: Run, name: str, limits: Sequence[tuple[float, float]]) -> list[Series]:
    """Return channel `name` in each stretch that has two samples or more. Raises UsageError as `series` does."""
    if len(limits) == 1:
        return [series(run, name, *limits[0])]
    parts = list[Series]()
    faults = Faults()
    for begin, end in limits:
        part = faults(lambda begin=begin, end=end: series(run, name, begin, end), None)  # type: ignore[misc]
        parts += [part] if part else []
    if not parts:
        faults.raise_found()
    return parts


def channels(
    run: Run, wanted: Mapping[str, str | Callable[[Run], str]], first: float, last: float, faults: Faults
) -> dict[str, Series]:
    """Return channels of `run` by their role, from `first` to `last` [s], without those that are among the `faults`.

    `wanted`: role -> name, or the function that chooses one.
    """
    known: dict[str, Series] = {}
    for role, name in wanted.items():
        try:
            known[role] = series(run, name if isinstance(name, str) else name(run), first, last)
        except UsageError as error:
            faults.found.append(f"{role}: {error}")
    return known


def same(run: Run, name: str, other: str) -> bool:
    """Return whether two names of `run` are one channel: a sensor may share its name with an output. Raises UsageError
    for an unknown name.
    """
    return name == other or _samples(run, name)[1].v is _samples(run, other)[1].v


def squared(unit: str) -> str:
    """The unit of the square of a quantity."""
    return f"({unit})^2" if set(unit) & set("/*^") else f"{unit}^2"


def scene_name(run: Run) -> str:
    """Return name or title of the scene; "recording" if damage removed the scene."""
    told = described(run.scene)
    return str(told.get("name") or told.get("title") or told.get("plant") or (run.measured and run.name) or "recording")


def _samples(run: Run, name: str) -> tuple[str, Samples, str]:
    """Name without prefix, samples and unit of a channel."""
    plain = name.removeprefix(MEASURED).removeprefix(TRUE)
    if plain in run.measurements and not name.startswith(TRUE):
        return plain, run.measurements[plain], run.units.get(MEASURED + plain, "")
    if plain in run.signals and not name.startswith(MEASURED):
        samples = Samples(np.rint(run.time * 1e9).astype(np.int64), run.signals[plain])
        return plain, samples, run.units.get(plain, "")
    if name in commanded(run):
        return name, held(run, name), unit_of(run, name)
    raise unknown(name, known(run))


def _folded(run: Run, name: str, output: bool, rate: float) -> str:
    """A note if a plate vibrates above half of the rate without a filter; "" otherwise."""
    scene = read(run.scene)
    if scene is None or not (output or getattr(scene.sensors.get(name), "ideal", False)):
        return ""
    parameters = scene.parameters
    highest = float(parameters.reduced().frequencies[-1]) if isinstance(parameters, plate.Parameters) else 0.0
    if highest <= 0.505 * rate:  # aliasing by 1 % of the rate hardly moves a line
        return ""
    return (
        f"{name} is sampled at {rate:.6g} Hz and not filtered, and the plate's modes reach {highest:.6g} Hz: "
        f"vibration above {0.5 * rate:.6g} Hz is aliased; raise the rate of a sensor of the scene"
    )


def _listed(run: Run) -> str:
    return ", ".join(listed(known(run))) or "none"


def _reads(run: Run) -> dict[str, str]:
    """The quantity that each sensor of the scene reads; empty if the recording has lost its scene."""
    sections = described(run.scene).get("sensors")
    tables = sections.items() if isinstance(sections, dict) else ()
    return {name: str(section.get("reads", "")) for name, section in tables if isinstance(section, dict)}
