"""Stick and slip in a recording: when a contact rests and moves, what it bears, friction over the slip speed.

The slip speed is a channel, the speed of the drive minus a measured velocity, or, of a body that is pulled through a
spring of stiffness k, V - F'/k with the measured force F. A slip counts where the speed exceeds ten times the noise
threshold; it begins and ends where the speed passes the threshold itself. Slips that meet there are one (a double
event). One that is cut by an end of the recording is left out.

Missing samples of the slip speed (drop-outs of a laser) are bridged by a straight line up to four in a row. A sensor
may also hold its last value: where the contact slips, a velocity that stays equal for five samples or more and then
jumps by more than the threshold counts as missing. Slips that touch a longer gap are left out, and sticks across one.

A force is smoothed first, because its derivative amplifies noise: by the piecewise linear curve y with the smallest
sum (F - y)^2 / 2 + s sum |y''| (differences of samples), which keeps the sudden begins of slips. Isolated spikes are
removed before by the median of five samples, where it differs by more than eight times the usual. What stands at the
begin or the end of every other slip or more is no spike but the force of the slips.

Stretches that lie far apart, such as two days, are one series with a long gap between them.

Breakaway is the largest force in the later half of the stick, which ends where the speed begins to rise towards the
threshold: a gauge has read the drop to kinetic friction before it is passed, and a spring has been pulled further.

Source: detector and smoothing, Colas, Pustelnik, Oliver, Abry, Geminard, Vidal, Physical Review E 100 (2019) 032803;
the algorithm of the smoothing, Kim, Koh, Boyd, Gorinevsky, SIAM Review 51 (2009) 339.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.analysis.recorded.common_grid import aligned
from rig.analysis.recorded.series import Series, scene_name, series, spans
from rig.errors import UsageError
from rig.printable import counted
from rig.record.run import Reals, Run
from rig.record.run_data import BRIDGED, bridge, gaps
from rig.results import Column, Result, Table
from rig.units import same_unit

Bools = NDArray[np.bool_]
_EVENT = 10.0  # times the threshold: speed above which a slip counts
_SHARE = 0.04  # threshold as a share of the mean speed of the drive, if none is given
_SPIKE = 8.0  # times the usual deviation from the median of five
_BESIDE = 3  # samples between an edge of a slip and a peak of the force that belongs to it
_OFTEN = 0.5  # share of the slips that have a peak: spikes do not keep time with slips
_GAP = 1e-9  # of the objective: duality gap at which the smoothing ends
_ROUNDS = 80  # of the smoothing, at most
_BINS = 12  # of the slip speed, at most
_FEWEST = 20  # samples in a bin
_REACHES = 5.0  # times the noise: what one of 3 million samples at rest exceeds. chosen
_TURN = 6.0  # times the noise: what a turn of the speed exceeds


class Slip(NamedTuple):
    """One slip: begin and end [s], the stick before it [s], force at both ends, largest speed [m/s or rad/s]."""

    begin: float
    end: float
    stick: float
    """Time from the end of the slip before; NaN for the first one."""
    breakaway: float
    """Force at the begin, in the unit of the force; NaN without a force."""
    restick: float
    peak: float

    @property
    def motion(self) -> float:
        """Duration [s]."""
        return self.end - self.begin


class Curve(NamedTuple):
    """Friction over slip speed: centre of each bin, mean, standard error of the mean and number of samples."""

    speed: Reals
    friction: Reals
    error: Reals
    samples: Reals


@dataclass(frozen=True)
class StickSlip(Result):
    """The result of `stick_slip`. `t`, `speed`, `force` [n]: what the slips were found in."""

    FIGURE: ClassVar = "rig.analysis.recorded.channel_figures:stick_slip_figure"

    scene: str
    speed_unit: str
    force_unit: str
    """"" without a force."""
    threshold: float
    slips: tuple[Slip, ...]
    share: float
    """Share of the time in stick."""
    spikes: int
    """Samples of the force that were replaced."""
    joined: int
    """Slips that met another one and are one with it."""
    cut: int
    """Slips that an end of the recording or a gap cuts."""
    held: int
    """Samples of the velocity that the sensor held."""
    bridged: int
    """Missing samples of the slip speed that a line bridges."""
    missing: int
    """Missing samples in longer gaps."""
    up: Curve | None
    """Friction over rising slip speed, in `force_unit`; None without a force."""
    down: Curve | None
    coefficient: bool
    """Whether the friction is divided by the load."""
    t: Reals
    speed: Reals
    force: Reals
    channel_unit: str
    """Unit of `force`."""
    spring: bool = False
    """Whether the slip speed follows from the force of a spring."""
    noise: float = 0.0
    """Standard deviation of the noise of the slip speed at rest, in `speed_unit`."""

    def median(self, name: str) -> tuple[float, float, float]:
        """Median and quartiles of a value of the slips; NaN without any."""
        values = np.array([getattr(slip, name) for slip in self.slips])
        values = values[np.isfinite(values)]
        if not values.size:
            return math.nan, math.nan, math.nan
        low, middle, high = np.percentile(values, [25.0, 50.0, 75.0])
        return float(middle), float(low), float(high)

    def shown(self) -> Iterator[str | Table]:
        """Yield the medians of the slips and the friction over the slip speed."""
        share = f"{100.0 * self.share:.3g} % of the time"
        size = f"{self.threshold:.4g} {self.speed_unit}"
        yield f"{self.scene}: {counted(len(self.slips), 'slip')}, stick {share}; threshold {size}"
        if _REACHES * self.noise > _EVENT * self.threshold:
            noise, counts, enough = (
                f"{speed:.2g} {self.speed_unit}"
                for speed in (self.noise, _EVENT * self.threshold, 1.2 * _REACHES * self.noise / _EVENT)
            )
            yield (
                f"  some of the slips may be noise: at rest the speed scatters by {noise} (standard deviation), and a "
                f"slip counts from {counts} on; take a threshold above {enough}, or smooth"
            )
        kinds = [
            ("stick time", "stick", "s"),
            ("motion time", "motion", "s"),
            ("largest speed", "peak", self.speed_unit),
        ]
        forces = (("breakaway force", "breakaway"), ("force at the end", "restick"))
        kinds += [(title, name, self.force_unit) for title, name in forces if self.force_unit]
        rows = [(title, *self.median(name), unit) for title, name, unit in kinds]
        numbers = (Column(name, digits=".5g") for name in ("median", "lower quartile", "upper quartile"))
        if self.slips:
            yield Table("medians", [Column("measure"), *numbers, Column("unit")], rows)
        notes = (
            (self.spikes, "sample", "replaced (spikes)"),
            (self.held, "sample", "held by the sensor"),
            (self.bridged, "missing sample", f"bridged (gaps of up to {BRIDGED})"),
            (self.missing, "sample", "missing in longer gaps"),
            (self.cut, "slip", "cut by an end or a gap"),
            (self.joined, "slip", "joined"),
        )
        told = [f"{counted(count, noun)} {why}" for count, noun, why in notes if count]
        yield from [f"  {', '.join(told)}"] if told else []
        columns = (
            Column("speed", self.speed_unit, ".5g"),
            Column("friction", self.force_unit, ".5g"),
            Column("error", self.force_unit, ".2g"),
            Column("samples", digits=".0f"),
        )
        for curve, way in ((self.up, "rising"), (self.down, "falling")):
            if curve is not None and curve.speed.size:
                yield f"\nfriction over {way} slip speed, its mean and standard error"
                yield Table(way, columns, [*zip(*(values.tolist() for values in curve))])

    def facts(self) -> dict[str, Any]:
        """Return the slips and the curves."""
        curves = {way: curve._asdict() if curve else None for way, curve in (("up", self.up), ("down", self.down))}
        slips = [{**slip._asdict(), "motion": slip.motion} for slip in self.slips]
        counts = ("spikes", "held", "bridged", "missing", "cut", "joined")
        fields = {"scene": self.scene, "threshold": self.threshold, "share": self.share, "slips": slips, **curves}
        return fields | {name: getattr(self, name) for name in (*counts, "noise")}

    def listed(self) -> Table:
        """Return the slips."""
        units = ("s", "s", "s", self.force_unit, self.force_unit, self.speed_unit)
        return Table("slips", [*map(Column, Slip._fields, units)], self.slips)

    def law(self, falling: bool = False) -> str:
        """The friction as a table of a scene: `[friction]` with the law "table". Raises UsageError without a load.

        The force of a spring contains the inertia of the body, with opposite signs where its speed rises and falls: the
        law is then the mean of both. Otherwise it is that over rising speed, or with `falling` over falling speed.
        """
        curve = self.down if falling else self.up
        v, mu = (curve.speed, curve.friction) if curve is not None else (np.empty(0), np.empty(0))
        if self.spring and self.up is not None and self.down is not None and self.down.speed.size:
            shared = (v >= self.down.speed[0]) & (v <= self.down.speed[-1])
            v = v[shared]
            mu = 0.5 * (mu[shared] + np.interp(v, self.down.speed, self.down.friction))
        if not self.coefficient or v.size < 2:
            raise UsageError("a law needs a coefficient over at least two speeds: name the force and the load")
        speeds = ["0.0", *(f"{speed:.6g}" for speed in v)]
        values = [f"{mu[0]:.6g}", *(f"{value:.6g}" for value in mu)]
        static = self.median("breakaway")[0]
        lines = ["[friction]", 'law = "table"', f"speeds = [{', '.join(speeds)}]", f"values = [{', '.join(values)}]"]
        if math.isfinite(static) and self.slips:
            lines.append(f"mu_static = {max(static, mu[0]):.6g}")
        return "\n".join([*lines, ""])


class Motion(NamedTuple):
    """A motion in stick and slip, [n] samples. `speed`: of slip, positive where the contact slips as it does in the
    mean, which is `way` of it as it was given; `size`: the threshold. `spans`, `joined`, `cut`: of `_spans`; `held`:
    samples that the sensor held; `bridged`: their number and that of missing ones that a line bridges.
    """

    speed: Reals
    way: float
    size: float
    spans: list[tuple[int, int]]
    joined: int
    cut: int
    held: int
    bridged: int


def stick_slip(
    run: Run,
    velocity: str = "",
    friction: str = "",
    drive: str | float = 0.0,
    stiffness: float = 0.0,
    load: str | float = 0.0,
    threshold: float = 0.0,
    smooth: float = 0.0,
    first: float = 0.0,
    last: float = math.inf,
) -> StickSlip:
    """Find the slips of a contact from `first` to `last` [s].

    `velocity`: channel of the slip speed, or, with a `drive` (a channel or a constant [SI]), of the body. `friction`:
    channel of the friction or spring force; with the `stiffness` of a spring that is pulled with the speed `drive`, it
    gives the slip speed. `load`: channel or constant by which the force is divided for a friction coefficient.
    `threshold`: noise threshold of the slip speed [SI]; 0: 4 % of the mean speed of the drive. `smooth`: s of the
    smoothing, in the unit of the force; 0: none. Raises UsageError.
    """
    if not velocity and not (friction and stiffness > 0.0 and drive):
        raise UsageError("name the velocity (--velocity), or the force, the stiffness of its spring and the drive")
    names = [name for name in (velocity, friction, drive, load) if isinstance(name, str) and name]
    channels, t, parts = _channels(run, list(dict.fromkeys(names)), first, last)
    pulled = channels[drive].v if isinstance(drive, str) and drive else np.full(t.size, float(drive or 0.0))
    v = channels[velocity].v if velocity else np.empty(0)
    raw = channels[friction].v if friction else np.full(t.size, math.nan)

    def read(spiky: Bools) -> tuple[Reals, Motion]:
        """The force without its spikes, and the motion."""
        F = np.where(spiky, middle, raw)
        if friction and smooth:
            F = F.copy()
            for part in parts:
                F[part] = trend(F[part], smooth)
        if velocity:
            return F, _motion(pulled - v if drive else v, pulled, threshold, v)
        speed = pulled[:-1] - np.diff(F) * channels[friction].rate / stiffness
        return F, _motion(np.append(speed, speed[-1]), pulled, threshold, v)

    middle, spiky = _spikes(raw) if friction else (raw, np.zeros(t.size, np.bool_))
    F, motion = read(spiky)
    peaks = _of_slips(spiky, motion.spans)
    if peaks.any():
        spiky = spiky & ~peaks
        F, motion = read(spiky)
    slip = motion.speed
    spans = motion.spans
    lost = ~np.isfinite(slip)
    noise = _noise(slip[~lost])
    slips = []
    for i, (a, b) in enumerate(spans):
        before = spans[i - 1][1] if i else 0
        stick = t[a] - t[before] if i and not lost[before:a].any() else math.nan
        peak = float(np.max(slip[a : b + 1]))
        still = _still(slip, before, a, noise) + (0 if velocity else 1)  # speed of a spring: from a sample to the next
        slips.append(Slip(t[a], t[b], stick, _breakaway(F, before, still), F[b], peak))
    whole = [s for s in slips if math.isfinite(s.stick)]
    total = sum(s.motion + s.stick for s in whole)
    share = sum(s.stick for s in whole) / total if total else float(not spans)
    if not spans and float(np.mean(slip > motion.size)) > 0.5:
        share = 0.0
    N = channels[load].v if isinstance(load, str) and load else np.full(t.size, float(load or 1.0))
    up, down = _over_speed(slip, F / N, motion.size) if friction else (None, None)
    if load:
        loads = [float(N[a]) for a, _ in spans]
        slips = [s._replace(breakaway=s.breakaway / n, restick=s.restick / n) for s, n in zip(slips, loads)]
    unit = channels[velocity].unit if velocity else "m/s"
    if not velocity and isinstance(drive, str) and same_unit(channels[drive].unit, "rad/s"):
        unit = "rad/s"
    channel_unit = channels[friction].unit if friction else ""
    return StickSlip(
        scene_name(run),
        unit,
        "1" if friction and load else channel_unit,
        motion.size,
        tuple(slips),
        share,
        int(spiky.sum()),
        motion.joined,
        motion.cut,
        motion.held,
        motion.bridged,
        sum(int(lost[part].sum()) for part in parts),
        up,
        down,
        bool(load),
        t,
        motion.way * slip,
        F,
        channel_unit,
        not velocity,
        _noise_at_rest(slip, motion.size),
    )


def _channels(
    run: Run, names: Sequence[str], first: float, last: float
) -> tuple[dict[str, Series], Reals, list[slice]]:
    """The channels at common instants, their times [s], and the samples of each stretch that lies far from the others.

    Between two stretches so many samples are missing that none is bridged. Raises UsageError.
    """
    limits = spans(run, names[0], first, last)
    pieces = list[list[Series]]()
    fault: UsageError | None = None
    for begin, end in limits:
        try:
            pieces.append(aligned([series(run, name, begin, end) for name in names])[0])
        except UsageError as reason:  # one of several stretches may be too short
            fault = fault or reason
    if fault and (not pieces or len(limits) == 1):
        raise fault
    between = np.full(BRIDGED + 1, math.nan)
    times = pieces[0][0].t
    joined = [channel.v for channel in pieces[0]]
    parts = [slice(0, times.size)]
    for before, piece in pairwise(pieces):
        edges = np.linspace(float(before[0].t[-1]), float(piece[0].t[0]), between.size + 2)[1:-1]
        times = np.concatenate((times, edges, piece[0].t))
        joined = [np.concatenate((v, between, channel.v)) for v, channel in zip(joined, piece, strict=True)]
        parts.append(slice(times.size - piece[0].v.size, times.size))
    whole = [replace(channel, v=v) for channel, v in zip(pieces[0], joined, strict=True)]
    return dict(zip(names, whole, strict=True)), times, parts


def _motion(slip: Reals, pulled: Reals, threshold: float, v: Reals) -> Motion:
    """The motion with a slip speed. `pulled`: speed of the drive; `v`: the measured velocity, without samples if there
    is none.
    """
    size = threshold or _SHARE * float(np.nanmean(np.abs(pulled))) or _SHARE * float(np.nanmean(np.abs(slip)))
    way = 1.0 if np.nanmean(slip) >= 0.0 else -1.0
    held = _held(v, way * slip, size) if v.size else np.zeros(slip.size, np.bool_)
    speed, bridged = bridge(np.where(held, math.nan, way * slip))
    return Motion(speed, way, size, *_spans(speed, size), int(held.sum()), bridged)


def _still(speed: Reals, before: int, begin: int, noise: float) -> int:
    """The last sample at which the contact rests: from `begin`, where the speed passes the threshold, back to where it
    began to rise, as far as that stands out of the noise; not before the sample `before`.
    """
    at = begin
    while at > before and speed[at] > max(speed[at - 1], _TURN * noise):
        at -= 1
    return at


def _breakaway(F: Reals, before: int, last: int) -> float:
    """The largest force, in its direction at the end, in the later half of a stick from sample `before` to `last`."""
    stuck = F[(before + last) // 2 : last + 1]
    known = stuck[np.isfinite(stuck)]
    return float(known[np.argmax(math.copysign(1.0, known[-1]) * known)]) if known.size else math.nan


def _of_slips(spiky: Bools, spans: list[tuple[int, int]]) -> Bools:
    """Which spikes are the force of the slips: those at their begins if every other slip or more has one there, and
    likewise those at their ends.
    """
    peaks = np.zeros(spiky.size, np.bool_)
    for edges in zip(*spans):
        near = [slice(max(edge - _BESIDE, 0), edge + _BESIDE + 1) for edge in edges]
        if np.mean([spiky[part].any() for part in near]) >= _OFTEN:
            for part in near:
                peaks[part] |= spiky[part]
    return peaks


def _spikes(v: Reals) -> tuple[Reals, Bools]:
    """The median of five of the samples, and which of these are isolated spikes."""
    from scipy.ndimage import median_filter

    known = np.isfinite(v)
    filled = np.interp(np.arange(v.size), np.flatnonzero(known), v[known])
    middle = median_filter(filled, 5, mode="nearest")
    away = np.abs(v - middle)
    usual = float(np.median(away[away > 0.0])) if (away > 0.0).any() else 0.0  # comparisons with NaN are false
    return middle, away > max(_SPIKE * usual, 0.05 * float(np.nanmax(v) - np.nanmin(v)))


def trend(v: Reals, s: float) -> Reals:
    """The curve y with the smallest sum (v - y)^2 / 2 + s sum |y''|: piecewise linear. Missing samples are bridged."""
    from scipy.linalg import solveh_banded

    known = np.isfinite(v)
    if v.size < 3 or not known.any():
        return v
    v = np.interp(np.arange(v.size), np.flatnonzero(known), v[known])
    n = v.size - 2
    Dv = np.diff(v, 2)
    bands = np.zeros((3, n))
    bands[0, 2:] = 1.0
    bands[1, 1:] = -4.0
    bands[2] = 6.0

    def transposed(z: Reals) -> Reals:
        return np.asarray(np.convolve(z, (1.0, -2.0, 1.0)))

    z = np.zeros(n)  # the dual, |z| <= s
    low = np.ones(n)  # the multipliers of both bounds
    high = np.ones(n)
    t = 1e-10
    step = math.inf
    for _ in range(_ROUNDS):
        back = transposed(z)
        forth = np.diff(back, 2)
        w = Dv - (high - low)
        by_multipliers = 0.5 * float(w @ solveh_banded(bands, w)) + s * float(np.sum(high + low))
        by_dual = 0.5 * float(back @ back) + s * float(np.abs(Dv - forth).sum())
        primal = min(by_multipliers, by_dual)
        gap = primal + 0.5 * float(back @ back) - float(Dv @ z)
        if gap <= _GAP * max(abs(primal), np.finfo(float).tiny):
            break
        if step >= 0.2:
            t = max(4.0 * n / gap, 1.2 * t)
        over = z - s  # negative inside, as the next
        under = -z - s
        matrix = bands.copy()
        matrix[2] -= high / over + low / under
        dz = solveh_banded(matrix, -forth + Dv + (1.0 / over - 1.0 / under) / t)
        dhigh = -(high + (1.0 / t + dz * high) / over)
        dlow = -(low + (1.0 / t - dz * low) / under)
        step = 1.0
        for m, dm in ((high, dhigh), (low, dlow)):
            if (dm < 0.0).any():
                step = min(step, 0.99 * float(np.min(-m[dm < 0.0] / dm[dm < 0.0])))
        for _ in range(40):  # stay inside, and come closer
            new = z + step * dz
            if np.max(np.abs(new)) < s:
                break
            step *= 0.5
        z = z + step * dz
        high = high + step * dhigh
        low = low + step * dlow
    return np.asarray(v - transposed(z))


def _held(v: Reals, slip: Reals, size: float) -> Bools:
    """The samples of a velocity that repeat the one before them, where the contact slips and a jump follows."""
    same = np.concatenate(([False], np.diff(v) == 0.0))
    held = np.zeros(v.size, np.bool_)
    for a, b in gaps(np.where(same, math.nan, 0.0)):
        jumps = b < v.size and abs(v[b] - v[b - 1]) > size
        if b - a >= BRIDGED and jumps and np.all(slip[a:b] > size):
            held[a:b] = True
    return held


def _spans(slip: Reals, size: float) -> tuple[list[tuple[int, int]], int, int]:
    """First and last sample of each whole slip, how many met another one, and how many an end or a gap cuts."""
    low = slip > size
    high = slip >= _EVENT * size
    edges = np.flatnonzero(np.diff(np.concatenate(([False], low, [False])).astype(np.int8)))
    spans = list[tuple[int, int]]()
    joined = 0
    cut = 0
    for begin, end in edges.reshape(-1, 2):  # above the threshold from `begin` to `end` - 1
        events = np.flatnonzero(np.diff(np.concatenate(([False], high[begin:end])).astype(np.int8)) == 1)
        if not events.size:
            continue
        if begin == 0 or end == slip.size or not np.isfinite(slip[[begin - 1, end]]).all():
            cut += 1
            continue
        joined += events.size - 1
        spans.append((int(begin) - 1, int(end)))
    return spans, joined, cut


def _ways(v: Reals) -> NDArray[np.int8]:
    """1 where v rises, -1 where it falls, from turning point to turning point; a turn is larger than the noise of v."""
    known = np.flatnonzero(np.isfinite(v))
    x = v[known]
    band = _TURN * _noise(x)
    way = 1
    turn = 0
    extreme = 0
    ways = np.ones(x.size, np.int8)
    values = x.tolist()
    for i, value in enumerate(values):
        away = way * (value - values[extreme])
        if away >= 0.0:
            extreme = i
        elif away < -band:
            ways[turn : extreme + 1] = way
            way = -way
            turn = extreme + 1
            extreme = i
    ways[turn:] = way
    of_all = np.zeros(v.size, np.int8)
    of_all[known] = ways
    return of_all


def _noise(x: Reals) -> float:
    """The standard deviation of the noise of samples, from their second differences."""
    return 1.4826 * float(np.median(np.abs(np.diff(x, 2)))) / math.sqrt(6.0) if x.size > 2 else 0.0


def _noise_at_rest(slip: Reals, size: float) -> float:
    """The same of the samples of a slip speed that belong to no slip."""
    at_rest = slip < _EVENT * size
    bends = np.abs(np.diff(slip, 2))[at_rest[:-2] & at_rest[1:-1] & at_rest[2:]]
    return 1.4826 * float(np.median(bends)) / math.sqrt(6.0) if bends.size else 0.0


def _over_speed(slip: Reals, friction: Reals, size: float) -> tuple[Curve, Curve]:
    """Friction over rising and over falling slip speed, in bins of equally many samples."""
    ways = _ways(slip)
    known = (slip > size) & np.isfinite(friction)
    rising = (ways > 0.0) & known
    falling = (ways < 0.0) & known
    return _binned(slip[rising], friction[rising]), _binned(slip[falling], friction[falling])


def _binned(v: Reals, friction: Reals) -> Curve:
    """The friction over the speed v, in bins of equally many samples."""
    count = min(_BINS, v.size // _FEWEST)
    order = np.argsort(v, kind="stable")
    bins = np.array_split(order, count) if count else []
    return Curve(
        np.array([v[part].mean() for part in bins]),
        np.array([friction[part].mean() for part in bins]),
        np.array([friction[part].std(ddof=1) / math.sqrt(part.size) for part in bins]),
        np.array([float(part.size) for part in bins]),
    )
