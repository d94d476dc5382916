"""Several files of one run get a common time: by a trigger, or by a channel that all of them contain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rig.errors import UsageError
from rig.printable import counted
from rig.quantities import Condition
from rig.record.imports.file_part import Part
from rig.record.imports.row_faults import REMEDIES
from rig.record.run_data import Reals

_SPARSE = 8.0  # periods for each sample: with more the shift of a channel is not looked for. chosen
_ALIKE = 0.5  # least correlation of a channel that two files have in common


def join_parts(parts: Sequence[Part], join: str) -> None:
    """Shift the times of all files but the first one to the common time."""
    condition = None
    name = join.strip()
    if "<" in join or ">" in join:
        condition = Condition.read(join, "--join", "<>|", "CHANNEL > VALUE UNIT")
        name = condition.name
    whole = []
    faults = list[str]()
    for part in parts:
        try:
            whole.append(_samples(part, name, f"--join {join}: {part.file.path}"))
        except UsageError as fault:
            faults += str(fault).splitlines()
    if faults:  # what helps is the same for all files, and stands below
        raise UsageError("\n".join(sorted(dict.fromkeys(faults), key=lambda line: line in REMEDIES.values())))
    if condition is not None:
        instants = [_fired(*samples, condition, part) for samples, part in zip(whole, parts)]
        for part, instant in zip(parts, instants):
            part.shift = instants[0] - instant
    else:
        for part, samples in zip(parts[1:], whole[1:]):
            part.shift = _lag(whole[0], samples, f"--join {join}: {part.file.path}")
    _refuse_doubles(parts, name)
    for part in parts[1:]:  # the channel that they have in common is one channel
        part.channels = [channel for channel in part.channels if name not in (channel.name, channel.column)]


def _refuse_doubles(parts: Sequence[Part], common: str) -> None:
    """Raise UsageError for files with a channel of the same name, and for files with the one in `common` only."""
    faults = list[str]()
    taken = dict[str, str]()
    for part in parts:
        own = [channel.name for channel in part.channels if common not in (channel.name, channel.column)]
        where = str(part.file.path)
        if not own and part is not parts[0]:
            faults.append(f"{where}: it has no channel beside {common}, which the first file has too; leave it out")
        faults += [
            f"{where}: {taken[name]} has a channel {name} too; rename its column in one of the files, or leave it out "
            "of the map"
            for name in own
            if name in taken
        ]
        taken |= dict.fromkeys(own, part.file.path.name)
    if faults:
        raise UsageError("\n".join(faults))


def _samples(part: Part, name: str, where: str) -> tuple[Reals, Reals, str]:
    """Times [s], values and unit of the channel that files have in common."""
    channel = next((c for c in part.channels if name in (c.name, c.column)), None)
    if channel is None:
        raise UsageError(f"{where} has no channel {name}")
    t, v = part.samples(channel.column)
    if t.size < 2:
        raise UsageError(f"{where}: {name} has {counted(t.size, 'value')} with a time")
    return t, channel.values(v), channel.unit


def _fired(t: Reals, v: Reals, unit: str, condition: Condition, part: Part) -> float:
    """The time of the first sample that meets the condition, between it and the one before [s]."""
    level = condition.level_in(unit)
    size = np.abs(v) if condition.size else v
    beyond = size - level if condition.sense == ">" else level - size
    met = np.flatnonzero(beyond > 0.0)
    if not met.size:
        raise UsageError(
            f"--join {condition}: never met in {part.file.path}: {size.min():.6g} to {size.max():.6g} {unit}"
        )
    i = int(met[0])
    if i == 0:
        return float(t[0])
    period = t[i] - t[i - 1]
    rise = beyond[i] - beyond[i - 1]
    return float(t[i] - period * beyond[i] / rise)


def _lag(first: tuple[Reals, Reals, str], other: tuple[Reals, Reals, str], where: str) -> float:
    """The shift [s] of `other` with which a channel correlates best with the same channel of `first`."""
    from scipy.signal import correlate, correlation_lags

    first_t, first_v, _ = first
    other_t, other_v, _ = other
    step = min(_period(first_t), _period(other_t))
    for t in (first_t, other_t):
        duration = float(t[-1] - t[0])
        if duration > _SPARSE * step * t.size:
            raise UsageError(f"{where}: most of its time is a gap; name a trigger, CHANNEL > VALUE UNIT")
    a = _resampled(first_t, first_v, step)
    b = _resampled(other_t, other_v, step)
    c = correlate(a, b)
    k = int(np.argmax(c))
    size = float(np.sqrt((a @ a) * (b @ b)))
    likeness = float(c[k]) / max(size, np.finfo(float).tiny)
    if not likeness > _ALIKE:
        raise UsageError(
            f"{where} does not look alike (correlation {likeness:.2f}); name another channel, or a trigger"
        )
    lag = correlation_lags(a.size, b.size)[k] + _between_samples(c, k)
    return float(first_t[0] - other_t[0] + lag * step)


def _period(t: Reals) -> float:
    """The sampling period [s]: the median of the intervals."""
    return float(np.median(np.diff(t)))


def _between_samples(c: Reals, k: int) -> float:
    """The place of the maximum of a parabola through c[k] and its neighbours, from k [samples]; 0 at an end of c."""
    if not 0 < k < c.size - 1:
        return 0.0
    before = c[k - 1]
    after = c[k + 1]
    bend = before - 2.0 * c[k] + after
    if not bend:
        return 0.0
    return float(0.5 * (before - after) / bend)


def _resampled(t: Reals, v: Reals, step: float) -> Reals:
    """The samples v(t) without their mean, every `step` [s] by straight lines."""
    grid = np.arange(t[0], t[-1], step)
    return np.asarray(np.interp(grid, t, v - v.mean()))
