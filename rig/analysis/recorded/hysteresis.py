"""Hysteresis: the RMS of a vibration over the drive speed as it rises and falls; bistability shows as a loop.

    rms(t) = sqrt(mean (v - mean v)^2)        both means over the same window, centred at t

A window smears a transition over the change of speed within it; the report states both. Therefore the critical speeds
come from the contact state and not from the RMS: the last stick of a run-up and the first one of a run-down.

The branches of a run-up and run-down: where a speed rises and where it falls, without the holds between.

Centred moving windows over the samples of a recording with gaps, and the longest period in the samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple

import numpy as np

from rig.analysis.recorded.series import Series, channels, drive, scene_name, vibration
from rig.analysis.stick_speeds import short, stuck
from rig.errors import Faults, UsageError
from rig.printable import columns, counted
from rig.record.run import Reals, Run
from rig.results import Result, csv_text

_TURN = 0.05  # share of the whole range: a smaller reversal does not end a branch
_HELD = 0.01  # share of the range of a branch: the speed counts as held within this distance of its ends
_ROUNDING = 1e-9  # share of the largest speed: a smaller change counts as none
PARTS, _MOST_PARTS = 16, 40
"""Successive windows are offset by about this fraction of their length, a whole number of samples."""
FEWEST = 4
"""Fewest samples in a window."""
_KNOWN = 0.5  # share of the samples of a window that must exist
_DRIFT = 3  # lines of a spectrum
_STRONG = 0.1  # of the mean square
_PERIODS = 5.0  # default window, in periods of the slowest strong vibration
_LONGEST = 0.25  # share of the shortest branch: a longer window blurs all of it
_USUAL = 0.05  # share of the shortest branch: the longest default window
_WHOLE = 0.95  # periods that count as one
_BINS = 20
_POINTS = 20_000  # samples of the speed that its branches are found from


class Branch(NamedTuple):
    """From `begin` to `end` [s] the speed changes from `first` to `last`, in its unit."""

    begin: float
    end: float
    first: float
    last: float

    @property
    def rises(self) -> bool:
        """Whether it is a run-up."""
        return self.last > self.first

    @property
    def rate(self) -> float:
        """Rate of change of the speed [unit/s]; positive."""
        return (1.0 - 2.0 * _HELD) * abs(self.last - self.first) / (self.end - self.begin)


def branches(t: Reals, v: Reals) -> list[Branch]:
    """Return the branches of speed `v` at times `t` [s], in order of time; none if the speed does not change."""
    known = np.isfinite(v)
    t = t[known]
    v = v[known]
    least = _ROUNDING * np.abs(v).max(initial=0.0)
    v = np.where(np.abs(v) <= least, 0.0, v)  # the rounding of a ramp down to zero
    if v.size < 2 or np.ptp(v) <= least:
        return []
    turns = _turns(v, _TURN * float(np.ptp(v)))
    made = []
    for a, b in pairwise(turns):
        part = v[a : b + 1]
        near = _HELD * abs(v[b] - v[a])
        leaves = int(np.flatnonzero(np.abs(part - part[0]) <= near)[-1])
        comes = leaves + int(np.flatnonzero(np.abs(part[leaves:] - part[-1]) <= near)[0])
        if comes > leaves:
            made.append(Branch(float(t[a + leaves]), float(t[a + comes]), float(v[a]), float(v[b])))
    return made


def _turns(v: Reals, least: float) -> list[int]:
    """Indices of the turning points of `v` that are more than `least` apart in value; first and last sample
    included.
    """
    turns: list[int] = []
    top = bottom = way = 0
    for i, here in enumerate(v.tolist()):
        top = i if here > v[top] else top
        bottom = i if here < v[bottom] else bottom
        if way >= 0 and v[top] - here > least:
            turns.append(top)
            way, bottom = -1, i
        elif way <= 0 and here - v[bottom] > least:
            turns.append(bottom)
            way, top = 1, i
        if way > 0:
            bottom = i
        elif way < 0:
            top = i
    return [*turns, top if way > 0 else bottom]


def moving_rms(signal: Series, length: float) -> tuple[Reals, Reals, float]:
    """Return middles [s] of windows of about `length` [s], the RMS about the mean in each, and their true length [s].

    NaN where less than half of the samples of a window exist.
    """
    parts, hop = _divided(max(round(length * signal.rate), FEWEST))
    ok = np.isfinite(signal.v)
    if not ok.any() or ok.size < parts * hop:
        return np.empty(0), np.empty(0), parts * hop / signal.rate
    v = np.where(ok, signal.v - np.nanmean(signal.v), 0.0)  # subtract the mean: a large one costs digits
    cuts = np.arange(0, v.size - hop + 1, hop)
    whole = cuts.size * hop
    n, first, second = (
        np.convolve(values[:whole].reshape(-1, hop).sum(axis=1), np.ones(parts), "valid")
        for values in (ok * 1.0, v, v * v)
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        square = np.maximum(second / n - (first / n) ** 2, 0.0)
    rms = np.asarray(np.where(n >= _KNOWN * parts * hop, np.sqrt(square), np.nan), np.float64)
    middles = signal.start + (np.arange(n.size) * hop + 0.5 * (parts * hop - 1)) / signal.rate
    return np.asarray(middles, np.float64), rms, parts * hop / signal.rate


def moving_mean(t: Reals, v: Reals, at: Reals, length: float) -> Reals:
    """Return the mean of v over windows of `length` [s] about `at`, from its integral by the trapezium rule."""
    whole = np.concatenate(([0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))))
    begin = np.clip(at - 0.5 * length, t[0], t[-1])
    end = np.clip(at + 0.5 * length, t[0], t[-1])
    taken = np.maximum(end - begin, 1e-300)
    return np.asarray((np.interp(end, t, whole) - np.interp(begin, t, whole)) / taken)


def slowest(signal: Series) -> float:
    """Return the lowest frequency [Hz] of a strong vibration, 0 if nothing vibrates: a tenth of the mean square lies
    below it.

    The drift over the whole recording does not count. Gaps are filled with the mean.
    """
    from scipy.signal import periodogram

    ok = np.isfinite(signal.v)
    v = np.where(ok, signal.v - np.nanmean(signal.v), 0.0)
    frequencies, power = periodogram(v, signal.rate, window="hann", detrend="linear")
    power[:_DRIFT] = 0.0
    if not power.any():
        return 0.0
    below = np.cumsum(power)
    return float(frequencies[np.searchsorted(below, _STRONG * below[-1])])


def _divided(count: int) -> tuple[int, int]:
    """Number of parts of a window of about `count` samples, and the samples in each part."""
    if count <= _MOST_PARTS:
        return count, 1
    near = (count + sign * shift for shift in range(count) for sign in (1, -1))
    return next((parts, n // parts) for n in near for parts in range(PARTS, _MOST_PARTS + 1) if n % parts == 0)


class Row(NamedTuple):
    """One of `_BINS` ranges of the speed: its middle, and the RMS in it as the speed rises and falls; NaN if
    unknown.
    """

    speed: float
    up: float
    down: float


class Curve(NamedTuple):
    """One branch: at times `t` [s] the mean `speed` and the `rms` of the window about them.

    `stick`: in a run-up the last speed with stick, in a run-down the first one; NaN without stick.
    """

    branch: Branch
    t: Reals
    speed: Reals
    rms: Reals
    stick: float


@dataclass(frozen=True)
class Hysteresis(Result):
    """The result of `hysteresis`: `window` [s]; `frequency` [Hz] of the slowest strong vibration; curves in order of
    time.

    `modes`: interval between recorded contact states [s]; 0 without them. `events`: whether the contact events were
    recorded, which also show shorter sticks. `gaps`: missing samples, in words; `lost`: number of windows left out
    because less than half of their samples exist.
    """

    FIGURE: ClassVar = "rig.analysis.recorded.figures:hysteresis_figure"

    scene: str
    name: str
    unit: str
    over: str
    over_unit: str
    window: float
    frequency: float
    curves: tuple[Curve, ...]
    modes: float
    events: bool
    gaps: tuple[str, ...]
    lost: int

    @property
    def smear(self) -> float:
        """The largest change of the speed within a window [over_unit]."""
        return max(curve.branch.rate for curve in self.curves) * self.window

    @property
    def up(self) -> float:
        """The highest speed with stick as the speed rose; NaN without stick."""
        return max((c.stick for c in self.curves if c.branch.rises and math.isfinite(c.stick)), default=math.nan)

    @property
    def down(self) -> float:
        """The highest speed at which the contact stuck again as the speed fell; NaN without stick."""
        return max((c.stick for c in self.curves if not c.branch.rises and math.isfinite(c.stick)), default=math.nan)

    def rows(self) -> list[Row]:
        """Return the RMS over the speed, in even steps of the speed."""
        ends = [end for curve in self.curves for end in (curve.branch.first, curve.branch.last)]
        edges = np.linspace(min(ends), max(ends), _BINS + 1)
        sides = [self._binned(edges, rises) for rises in (True, False)]
        return [Row(*map(float, row)) for row in zip(0.5 * (edges[1:] + edges[:-1]), *sides)]

    def _binned(self, edges: Reals, rises: bool) -> Reals:
        """Root mean square of all windows of a bin."""
        mine = [curve for curve in self.curves if curve.branch.rises == rises]
        speed = np.concatenate([np.empty(0), *(curve.speed for curve in mine)])
        square = np.concatenate([np.empty(0), *(curve.rms for curve in mine)]) ** 2
        known = np.isfinite(square)
        where = np.digitize(speed[known], edges[1:-1])
        count = np.bincount(where, minlength=_BINS)
        with np.errstate(invalid="ignore"):
            return np.sqrt(np.bincount(where, square[known], _BINS) / count)  # type: ignore[no-any-return]

    def text(self) -> str:
        """Return the report as text."""
        unit = self.unit
        over = self.over_unit
        lines = [
            f"{self.scene}: RMS of {self.name} [{unit}] over {self.over} [{over}]",
            f"  RMS about the mean, in a centred window of {self.window:.4g} s"
            + (f" ({self.window * self.frequency:.3g} periods of {self.frequency:.4g} Hz)" if self.frequency else "")
            + f"; {self.over} changes by up to {self.smear:.3g} {over} in it",
            *(f"  {gap}" for gap in self.gaps),
        ]
        if 0.0 < self.window * self.frequency < _WHOLE:
            lines.append("  the window is shorter than a period: the RMS follows the vibration itself")
        if self.lost:
            lines.append(f"  {counted(self.lost, 'window')} left out: less than half of the samples are there")
        stick = {True: "last stick", False: "first stick"}
        for curve in self.curves:
            branch = curve.branch
            stuck = ""
            if self.modes or self.events:
                at = f"at {curve.stick:.5g} {over}" if math.isfinite(curve.stick) else "none"
                stuck = f", {stick[branch.rises]} {at}"
            way = f"run-{'up' if branch.rises else 'down'} {branch.begin:.5g} to {branch.end:.5g} s"
            lines.append(f"  {way}, {branch.first:.5g} to {branch.last:.5g} {over}{stuck}")
        if not self.modes and not self.events:
            lines.append("  contact states were not recorded: stick is unknown")
        else:
            missed = "" if self.events else ": shorter sticks may be missed"
            lines.append(f"  contact states were recorded every {self.modes:.3g} s{missed}")
        if self.up > self.down:
            lines.append(
                f"  between {self.down:.5g} and {self.up:.5g} {over} it sticks and slips only while the speed rises"
            )
        head = (f"{self.over} {over}", f"rising {unit}", f"falling {unit}")
        rows = [tuple("-" if math.isnan(v) else f"{v:.5g}" for v in row) for row in self.rows()]
        return "\n".join([*lines, "", *columns([head, *rows], ">>>")])

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values; the windows one by one are in `csv`."""
        return {
            "scene": self.scene,
            "signal": self.name,
            "unit": self.unit,
            "over": self.over,
            "over_unit": self.over_unit,
            "window": self.window,
            "frequency": self.frequency,
            "smear": self.smear,
            "contact_modes_every": self.modes or None,
            "contact_events": self.events,
            "up": self.up,
            "down": self.down,
            "gaps": list(self.gaps),
            "windows_left_out": self.lost,
            "branches": [
                {**curve.branch._asdict(), "rises": curve.branch.rises, "stick": curve.stick} for curve in self.curves
            ],
            "rows": [row._asdict() for row in self.rows()],
        }

    def csv(self) -> str:
        """Return every window as a line: branch, direction, time, speed, RMS; empty where it is not known."""
        head = (
            "branch",
            "direction",
            "time [s]",
            f"{self.over} [{self.over_unit}]",
            f"rms of {self.name} [{self.unit}]",
        )
        rows = (
            (number, "rising" if curve.branch.rises else "falling", t, speed, "" if math.isnan(rms) else rms)
            for number, curve in enumerate(self.curves, 1)
            for t, speed, rms in zip(curve.t.tolist(), curve.speed.tolist(), curve.rms.tolist())
        )
        return csv_text(head, rows)


