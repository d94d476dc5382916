"""Hysteresis: the RMS of a vibration over the drive speed as it rises and falls; bistability shows as a loop.

    rms(t) = sqrt(mean (v - mean v)^2)        both means over the same window, centred at t

A window smears a transition over the change of speed within it; the report states both. Therefore the critical speeds
come from the contact state and not from the RMS: the last stick of a run-up and the first one of a run-down.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from rig.analysis.recorded.moving_windows import FEWEST, PARTS, moving_mean, moving_rms, slowest
from rig.analysis.recorded.series import Series, channels, drive, scene_name, vibration
from rig.analysis.recorded.speed_branches import Branch, branches
from rig.analysis.recorded.stick_speeds import short, stuck
from rig.errors import Faults, UsageError
from rig.printable import counted
from rig.record.run import Reals, Run
from rig.results import Column, Result, Table

_PERIODS = 5.0  # default window, in periods of the slowest strong vibration
_LONGEST = 0.25  # share of the shortest branch: a longer window blurs all of it
_USUAL = 0.05  # share of the shortest branch: the longest default window
_WHOLE = 0.95  # periods that count as one
_BINS = 20  # ranges of the speed in the report
_POINTS = 20_000  # samples of the speed that its branches are found from


class Row(NamedTuple):
    """One of the ranges of the speed: its middle, and the RMS in it as the speed rises and falls; NaN if unknown."""

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
        return self._fastest_stick(True)

    @property
    def down(self) -> float:
        """The highest speed at which the contact stuck again as the speed fell; NaN without stick."""
        return self._fastest_stick(False)

    def _fastest_stick(self, rises: bool) -> float:
        """The highest speed with stick in the run-ups, or in the run-downs; NaN without stick."""
        sticks = (curve.stick for curve in self.curves if curve.branch.rises == rises)
        return max(filter(math.isfinite, sticks), default=math.nan)

    def rows(self) -> list[Row]:
        """Return the RMS over the speed, in even steps of the speed."""
        ends = [end for curve in self.curves for end in (curve.branch.first, curve.branch.last)]
        edges = np.linspace(min(ends), max(ends), _BINS + 1)
        middles = 0.5 * (edges[1:] + edges[:-1])
        up, down = (self._binned(edges, rises) for rises in (True, False))
        return [Row(*map(float, row)) for row in zip(middles, up, down)]

    def _binned(self, edges: Reals, rises: bool) -> Reals:
        """Root mean square of all windows of a bin."""
        curves = [curve for curve in self.curves if curve.branch.rises == rises]
        speed = np.concatenate([np.empty(0), *(curve.speed for curve in curves)])
        square = np.concatenate([np.empty(0), *(curve.rms for curve in curves)]) ** 2
        known = np.isfinite(square)
        where = np.digitize(speed[known], edges[1:-1])
        count = np.bincount(where, minlength=_BINS)
        with np.errstate(invalid="ignore"):
            return np.sqrt(np.bincount(where, square[known], _BINS) / count)  # type: ignore[no-any-return]

    def shown(self) -> Iterator[str | Table]:
        """Yield how the RMS was computed, the branches of the speed, and the RMS over the speed."""
        over = self.over_unit
        periods = self.window * self.frequency
        window = f"{self.window:.4g} s"
        if self.frequency:
            window += f" ({periods:.3g} periods of {self.frequency:.4g} Hz)"
        smear = f"{self.over} changes by up to {self.smear:.3g} {over} in it"
        yield f"{self.scene}: RMS of {self.name} [{self.unit}] over {self.over} [{over}]"
        yield f"  RMS about the mean, in a centred window of {window}; {smear}"
        yield from (f"  {gap}" for gap in self.gaps)
        if 0.0 < periods < _WHOLE:
            yield "  the window is shorter than a period: the RMS follows the vibration itself"
        if self.lost:
            yield f"  {counted(self.lost, 'window')} left out: less than half of the samples are there"
        for curve in self.curves:
            branch = curve.branch
            stuck = ""
            if self.modes or self.events:
                at = f"at {curve.stick:.5g} {over}" if math.isfinite(curve.stick) else "none"
                stuck = f", {'last' if branch.rises else 'first'} stick {at}"
            way = f"run-{'up' if branch.rises else 'down'} {branch.begin:.5g} to {branch.end:.5g} s"
            yield f"  {way}, {branch.first:.5g} to {branch.last:.5g} {over}{stuck}"
        if not self.modes and not self.events:
            yield "  contact states were not recorded: stick is unknown"
        else:
            missed = "" if self.events else ": shorter sticks may be missed"
            yield f"  contact states were recorded every {self.modes:.3g} s{missed}"
        if self.up > self.down:
            yield f"  between {self.down:.5g} and {self.up:.5g} {over} it sticks and slips only while the speed rises"
        yield ""
        units = (over, self.unit, self.unit)
        columns = [Column(name, unit, ".5g") for name, unit in zip(Row._fields, units)]
        yield Table("rows", columns, self.rows())

    def facts(self) -> dict[str, Any]:
        """Return the settings and the branches; the windows one by one are in `csv`."""
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
        }

    def listed(self) -> Table:
        """Return every window: branch, direction, time, speed, RMS; empty where it is not known."""
        columns = (
            Column("branch"),
            Column("direction"),
            Column("time", "s"),
            Column(self.over, self.over_unit),
            Column(f"rms of {self.name}", self.unit),
        )
        rows = [
            (number, "rising" if curve.branch.rises else "falling", t, speed, None if math.isnan(rms) else rms)
            for number, curve in enumerate(self.curves, 1)
            for t, speed, rms in zip(curve.t.tolist(), curve.speed.tolist(), curve.rms.tolist())
        ]
        return Table("windows", columns, rows)


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
    stuck_at = run.time[sticks] if sticks is not None else np.empty(0)
    for branch in turned:
        inside = (t >= branch.begin) & (t <= branch.end)
        lost += int(np.count_nonzero(~np.isfinite(rms[inside])))
        times = np.concatenate([stuck_at, ends if branch.rises else begins])
        stick = _stick(times, branch, fine_t, fine_v)
        curves.append(Curve(branch, t[inside], mean[inside], rms[inside], stick))
    slow = replace(speed, note="")  # a speed has no aliasing
    gaps = tuple(filter(None, (signal.notes(), slow.notes())))
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
        gaps,
        lost,
    )


def _stick(times: Reals, branch: Branch, t: Reals, v: Reals) -> float:
    """The speed v at t of the last of `times` in a run-up and of the first one in a run-down; NaN without any."""
    sticks = times[(times >= branch.begin) & (times <= branch.end)]
    sticks = sticks[np.interp(sticks, t, v) != 0.0]  # before the drive moves everything sticks
    if not sticks.size:
        return math.nan
    return float(np.interp(sticks.max() if branch.rises else sticks.min(), t, v))
