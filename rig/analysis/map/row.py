"""One row of a map, or a part of it: the steady state at each value of x, for every kind of run.

    near   from sliding, with a small perturbation            far    from a standing start
    up     carried from point to point, upwards, from a standing start at the lowest value
    down   carried from point to point, downwards, from the end of `up` (else from a standing start)

A carried run that has come to slide would stay exactly on its equilibrium and leave it far too late. Therefore it gets
the perturbation at every point: it equals the near start of each point until that start vibrates again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from rig.analysis.growth_crossings import Growth, brackets, looked, root, stretches
from rig.analysis.map.job import RUNS, Unit
from rig.analysis.map.steady_state import BLANK, NONE, NOTHING, SLIDING, STICK_SLIP, STOPPED, VIBRATION, Point, stopped
from rig.analysis.map.track import Place, Track
from rig.errors import NumericsError, Singular
from rig.stability.linearisation import Steady

Array = NDArray[np.float64]
Arrays = dict[str, NDArray[np.generic]]
ALIVE = (STICK_SLIP, VIBRATION)
WINDOW = ("low", "high", "rms", "share", "period")
_LONG = 160  # characters of the reason why a run had to stop


class Row:
    """The runs over the values of a unit. `tables` holds their results."""

    def __init__(self, track: Track, unit: Unit) -> None:
        self.track, self.settings = track, track.settings
        self._runs, self._curve = unit.runs, unit.curve
        self.x = track.axis.values[unit.first : unit.last]
        self._next = track.axis.values[unit.first : unit.last + unit.curve]  # with the first value of the next part
        self._singular: dict[int, Singular] = {}
        self._sliding = [self._steady(i, value) for i, value in enumerate(self._next)]
        self._near: dict[int, tuple[Point, Place | None, Array]] = {}
        count, runs = len(self.x), len(RUNS)
        self.tables: Arrays = {
            "state": np.full((runs, count), NONE, dtype=np.int8),
            **{name: np.full((runs, count), np.nan) for name in (*WINDOW, "spent")},
            "why": np.full((runs, count), "", dtype=f"<U{_LONG}"),
            "section": np.full((runs, count, self.settings.section), np.nan),
            "end": np.full((2, 2), np.nan),
        }

    def run(self) -> Arrays:
        """Every run of the unit, and its growth rates."""
        asked = self._runs
        if self._curve:
            least = [self.track.least(value, at) for value, at in zip(self._next, self._sliding)]
            seen = least[: len(self.x)]
            rates = [0.0 if abs(rate.real) <= none else rate.real for rate, none in seen]
            self.tables["growth"] = np.array(rates, dtype=np.float64)
            self.tables["frequency"] = np.array([abs(rate.imag) / (2.0 * math.pi) for rate, _ in seen])
            self.tables["onset"] = np.array(self._onsets(least), dtype=np.float64)
        numbers = range(len(self.x))
        if "up" in asked:
            self._carry("up", numbers, self._standing)
        if "down" in asked:
            self._carry("down", numbers[::-1], None if "up" in asked else self._standing)
        for i in numbers:
            if "near" in asked:
                self._write("near", i, *self._at_near(i))
            if "far" in asked:
                self._write("far", i, *self._standing(i))
        return self.tables

    def stopped(self, why: str) -> Arrays:
        """Return the tables of a unit that could not be simulated, with the reason; growth rates are nan."""
        for run in self._runs:
            self.tables["state"][RUNS.index(run)] = STOPPED
            self.tables["why"][RUNS.index(run)] = why
        if self._curve:
            nothing = np.full(len(self.x), np.nan)
            self.tables |= {"growth": nothing, "frequency": nothing.copy(), "onset": np.zeros(0)}
        return self.tables

    def _steady(self, i: int, value: float) -> Steady | None:
        """Steady sliding at a point; None if the equations of the rig are singular, or if it jams and is not
        simulated.
        """
        try:
            at = self.track.sliding(value)
            if at.inertia <= 0.0 and self.track.scene.clock.unstable == "refuse":
                mode = at.system.describe(at.modes.key)
                raise Singular("jams: friction takes up all of the inertia", mode, jams=True)
        except Singular as error:
            self._singular[i] = error
            return None
        return at

    def _tried(self, carried: Callable[[], Point]) -> tuple[Point, Array]:
        """The steady state of a run and its maxima; a run that has to stop records why, and the map continues."""
        try:
            point = carried()
        except (NumericsError, Singular) as error:
            point = stopped(error)
        return point, self._none() if point.state == STOPPED else self._maxima()

    def _standing(self, i: int) -> tuple[Point, Array]:
        at = self._sliding[i]
        if at is None:
            return stopped(self._singular[i]), self._none()

        def start() -> Point:
            self.track.put(self.x[i], self.track.far(at))
            return self.track.settle()

        return self._tried(start)

    def _at_near(self, i: int) -> tuple[Point, Array]:
        """The near start of a point; the rig stays in the state in which it has settled."""
        if i in self._near:
            point, place, maxima = self._near[i]
            if place is not None:
                self.track.back(place)
            return point, maxima
        at = self._sliding[i]
        if at is None:
            return stopped(self._singular[i]), self._none()
        if not at.exists:
            return NOTHING, self._none()

        def start() -> Point:
            self.track.put(self.x[i], self.track.near(at))
            return self.track.settle(near=True)

        point, maxima = self._tried(start)
        self._near[i] = point, None if point.state == STOPPED else self.track.here(), maxima
        return point, maxima

    def _carry(self, name: str, numbers: Iterable[int], start: Callable[[int], tuple[Point, Array]] | None) -> None:
        """One carried run over the points; `start` None: it continues from the end of the run before."""
        point, maxima = NOTHING, np.zeros(0)
        before = -1
        for i in numbers:
            if before < 0:
                point, maxima = start(i) if start else self._again(i)
            elif point.state in (SLIDING, STOPPED) and (at := self._sliding[i]) is not None and at.exists:
                point, maxima = self._at_near(i)
            elif point.state == STOPPED or self._sliding[i] is None:  # nothing is left to be carried on
                point, maxima = self._standing(i)
            else:
                point, maxima = self._step(name, self.x[before], self.x[i], point.state in ALIVE)
            self._write(name, i, point, maxima)
            before = i

    def _again(self, i: int) -> tuple[Point, Array]:
        """The end of `up`: its result there holds."""
        up, t = RUNS.index("up"), self.tables
        low, high, rms, share, period = (float(t[name][up, i]) for name in WINDOW)
        window = BLANK._replace(low=low, high=high, rms=rms, share=share, period=period)
        return Point(int(t["state"][up, i]), window, 0.0, str(t["why"][up, i])), t["section"][up, i]

    def _step(self, name: str, start: float, to: float, alive: bool) -> tuple[Point, Array]:
        """Move to the next point. A vibration that is lost on the way is carried there again in ever smaller steps.

        It may be lost because the step was too large, and not because the cycle ends.
        """
        place = self.track.here()
        found, maxima = self._go(to)
        if not alive or found.state in ALIVE or found.state == STOPPED:
            return found, maxima
        lost, dead = self.track.here(), to
        gap, least = 0.5 * (to - start), abs(to - start) * 0.5**self.settings.refine
        while abs(gap) > 0.75 * least:
            value = place.value + gap
            if abs(to - value) < 0.5 * least:
                value = to
            self.track.back(place)
            point, latest = self._go(value)
            if point.state not in ALIVE:
                dead, gap = value, 0.5 * gap
            elif value == to:
                return point, latest
            else:
                place = self.track.here()
        self.tables["end"][RUNS.index(name)] = place.value, dead
        self.track.back(lost)
        return found, maxima

    def _go(self, value: float) -> tuple[Point, Array]:
        def on() -> Point:
            self.track.move(value)
            return self.track.settle()

        return self._tried(on)

    def _none(self) -> Array:
        return np.full(self.settings.section, np.nan)

    def _maxima(self) -> Array:
        """The last local maxima of the output."""
        kept = self.settings.section
        if not kept:
            return np.zeros(0)
        y = self.track.values()
        found = y[1:-1][(y[1:-1] > y[:-2]) & (y[1:-1] >= y[2:])][-kept:]
        return np.concatenate([found, np.full(kept - len(found), np.nan)])

    def _write(self, name: str, i: int, point: Point, maxima: Array) -> None:
        run, t = RUNS.index(name), self.tables
        t["state"][run, i] = point.state
        t["spent"][run, i] = point.spent
        t["why"][run, i] = point.why
        t["section"][run, i] = maxima
        for column in WINDOW:
            t[column][run, i] = getattr(point.window, column)

    def _onsets(self, least: list[tuple[complex, float]]) -> list[float]:
        """Values at which the growth rate of sliding passes through zero, one in every gap in which its sign changes.

        An onset at the first value of the next part belongs to that part.
        """
        known = dict(zip(self._next, least))

        def growths(value: float) -> Growth | None:
            if value not in known:
                known[value] = self.track.least(value)
            rate, none = known[value]
            return None if math.isnan(rate.real) else Growth(np.array([rate.real]), np.array([none]))

        def look(grid: list[float]) -> list[float]:
            return [
                root(bracket, growths) for stretch in stretches(grid, growths) for bracket in brackets(stretch, growths)
            ]

        return [at for at in looked(self._next, growths, look) if at != self._next[-1] or at == self.x[-1]]
