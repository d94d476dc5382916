"""Hysteresis: the RMS of a vibration over the drive speed as it rises and falls; bistability shows as a loop.

    rms(t) = sqrt(mean (v - mean v)^2)        both means over the same window, centred at t

A window smears a transition over the change of speed within it; the report states both. Therefore the critical speeds
come from the contact state and not from the RMS: the last stick of a run-up and the first one of a run-down.
"""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from rig.analysis.recorded.branches import Branch, branches
from rig.analysis.recorded.series import Series, drive, scene_name, series, vibration
from rig.analysis.recorded.windows import FEWEST, PARTS, moving_mean, moving_rms, slowest
from rig.analysis.text_table import columns
from rig.analysis.three_stages import short, stuck
from rig.errors import UsageError
from rig.record.run import Reals, Run
from rig.results import Result

_PERIODS = 5.0
"""Default window, in periods of the slowest strong vibration."""
_LONGEST = 0.25
"""Share of the shortest branch: a longer window blurs all of it."""
_USUAL = 0.05
"""Share of the shortest branch: the longest default window."""
_WHOLE = 0.95  # periods that count as one
_BINS = 20
_POINTS = 20_000  # samples of the speed that its branches are found from


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

    FIGURE: ClassVar = "rig.analysis.recorded.figure:hysteresis_figure"

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
        return _most([curve.stick for curve in self.curves if curve.branch.rises], max)

    @property
    def down(self) -> float:
        """The highest speed at which the contact stuck again as the speed fell; NaN without stick."""
        return _most([curve.stick for curve in self.curves if not curve.branch.rises], max)

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
        unit, over = self.unit, self.over_unit
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
            lines.append(f"  {self.lost} windows are left out: less than half of their samples are there")
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
            "branches": [{**curve.branch._asdict(), "rises": curve.branch.rises, "stick": curve.stick}
                         for curve in self.curves],
            "rows": [row._asdict() for row in self.rows()],
        }  # fmt: skip

    def csv(self) -> str:
        """Return every window as a line: branch, direction, time, speed, RMS."""
        made = io.StringIO()
        writer = csv.writer(made, lineterminator="\n")
        writer.writerow(["branch", "direction", "time [s]", f"{self.over} [{self.over_unit}]",
                         f"rms of {self.name} [{self.unit}]"])  # fmt: skip
        for number, curve in enumerate(self.curves, 1):
            way = "rising" if curve.branch.rises else "falling"
            for t, speed, rms in zip(curve.t.tolist(), curve.speed.tolist(), curve.rms.tolist()):
                writer.writerow([number, way, f"{t:.9g}", f"{speed:.9g}", "" if math.isnan(rms) else f"{rms:.9g}"])
        return made.getvalue()


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
    faults: list[str] = []
    found: dict[str, Series] = {}
    for what, given, usual in (("signal", name, vibration), ("over", over, drive)):
        try:
            found[what] = series(run, given or usual(run), first, last)
        except UsageError as error:
            faults.append(f"{what}: {error}")
    turned = _branches(found["over"]) if "over" in found else []
    if "over" in found and not turned:
        v, unit = found["over"].v, found["over"].unit
        faults.append(
            f"over: {found['over'].name} does not rise or fall: it stays at {np.nanmin(v):.5g} to {np.nanmax(v):.5g} "
            f"{unit}; a run-up and a run-down are two ramps of drive.speed in the protocol of the scene"
        )
    if faults:
        raise UsageError("\n".join(faults))
    signal, shortest = found["signal"], min(branch.end - branch.begin for branch in turned)
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
    return _found(run, signal, found["over"], turned, length, hertz)


def _found(run: Run, signal: Series, speed: Series, turned: list[Branch], length: float, hertz: float) -> Hysteresis:
    t, rms, window = moving_rms(signal, length)
    known = np.isfinite(speed.v)
    fine_t, fine_v = speed.t[known], speed.v[known]
    mean = moving_mean(fine_t, fine_v, t, window)
    sticks = stuck(run) if run.scene else None
    met = bool(run.scene) and any(event["kind"] == "contact" for event in run.plant_events)
    begins, ends = short(run) if met else (np.empty(0), np.empty(0))
    curves, lost = [], 0
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
        scene_name(run), signal.name, signal.unit, speed.name, speed.unit, window, hertz, tuple(curves),
        0.0 if sticks is None else float(np.median(np.diff(run.time))), met, aliasing, lost,
    )  # fmt: skip


def _branches(speed: Series) -> list[Branch]:
    every = max(-(-speed.v.size // _POINTS), 1)
    return branches(speed.t[::every], speed.v[::every])


def _stick(times: Reals, branch: Branch, t: Reals, v: Reals) -> float:
    """The speed v at t of the last of `times` in a run-up and of the first one in a run-down; NaN without any."""
    here = times[(times >= branch.begin) & (times <= branch.end)]
    here = here[np.interp(here, t, v) != 0.0]  # before the drive moves everything sticks
    return float(np.interp(here.max() if branch.rises else here.min(), t, v)) if here.size else math.nan


def _most(values: list[float], choose: Any) -> float:
    known = [value for value in values if math.isfinite(value)]
    return float(choose(known)) if known else math.nan
