"""All instruments of a scene, advanced together, one frame at a time."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.compiled.kernel import entry
from rig.compiled.records import Loan
from rig.sensors.chain.front_end import FrontEnd
from rig.sensors.chain.instants import SECOND, Integers, Stream, common_step
from rig.sensors.chain.instrument import Instrument
from rig.solve.expm import COLUMNS, POLE, RESIDUE, STATE
from rig.solve.sampling import CLOCK, GATHERED, INSTRUMENT, InstrumentTables, advance_instruments, prepare_poles
from rig.solve.segment_output import DEGREE, Segments

CHUNK = 1024  # least number of random numbers drawn and of samples stored at a time, unless a caller names another
_FRAMES = 64  # least number of frames for which they suffice
KEPT_NS = 250_000_000
"""Shortest time for which samples are stored. # chosen: a plant then copies those that are not sent yet rarely"""


class Bank:
    """The instruments of a scene, which measure the plant's outputs.

    `latest[i]` is the last published sample of instrument i (NaN before `start`), `fresh[i]` the number of samples
    published in the last frame, `samples(i)` their values. `columns`: names of the outputs in
    `Segments`, in order: all that the instruments read. `loan`: the record that the kernels read and write; if they
    find the bank `short`, it must be filled before the next frame.
    """

    def __init__(
        self,
        sensors: Mapping[str, Instrument],
        columns: Sequence[str],
        frame_ns: int,
        seed: int,
        chunk: int = CHUNK,
    ) -> None:
        self.names = tuple(sensors)
        self.units = tuple(s.unit for s in sensors.values())
        self.instants = tuple(s.instants for s in sensors.values())
        self.periods_ns = tuple(s.period_ns for s in sensors.values())
        self.step_ns = common_step(frame_ns, self.instants)
        self._sections = tuple(sensors.values())
        self._ends = tuple(s.front_end() for s in self._sections)
        self._columns = tuple(columns)
        self._frame = frame_ns
        self.seed = seed
        """Seed of the noise that `start`, `resume` and `back` draw."""
        n = len(self.names)
        most = [int(frame_ns // instants.period_ns) + 1 + (not instants.even) for instants in self.instants]
        wait = max((int(end.delay_ns // end.period_ns) + m + 1 for end, m in zip(self._ends, most)), default=1)
        room = max(chunk, _FRAMES * max(most, default=1))
        self.latest = np.full(n, np.nan)
        self.fresh = np.zeros(n, dtype=np.int64)
        stored = max(room, *(int(KEPT_NS // instants.period_ns) for instants in self.instants), 0)
        self._samples = np.zeros((n, stored))
        self._noise = np.zeros((n, room))
        self._memory = [row.data for row in self._samples]
        longest = max((max(end.period_ns, frame_ns) * end.dropout_rate * 1e-9 for end in self._ends), default=0.0)
        self._gaps = np.zeros((n, CHUNK + math.ceil(16 * longest), 2), dtype=np.int64)
        lags = list[int]()
        shares = list[float]()
        for end in self._ends:
            for share, later in end.echoes:
                lags.append(round(1e9 * later / end.period_ns))
                shares.append(share)
        self._past = np.zeros((n, 1 + max(lags, default=0)))
        self._echoes = np.column_stack([np.array(lags, np.float64), np.array(shares)])
        self._fronts = np.zeros(n, dtype=INSTRUMENT)
        self._numbers = self._fronts["kept"].data, self._fronts["published"].data
        """Of each instrument the numbers of samples that are stored and that were published (views)."""
        self._poles = np.zeros((sum(max(len(e.poles), e.averages) for e in self._ends), COLUMNS), dtype=complex)
        self._most = most
        clock = np.zeros(1, dtype=CLOCK)
        self._clock = clock[0]
        self.loan = Loan(
            InstrumentTables(
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
                clock,
                np.zeros(GATHERED + 1, dtype=np.int64),
                frame_ns,
                1e-9 * self.step_ns,
            )
        )
        self._run: Callable[..., int] | None = None

    @staticmethod
    def needs(sensors: Mapping[str, Instrument]) -> tuple[str, ...]:
        """Names of the plant outputs that the sensors read, each once."""
        return tuple(dict.fromkeys(s.reads for s in sensors.values()))

    def start(self, values: NDArray[np.float64]) -> None:
        """Begin a run: settle on the constant input `values` [column] and publish the sample at t = 0."""
        self.latest[:] = np.nan
        self._streams = [Stream(self.seed, name) for name in self.names]
        row = 0
        before = (max((end.delay_ns for end in self._ends), default=0) // self._frame + 1) * self._frame
        for i, (section, end) in enumerate(zip(self._sections, self._ends)):
            y = float(values[self._columns.index(section.reads)])
            row = self._settle(i, row, end, y, before)
        prepare_poles(self.loan)
        self.fill(everything=True)
        # A delayed sample was taken before t = 0: run the frames before t = 0 with the constant input.
        coef = np.zeros((1, len(values), DEGREE + 1))
        coef[0, :, 0] = values
        whole = Segments(np.ones(1, dtype=np.int64), np.zeros(1), np.array([1e-9 * self._frame]), coef)
        self._clock["now"] = -before
        while self._clock["now"] < 0:
            self.advance(whole)

    def advance(self, segments: Segments) -> None:
        """Run one frame; afterwards `latest`, `fresh` and `samples` contain the samples published in it."""
        if self.short:
            self.fill()
        if self._run is None:
            self._run = entry(advance_instruments, self.loan, Loan(segments))
        self._run(self.loan, Loan(segments))

    @property
    def short(self) -> bool:
        """Whether the bank must be filled before the next frame."""
        return bool(self._clock["short"])

    @property
    def full(self) -> bool:
        """Whether the samples of the next frames may find no room: `fill` then drops those before them."""
        room = self._samples.shape[1]
        return any(kept + GATHERED * most > room for kept, most in zip(self._numbers[0], self._most))

    def samples(self, i: int) -> NDArray[np.float64]:
        """Samples [sample] that instrument i published in the last frame: a view, valid until the bank is filled."""
        kept = self._fronts["kept"][i]
        return self._samples[i, kept - self.fresh[i] : kept]

    def give(self, i: int, value: float) -> None:
        """Let instrument i, whose samples are `given`, publish `value` from its sample of the last frame on."""
        front = self._fronts[i]
        front["offset"] = value
        if self.fresh[i]:
            self.latest[i] = value
            self._samples[i, front["kept"] - 1] = value

    def since(self, i: int, number: int) -> NDArray[np.float64]:
        """Samples [sample] of instrument i from sample `number` on: a view. The last sample is always stored."""
        kept, published = self._numbers
        return self._samples[i, number - published[i] + kept[i] : kept[i]]

    def counts(self) -> list[int]:
        """The number of samples that each instrument has published."""
        return self._fronts["published"].tolist()  # type: ignore[no-any-return]

    def memory(self, i: int, number: int, most: int) -> memoryview:
        """At most `most` samples of instrument i from sample `number` on, as a view of memory.

        A view as an array costs the thread of a plant 3 us more.
        """
        kept, published = self._numbers
        end = kept[i]
        first = number - published[i] + end
        return self._memory[i][first : min(first + most, end)]

    def shown(self, i: int, t_ns: Sequence[int]) -> list[float]:
        """The values that `latest[i]` had at instants [ns] since the bank was filled."""
        last = self.instants[i].until(np.array(t_ns)) - 1
        return self.since(i, int(last[0]))[last - last[0]].tolist()  # type: ignore[no-any-return]

    def published(self, i: int, t_ns: Sequence[int]) -> list[list[float]]:
        """The values that `samples(i)` had at instants [ns], one per frame in order, since the bank was filled."""
        behind = self.instants[i].until(np.array([t_ns[0] - self._frame, *t_ns]))
        kept = self.since(i, int(behind[0])).tolist()
        ends = (behind - behind[0]).tolist()
        return [kept[first:last] for first, last in pairwise(ends)]

    def first(self, i: int) -> int:
        """The number of the first sample of `samples(i)`, counted from 0."""
        return int(self._fronts["published"][i] - self.fresh[i])

    def checkpoint(self) -> dict[str, NDArray[Any]]:
        """What `resume` needs, by name; nothing here changes."""
        used = []
        for stream, noise, gaps, s in zip(self._streams, self._noise, self._gaps, self._fronts):
            drawn_numbers, drawn_gaps = stream.drawn
            used.append((drawn_numbers - len(noise) + s["drawn"], drawn_gaps - len(gaps) + s["gap"]))
        return {
            "fronts": self._fronts.copy().view(np.uint8).reshape(-1, INSTRUMENT.itemsize),
            "poles": self._poles.copy(),
            "waiting": self.loan.content.queue.copy(),
            "past": self._past.copy(),
            "used": np.array(used, dtype=np.int64).reshape(-1, 2),
        }

    def keep(self) -> dict[str, NDArray[Any]]:
        """What `back` needs, by name: the `checkpoint`, and the samples that are stored; nothing here changes."""
        stored = self._samples[:, : int(self._fronts["kept"].max(initial=0))].copy()
        return {**self.checkpoint(), "latest": self.latest.copy(), "fresh": self.fresh.copy(), "stored": stored}

    def back(self, kept: Mapping[str, NDArray[Any]]) -> None:
        """Store the samples of `keep` again; `resume` does the rest."""
        fronts = kept["fronts"].copy().view(INSTRUMENT).reshape(-1)
        stored = kept["stored"]
        self._samples[:, : stored.shape[1]] = stored
        self.latest[:] = kept["latest"]
        self.fresh[:] = kept["fresh"]
        self._fronts["published"] = fronts["published"]
        self._fronts["kept"] = fronts["kept"]

    def play(self, recorded: Sequence[tuple[Integers, NDArray[np.float64]]], t_ns: int) -> None:
        """Publish samples of a recording (times, values of each instrument) up to `t_ns` instead of measuring.

        Until `resume` the instruments have no state. At most `playable` frames at a time.
        """
        self._forget()
        for i, (instants, (_, values)) in enumerate(zip(self.instants, recorded)):
            s = self._fronts[i]
            before, last = instants.until(np.array([t_ns - self._frame, t_ns])).tolist()
            new = values[s["published"] : last]
            self._samples[i, s["kept"] : s["kept"] + len(new)] = new
            s["kept"] += len(new)
            s["published"] = last
            self.fresh[i] = last - before
            if len(new):
                self.latest[i] = new[-1]

    @property
    def playable(self) -> int:
        """Number of frames that `play` can take at once."""
        return min(((self._samples.shape[1] - 1) // most for most in self._most), default=CHUNK)

    def resume(self, saved: Mapping[str, NDArray[Any]], t_ns: int) -> None:
        """Continue from the `checkpoint` of a bank of the same instruments, at `t_ns`, up to which `play` has played.

        Raises ValueError for a checkpoint of other instruments.
        """
        fronts = saved["fronts"].copy().view(INSTRUMENT).reshape(-1)
        if (fronts["published"] != self._fronts["published"]).any():
            raise ValueError("other numbers of samples were published")
        fronts["kept"] = self._fronts["kept"]
        self._fronts[:] = fronts
        for array, name in ((self._poles, "poles"), (self.loan.content.queue, "waiting"), (self._past, "past")):
            if saved[name].shape != array.shape:
                raise ValueError(f"{name} has the shape {saved[name].shape}, not {array.shape}")
            array[:] = saved[name]
        self._clock["now"] = t_ns
        self._streams = [Stream(self.seed, name) for name in self.names]
        for stream, end, (numbers, gaps) in zip(self._streams, self._ends, saved["used"].tolist()):
            if end.noise > 0.0:
                stream.skip(numbers)
            if end.dropout_rate > 0.0:
                stream.gaps(gaps, end.dropout_rate, end.dropout_shortest, end.dropout_longest)
        self._draw(everything=True)

    def counters(self) -> dict[str, dict[str, int]]:
        """Numbers of samples of each instrument that were clipped, dropped out or lost to the slew limit so far."""
        counters = {}
        for name, front in zip(self.names, self._fronts):
            counters[name] = {key: int(front[key]) for key in ("clipped", "dropped_out", "slew_lost")}
        return counters

    def _settle(self, i: int, row: int, end: FrontEnd, y: float, before: int) -> int:
        """Set instrument i to rest at the input y, `before` [ns] ahead of t = 0; returns the next free row of poles."""
        s = self._fronts[i]
        self._fronts[i] = np.zeros((), dtype=INSTRUMENT)
        s["column"] = self._columns.index(self._sections[i].reads)
        s["period"], s["rest"] = end.instants.whole
        s["samples"] = end.instants.samples
        s["cycle"] = SECOND * end.instants.seconds
        s["mean"] = end.period_ns
        s["delay"] = end.delay_ns
        s["most"] = self._most[i]
        for key in ("averages", "holds", "direct", "gain", "offset", "slope", "warmth", "fade", "rise", "noise"):
            s[key] = getattr(end, key)
        if self._sections[i].given:
            s["gain"] = 0.0
        s["low"] = end.low
        s["high"] = end.high
        s["resolution"] = end.resolution
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
        s["echo"] = before_it
        s["silence"] = before_it + len(end.echoes)
        self._past[i] = end.gain * at_rest
        s["followed"] = s["previous"] = end.gain * at_rest * (1.0 + sum(share for share, _ in end.echoes))
        return row

    def fill(self, everything: bool = False) -> None:
        """Replace used random numbers by new ones; if it is `full`, drop samples except the last of each instrument."""
        if self.full:
            self._forget()
        self._draw(everything)

    def _forget(self) -> None:
        """Drop all samples but the last of each instrument."""
        for i, s in enumerate(self._fronts):
            if s["kept"] > 1:
                self._samples[i, 0] = self._samples[i, s["kept"] - 1]
                s["kept"] = 1

    def _draw(self, everything: bool) -> None:
        """Replace used random numbers, or all of them, by new ones."""
        self._clock["short"] = 0
        for i, (end, stream) in enumerate(zip(self._ends, self._streams)):
            s = self._fronts[i]
            if end.noise > 0.0:
                used = self._noise.shape[1] if everything else int(s["drawn"])
                left = self._noise.shape[1] - used
                self._noise[i, :left] = self._noise[i, used:].copy()
                stream.noise(self._noise[i, left:])
                s["drawn"] = 0
            if end.dropout_rate > 0.0:
                used = self._gaps.shape[1] if everything else int(s["gap"])
                left = self._gaps.shape[1] - used
                self._gaps[i, :left] = self._gaps[i, used:].copy()
                self._gaps[i, left:] = stream.gaps(used, end.dropout_rate, end.dropout_shortest, end.dropout_longest)
                s["gap"] = 0
