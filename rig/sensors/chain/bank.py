"""All instruments of a scene, advanced together, one frame at a time."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rig.errors import SceneError
from rig.kernel import entry
from rig.lent_records import Loan
from rig.sensors.chain.front_end import FrontEnd
from rig.sensors.chain.instants import SECOND, Integers, common_step
from rig.sensors.chain.instrument import Instrument
from rig.sensors.chain.streams import Stream
from rig.solve.pole_response import COLUMNS, POLE, RESIDUE, STATE
from rig.solve.sampling import FRONT, NOW, SHORT, Rack, advance, prepare
from rig.solve.segments import DEGREE, Segments

_CHUNK = 1024  # random numbers drawn and samples kept at a time, at least
_FRAMES = 64  # and for so many frames


class Bank:
    """The instruments of a scene over the plant's outputs.

    `latest[i]` is the last published sample of instrument i (NaN before `start`), `fresh[i]` how many were published in
    the last frame, `samples(i)` these, `times(i)` when. `columns` names the signals of `Segments` in order. `rack` is
    what the kernels work on; where they find the bank `short`, it must be filled up before the next frame.
    """

    def __init__(self, sensors: Mapping[str, Instrument], columns: Sequence[str], frame_ns: int, seed: int) -> None:
        self.names = tuple(sensors)
        self.units = tuple(s.unit for s in sensors.values())
        self.instants = tuple(s.instants for s in sensors.values())
        self.periods_ns = tuple(s.period_ns for s in sensors.values())
        self.step_ns = common_step(frame_ns, self.instants)
        _check(sensors, columns)
        self._sections = tuple(sensors.values())
        self._ends = tuple(s.front_end() for s in self._sections)
        self._columns = tuple(columns)
        self._frame, self._seed = frame_ns, seed
        n = len(self.names)
        most = [int(frame_ns // one.period_ns) + 1 + (not one.even) for one in self.instants]
        wait = max((int(end.delay_ns // end.period_ns) + m + 1 for end, m in zip(self._ends, most)), default=1)
        room = max(_CHUNK, _FRAMES * max(most, default=1))
        self.latest = np.full(n, np.nan)
        self.fresh = np.zeros(n, dtype=np.int64)
        self._samples, self._noise = np.zeros((n, room)), np.zeros((n, room))
        longest = max((max(end.period_ns, frame_ns) * end.dropout_rate * 1e-9 for end in self._ends), default=0.0)
        self._gaps = np.zeros((n, _CHUNK + math.ceil(16 * longest), 2), dtype=np.int64)
        lags = [[round(1e9 * later / end.period_ns) for _, later in end.echoes] for end in self._ends]
        self._past = np.zeros((n, 1 + max((lag for own in lags for lag in own), default=0)))
        shares = [share for end in self._ends for share, _ in end.echoes]
        self._echoes = np.column_stack([np.concatenate([*lags, []]), np.array(shares)])
        self._fronts = np.zeros(n, dtype=FRONT)
        self._poles = np.zeros((sum(max(len(e.poles), e.averages) for e in self._ends), COLUMNS), dtype=complex)
        self._most = most
        self._clock = np.zeros(2, dtype=np.int64)
        self.rack = Loan(
            Rack(
                self._fronts,
                self._poles,
                self.latest,
                self.fresh,
                np.zeros((n, wait)),
                self._samples,
                self._noise,
                self._gaps,
                self._past,
                self._echoes,
                self._clock,
                frame_ns,
                1e-9 * self.step_ns,
            )
        )
        self._run: Callable[..., int] | None = None

    @staticmethod
    def needs(sensors: Mapping[str, Instrument]) -> tuple[str, ...]:
        """The plant outputs that are read, each once."""
        return tuple(dict.fromkeys(s.reads for s in sensors.values()))

    def start(self, values: NDArray[np.float64]) -> None:
        """Settle on the constant input `values` [columns] and publish the sample at t = 0. Begins the run anew."""
        self.latest[:] = np.nan
        self._streams = [Stream(self._seed, name) for name in self.names]
        row = 0
        before = (max((end.delay_ns for end in self._ends), default=0) // self._frame + 1) * self._frame
        for i, (section, end) in enumerate(zip(self._sections, self._ends)):
            y = float(values[self._columns.index(section.reads)])
            row = self._settle(i, row, end, y, before)
        prepare(self.rack)
        self.fill(everything=True)
        # A delayed sample was taken before t = 0: run the frames before it on the constant input.
        coef = np.zeros((1, len(values), DEGREE + 1))
        coef[0, :, 0] = values
        whole = Segments(np.ones(1, dtype=np.int64), np.zeros(1), np.array([1e-9 * self._frame]), coef)
        self._clock[NOW] = -before
        while self._clock[NOW] < 0:
            self.advance(whole)

    def advance(self, segments: Segments) -> None:
        """Run one frame; `latest`, `fresh` and `samples` then hold what it published."""
        if self.short:
            self.fill()
        if self._run is None:
            self._run = entry(advance, self.rack, Loan(segments))
        self._run(self.rack, Loan(segments))

    @property
    def short(self) -> bool:
        """Whether the bank must be filled up before the next frame."""
        return bool(self._clock[SHORT])

    def samples(self, i: int) -> NDArray[np.float64]:
        """Samples that instrument i published in the last frame: a view, good until the bank is filled up."""
        kept = self._fronts["kept"][i]
        return self._samples[i, kept - self.fresh[i] : kept]

    def since(self, i: int, number: int) -> NDArray[np.float64]:
        """Samples of instrument i from sample `number` on: a view. The last one of all is always kept."""
        kept, published = int(self._fronts["kept"][i]), int(self._fronts["published"][i])
        return self._samples[i, number - published + kept : kept]

    def shown(self, i: int, t_ns: Sequence[int]) -> list[float]:
        """What `latest[i]` was at instants [ns] since the bank was filled up."""
        last = self.instants[i].until(np.array(t_ns)) - 1
        return self.since(i, int(last[0]))[last - last[0]].tolist()  # type: ignore[no-any-return]

    def published(self, i: int, t_ns: Sequence[int]) -> list[list[float]]:
        """What `samples(i)` was at instants [ns], one frame after another, since the bank was filled up."""
        behind = self.instants[i].until(np.array([t_ns[0] - self._frame, *t_ns]))
        kept = self.since(i, int(behind[0])).tolist()
        ends = (behind - behind[0]).tolist()
        return [kept[first:last] for first, last in pairwise(ends)]

    def first(self, i: int) -> int:
        """The number of the first of them, counted from 0."""
        return int(self._fronts["published"][i] - self.fresh[i])

    def times(self, i: int) -> Integers:
        """When they were published [ns]."""
        first = self.first(i)
        return self.instants[i].at(np.arange(first, first + int(self.fresh[i])))

    def counters(self) -> dict[str, dict[str, int]]:
        """Per instrument: samples clipped, dropped out, and lost to the slew limit since the start."""
        kept = ("clipped", "dropped_out", "slew_lost")
        return {name: {key: int(self._fronts[key][i]) for key in kept} for i, name in enumerate(self.names)}

    def _settle(self, i: int, row: int, end: FrontEnd, y: float, before: int) -> int:
        """Put instrument i to rest on the input y, `before` [ns] ahead of t = 0; returns the next free row of poles."""
        s = self._fronts[i]
        self._fronts[i] = np.zeros((), dtype=FRONT)
        s["column"] = self._columns.index(self._sections[i].reads)
        s["period"], s["rest"] = end.instants.whole
        s["samples"], s["cycle"] = end.instants.samples, SECOND * end.instants.seconds
        s["mean"], s["delay"], s["most"] = end.period_ns, end.delay_ns, self._most[i]
        for key in ("averages", "holds", "direct", "gain", "offset", "slope", "warmth", "fade", "rise", "noise"):
            s[key] = getattr(end, key)
        s["low"], s["high"], s["resolution"] = end.low, end.high, end.resolution
        s["slew"] = end.slew * 1e-9 * end.period_ns
        s["dropouts"] = end.dropout_rate > 0.0
        s["first"] = row
        at_rest = end.direct * y
        if end.averages:  # the integral since the last sample; the next one is due `delay` before t = 0
            window = 1e-9 * (end.period_ns - before + end.delay_ns)
            self._poles[row, [STATE, POLE, RESIDUE]] = y * window, 0.0, 1e9 / end.period_ns
            at_rest = y
            row += 1
        for pole, residue in zip(end.poles, end.residues):
            pair = 2.0 if pole.imag else 1.0
            self._poles[row, [STATE, POLE, RESIDUE]] = -y / pole, pole, pair * residue
            at_rest -= (pair * residue * y / pole).real
            row += 1
        s["last"] = row
        before_it = sum(len(other.echoes) for other in self._ends[:i])
        s["echo"], s["silence"] = before_it, before_it + len(end.echoes)
        self._past[i] = end.gain * at_rest
        s["followed"] = s["previous"] = end.gain * at_rest * (1.0 + sum(share for share, _ in end.echoes))
        return row

    def fill(self, everything: bool = False) -> None:
        """Draw random numbers for what is used up, and forget all samples but the last of each instrument."""
        self._clock[SHORT] = 0
        for i, (end, stream) in enumerate(zip(self._ends, self._streams)):
            s = self._fronts[i]
            if s["kept"] > 1:
                self._samples[i, 0], s["kept"] = self._samples[i, s["kept"] - 1], 1
            if end.noise > 0.0:
                used = self._noise.shape[1] if everything else int(s["drawn"])
                left = self._noise.shape[1] - used
                self._noise[i, :left] = self._noise[i, used:].copy()
                self._noise[i, left:] = stream.noise(used)
                s["drawn"] = 0
            if end.dropout_rate > 0.0:
                used = self._gaps.shape[1] if everything else int(s["gap"])
                left = self._gaps.shape[1] - used
                self._gaps[i, :left] = self._gaps[i, used:].copy()
                self._gaps[i, left:] = stream.gaps(used, end.dropout_rate, end.dropout_shortest, end.dropout_longest)
                s["gap"] = 0


def _check(sensors: Mapping[str, Instrument], columns: Sequence[str]) -> None:
    """Raise SceneError with every instrument that cannot run."""
    faults = []
    for name, s in sensors.items():
        if s.reads not in columns:
            near = get_close_matches(s.reads, columns, n=3) or sorted(columns)
            faults.append(f"{name}.reads = {s.reads!r}: the plant has no such output; near: {', '.join(near)}")
    if faults:
        raise SceneError("sensors", faults)
