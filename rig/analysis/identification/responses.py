"""What the rig does at values of its free parameters: the work of the pool, and its results on a grid.

A cycle comes as one period of each output on an even grid that begins where the longest stick of the first contact
ends, or, without stick, at the largest value of the first output. The instrument acts as a linear filter of the period.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from rig.analysis.cycles.cycle import limit_cycle
from rig.analysis.cycles.cycle_report import Cycle
from rig.analysis.identification.runs import Law, Measured
from rig.analysis.pool import Arrays, Store, Work, digest, pool, temporary
from rig.analysis.pool.kernel_shapes import prepare
from rig.errors import NumericsError, RigError, SceneError
from rig.record.run import Reals
from rig.scenes.belief import varied
from rig.scenes.scene import Scene

POINTS = 2048
"""Points of a period, a power of two."""
ACCURACY = 1e-8
"""Relative tolerance of adaptive methods in a fit: differences over a thousandth of a parameter need no more."""
LONGEST_SETTLING = 25.0
"""Time within which a motion settles during a fit [s]."""
_MOST = 1_000_000  # evaluations that a work may number


@dataclass(frozen=True)
class Response:
    """One period of a run's columns: `waves` [column, POINTS] in SI, period and longest stick [s].

    `slopes` [column]: rate of each column while the contact sticks, of a velocity its value; NaN without stick.
    """

    period: float
    stick: float
    slopes: Reals
    waves: Reals

    def at(self, column: int, phase: Reals) -> Reals:
        """The column at phases in periods (any real numbers), by lines between the points."""
        return self.with_rate(column, phase)[0]

    def with_rate(self, column: int, phase: Reals) -> tuple[Reals, Reals]:
        """The column at phases in periods, by lines between the points, and its derivative by the phase."""
        wave, rise, rate, bend = self._tables[column]
        place = phase * POINTS
        whole = np.floor(place)
        share = place - whole
        i = whole.astype(np.int64) & (POINTS - 1)
        return wave[i] + share * rise[i], rate[i] + share * bend[i]

    @cached_property
    def _tables(self) -> list[tuple[Reals, Reals, Reals, Reals]]:
        tables = []
        for wave in self.waves:
            after = np.roll(wave, -1)
            rate = 0.5 * POINTS * (after - np.roll(wave, 1))
            tables.append((wave, after - wave, rate, np.roll(rate, -1) - rate))
        return tables


@dataclass(frozen=True)
class Responder:
    """The responses of a law's scene to values of its free parameters. Items of the work are evaluations."""

    law: Law
    runs: tuple[Measured, ...]
    respond: Callable[[Scene, Measured], Response | str]
    """What a scene does in a run, or why it does nothing."""
    seed: int = 1
    candidates: tuple[str, ...] = ()
    """Keys with a fixed value, whose factors may be given behind the values of the free ones."""
    twin: Callable[..., Arrays] | None = None
    """Of a scene, a run and what follows the values: what noise does to a fit (rig.analysis.identification.twins)."""

    @property
    def keys(self) -> tuple[str, ...]:
        """The free parameters."""
        return tuple(free.key for free in self.law.free)

    def scene(self, run: int, values: Sequence[float]) -> Scene:
        """The scene of a run at `values` (SI) of the free parameters, `runs` settings included."""
        settings = self.runs[run].settings | dict(zip(self.keys, values))
        for key, factor in zip(self.candidates, values[len(self.keys) :]):
            if factor != 1.0:
                settings[key] = factor * settings.get(key, float(self.law.scene.values()[key][0]))
        return varied(self.law.scene, settings)

    def compute(self, unit: int, run: float, *values: float) -> Arrays:
        """The response of run number `run`, or for -1 - run its twin; `why` tells why there is none."""
        del unit
        if run < 0.0:
            return self._twin(int(-1.0 - run), values)
        measured = self.runs[int(run)]
        try:
            scene = self.scene(int(run), values)
            response = self.respond(scene, measured)
        except (SceneError, NumericsError) as fault:
            return {"why": np.array(str(fault)[:500])}
        if isinstance(response, str):
            return {"why": np.array(response[:500])}
        shape = np.array([response.period, response.stick])
        return {"why": np.array(""), "shape": shape, "slopes": response.slopes, "waves": response.waves}

    def _twin(self, run: int, values: Sequence[float]) -> Arrays:
        assert self.twin is not None
        count = len(self.keys)
        try:
            scene = self.scene(run, values[:count])
            return {"why": np.array(""), **self.twin(scene, self.runs[run], *values[count:])}
        except RigError as fault:
            return {"why": np.array(str(fault)[:500])}

    def prepare(self) -> None:
        """Compile the kernels."""
        prepare([self.law.scene])

    @property
    def work(self) -> Work:
        """As a work of the pool."""
        data = [(run, _hashes(run)) for run in self.runs]
        text = repr((self.law.free, self.seed, data))
        scene = self.law.scene
        law = self.law.name
        about = {"scene": scene.name, "law": law}
        items = range(_MOST)
        return Work(self.compute, items, f"{scene.name}-{law}", digest(scene, text), self.prepare, self.failed, about)

    def failed(self, unit: int, why: str) -> Arrays:
        """The response of an evaluation that ended its worker twice."""
        del unit
        return {"why": np.array(why)}