def hysteresis(
    run: Run,
    name: str = "",
    over: str = "",
    window: float | None = None,
    first: float = 0.0,
    last: float = math.inf,
) -> Hysteresis:
    """Compute the RMS of channel `name` over the speed `over`, rising and falling, from `first` to `last` [s].

    Defaults: a sensor that reads a vibration, the speed of the drive, and a `window` [s] of five periods of the slowest
    strong vibration, at most 5 % of the shortest branch or one period. Raises UsageError with every fault: unknown
    names, a speed that does not change, a window that is too short or too long.
    """
    faults = Faults()
    known = channels(run, {"signal": name or vibration, "over": over or drive}, first, last, faults)
    speed = known.get("over")
    every = max(-(-speed.v.size // _POINTS), 1) if speed else 1
    turned = branches(speed.t[::every], speed.v[::every]) if speed else []
    if speed and not turned:
        faults.found.append(
            f"over: {speed.name} does not rise or fall: it stays at {np.nanmin(speed.v):.5g} to "
            f"{np.nanmax(speed.v):.5g} {speed.unit}; a run-up and a run-down are two ramps of drive.speed in the "
            "protocol of the scene"
        )
    faults.raise_found()
    signal = known["signal"]
    shortest = min(branch.end - branch.begin for branch in turned)
    hertz = slowest(signal)
    length = window
    if length is None:
        period = 1.0 / hertz if hertz else 0.0
        length = min(max(_PERIODS * period, PARTS / signal.rate), max(_USUAL * shortest, period))
        length = max(min(length, _LONGEST * shortest), FEWEST / signal.rate)
    if not FEWEST / signal.rate * (1.0 - 1e-9) <= length <= _LONGEST * shortest:
        raise UsageError(
            f"window {length:g} s: must be {FEWEST / signal.rate:g} s ({FEWEST} samples of {signal.name} at "
            f"{signal.rate:g} Hz) to {_LONGEST * shortest:g} s (a quarter of the shortest ramp, {shortest:g} s)"
        )
    return _over_branches(run, signal, known["over"], turned, length, hertz)


def _over_branches(
    run: Run, signal: Series, speed: Series, turned: list[Branch], length: float, hertz: float
) -> Hysteresis:
    t, rms, window = moving_rms(signal, length)
    known = np.isfinite(speed.v)
    fine_t = speed.t[known]
    fine_v = speed.v[known]
    mean = moving_mean(fine_t, fine_v, t, window)
    sticks = stuck(run) if run.scene else None
    met = bool(run.scene) and any(event["kind"] == "contact" for event in run.plant_events)
    begins, ends = short(run) if met else (np.empty(0), np.empty(0))
    curves = []
    lost = 0
    for branch in turned:
        here = (t >= branch.begin) & (t <= branch.end)
        lost += int(np.count_nonzero(~np.isfinite(rms[here])))
        times = np.concatenate([run.time[sticks] if sticks is not None else [], ends if branch.rises else begins])
        stick = _stick(times, branch, fine_t, fine_v)
        curves.append(Curve(branch, t[here], mean[here], rms[here], stick))
    aliasing = tuple(
        filter(None, (signal.notes(), replace(speed, note="").notes()))
    )  # a speed is slow: it has no aliasing
    return Hysteresis(
        scene_name(run),
        signal.name,
        signal.unit,
        speed.name,
        speed.unit,
        window,
        hertz,
        tuple(curves),
        0.0 if sticks is None else float(np.median(np.diff(run.time))),
        met,
        aliasing,
        lost,
    )


def _stick(times: Reals, branch: Branch, t: Reals, v: Reals) -> float:
    """The speed v at t of the last of `times` in a run-up and of the first one in a run-down; NaN without any."""
    here = times[(times >= branch.begin) & (times <= branch.end)]
    here = here[np.interp(here, t, v) != 0.0]  # before the drive moves everything sticks
    return float(np.interp(here.max() if branch.rises else here.min(), t, v)) if here.size else math.nan