class Evaluator:
    """Evaluates responses in the pool, in an order that repeats, so that a lasting folder continues a fit."""

    def __init__(self, responder: Responder, folder: Path | None, workers: int | None) -> None:
        self.responder = responder
        self._folder = folder
        self._workers = workers
        self.count = 0
        self._known: dict[tuple[float, ...], Response | str] = {}
        self.progress: Callable[[int], object] = lambda done: None

    def __enter__(self) -> Evaluator:
        work = self.responder.work
        with ExitStack() as stack:
            if self._folder is None:
                self.store = stack.enter_context(temporary(work))
            else:
                self.store = Store.of(work, self._folder)
                stack.enter_context(self.store.open(work))
            runs = max(2, len(self.responder.runs))
            self._pool = stack.enter_context(pool(work, self.store, self._workers, runs))
            self._rows = self.store.load()
            self._stack = stack.pop_all()
        return self

    def __exit__(self, kind: Any, fault: Any, at: Any) -> None:
        self._stack.__exit__(kind, fault, at)

    def responses(self, points: Sequence[Sequence[float]], runs: Sequence[int]) -> list[list[Response | str]]:
        """The responses [point, run] at points (SI) of the free parameters; a text where there is none."""
        asked = [(run, *point) for point in points for run in runs]
        new = [*dict.fromkeys(given for given in asked if given not in self._known)]
        self._known |= zip(new, map(_response, self._computed(new)))
        answers = [self._known[given] for given in asked]
        return [answers[i : i + len(runs)] for i in range(0, len(answers), len(runs))]

    def twins(
        self, runs: Sequence[int], values: Sequence[float], given: Sequence[Sequence[float]]
    ) -> list[Arrays | str]:
        """The twins of runs at `values` (SI) of the free parameters, with what is `given` for each; see `Responder`."""
        rows = self._computed([(-1 - run, *values, *each) for run, each in zip(runs, given)])
        return [str(row["why"]) or row for row in rows]

    def _computed(self, asked: Sequence[tuple[float, ...]]) -> list[Arrays]:
        units = range(self.count, self.count + len(asked))
        todo = {u: given for u, given in zip(units, asked) if u not in self._rows}
        if todo:
            self._pool.compute(todo, lambda done: self.progress(self.count + done))
            self._rows |= {u: row for u, row in self.store.load(min(todo)).items() if u in todo}
            self._rows |= {u: self.responder.failed(u, why) for u, why in self._pool.failed.items() if u in todo}
        self.count += len(asked)
        self.progress(self.count)
        return [self._rows.pop(u) for u in units]


def cycle_response(scene: Scene, measured: Measured) -> Response | str:
    """The limit cycle of `scene` as the columns see it; the reason, if there is none."""
    cycle = limit_cycle(scene, ACCURACY, LONGEST_SETTLING)
    if not cycle.found:
        return cycle.why
    return sampled(cycle, scene, measured)


def sampled(cycle: Cycle, scene: Scene, measured: Measured) -> Response:
    """A cycle on the grid of a response."""
    T = cycle.period
    longest = max(cycle.sticking, key=lambda span: span[1] - span[0], default=None)
    first = cycle.outputs[measured.columns[0].output]
    begin = longest[1] if longest else float(cycle.time[int(np.argmax(first))])
    t = np.arange(POINTS) * (T / POINTS) + begin
    waves = []
    slopes = []
    for column in measured.columns:
        raw = np.interp(np.mod(t, T), cycle.time, cycle.outputs[column.output], period=T)
        slopes.append(_slope(cycle, column.output, cycle.units[column.output], longest))
        waves.append(_filtered(raw, T, scene, column.sensor))
    stick = longest[1] - longest[0] if longest else 0.0
    return Response(T, stick, np.array(slopes), np.array(waves))


def _hashes(run: Measured) -> list[str]:
    return [hashlib.sha256(column.v.tobytes()).hexdigest() for column in run.columns]


def _slope(cycle: Cycle, output: str, unit: str, stick: tuple[float, float] | None) -> float:
    """The rate of an output in stick, of a velocity its mean."""
    if stick is None:
        return math.nan
    inside = (cycle.time > stick[0]) & (cycle.time < stick[1])
    t = cycle.time[inside]
    y = cycle.outputs[output][inside]
    if t.size < 3:
        return math.nan
    return float(y.mean()) if unit.endswith("/s") else float(np.polyfit(t - t[0], y, 1)[0])


def _filtered(wave: Reals, period: float, scene: Scene, sensor: str) -> Reals:
    """The steady answer of an instrument to a period: its filter without delay, which is free."""
    if not sensor:
        return wave
    section = scene.sensors[sensor]
    end = section.front_end()
    lines = np.fft.rfft(wave)
    conversion = section.conversion or 1.0
    orders = np.arange(1, min(lines.size, 512))
    s = 2j * math.pi * orders / period
    gains = np.array([end.response(value) for value in s]) * conversion * np.exp(s * 1e-9 * end.delay_ns)
    lines[orders] *= gains
    lines[orders.size + 1 :] = 0.0 if abs(gains[-1]) < 0.5 else lines[orders.size + 1 :]
    steady = complex(end.response(1e-9 + 0j)).real * conversion
    lines[0] = lines[0] * steady + end.offset * conversion * wave.size
    return np.asarray(np.fft.irfft(lines, wave.size))


def _response(row: Arrays) -> Response | str:
    if why := str(row["why"]):
        return why
    period, stick = row["shape"].tolist()
    return Response(period, stick, row["slopes"], row["waves"])
