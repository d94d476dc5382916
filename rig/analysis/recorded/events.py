"""Vibration events of a channel: when a tone rises out of the noise, how fast it grows, at which speed and load.

A window moves over the channel. The noise of a line of its spectrum is that of the quietest fifth of the windows, in
the middle of the lines around it. A line with a noise of its own, such as a resonance, keeps that. An event begins with
a power that noise reaches once in a hundred recordings, and lasts while the tone stands 5 dB out of the noise. What a
tone spreads over other lines, and tones at multiples of its frequency, belong to it.

The growth rate, and the rate of the decay, are those of rig.analysis.recorded.growth.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.analysis.recorded.growth import grown, mixed
from rig.analysis.recorded.series import Series, drive, known, of_spans, scene_name, series, spans, vibration
from rig.errors import SceneError, Untrusted, UsageError
from rig.printable import counted
from rig.record.run import Reals, Run
from rig.record.run_data import MEASURED, TRUE
from rig.results import Column, Result, Table
from rig.units import same_unit

if TYPE_CHECKING:
    from rig.analysis.linear.sweep import Sweep
    from rig.scenes.scene import Scene

Floats = NDArray[np.float32]
_QUIET = 0.2  # share of the windows that count as quiet
_LINES = 25  # lines around one whose middle is its noise
_ONCE = 0.01  # times that noise begins an event in a recording
_LOW = 10.0**0.5  # power over the noise below which an event ends: 5 dB
_DEPTH = 1e-7  # of the largest power: less is not examined
_WINDOW = 0.040  # s, at least
_PERIODS = 8.0  # of the strongest tone in a window
_STEPS = 4  # in the length of a window
_LOWEST = 3  # line of the lowest tone
_REACH = 2  # lines by which a tone may move in a step
_BRIDGE = 3  # steps without a tone that do not end its event
_CHUNK = 1 << 22  # samples transformed at once
_POINTS = 41  # of the eigenvalues over speed or load
_HARMONICS = 6  # highest order of a stronger harmonic
_HIDDEN = 1e-4  # power over that of a stronger tone: less beside it is hidden
_JITTER = 2e-3  # of the frequency: how exactly those of harmonics are known; five times as much for weak ones
_THIRD = 2.0 ** (1.0 / 6.0) - 2.0 ** (-1.0 / 6.0)  # of the frequency: width of a third of an octave
# Units of a condition, and words one of which is in the name of its channel
_SPEEDS = (("m/s", "rad/s", "Hz"), ("speed", "rpm", "drive"))
_LOADS = (("N", "Pa"), ("load", "normal", "preload", "pressure"))
_TEMPERATURES = (("K", "degC"), ("",))
_THROUGHOUT = "a tone without quiet time before and after it is compared with the lines beside it"


class Event(NamedTuple):
    """From `begin` to `end` [s]: frequency [Hz], RMS in the unit of the channel, level over the noise [dB].

    The level compares with the noise in a third of an octave. `growth` [1/s] with its interval of 90 %, `low` to
    `high`, the frequency during the growth `growing` [Hz], and `decay` [1/s] at the end; NaN where the recording does
    not contain them. `cut`: "begin", "end" or "both" if the event goes on there beyond the recording or into a gap.
    `harmonics`: number of tones at multiples of the frequency. `at`: means of other channels from the begin to the end
    of the growth, by name.
    """

    begin: float
    end: float
    frequency: float
    rms: float
    level: float
    growth: float
    low: float
    high: float
    growing: float
    decay: float
    cut: str
    harmonics: int
    at: dict[str, float]

    @property
    def linear(self) -> float:
        """The frequency to compare with that of an eigenvalue [Hz]: that during the growth, if it is known."""
        return self.growing if math.isfinite(self.growing) else self.frequency


@dataclass(frozen=True)
class Events(Result):
    """The result of `events`. `window` [s]; `lowest`: lowest frequency of a tone [Hz]; `others`: name -> unit of the
    channels of `Event.at`. `times` [window], `frequencies` [line], `spectrum` [window, line]: dB over the noise.
    """

    FIGURE: ClassVar = "rig.analysis.recorded.figures:events_figure"

    scene: str
    name: str
    unit: str
    events: tuple[Event, ...]
    window: float
    lowest: float
    others: dict[str, str]
    times: Reals
    frequencies: Reals
    spectrum: Floats
    notes: str = ""
    sweep: Sweep | None = None
    """Eigenvalues of a scene over a key whose values are the channel `beside`."""
    beside: str = ""

    def shown(self) -> Iterator[str | Table]:
        """Yield the settings and the events."""
        head = f"{self.scene}: {counted(len(self.events), 'event')} of {self.name} [{self.unit}]"
        yield f"{head}; tones above {self.lowest:.4g} Hz, windows of {1e3 * self.window:.4g} ms"
        yield from [f"  {self.notes}"] if self.notes else []
        if not self.events:
            yield "  no tone rises out of the noise"
            return
        yield "  level: over the noise; low, high: growth with 90 %; cut: goes on beyond an end or a gap"
        columns = (
            Column("begin", "s", ".4f"),
            Column("end", "s", ".4f"),
            Column("frequency", "Hz", ".2f"),
            Column("rms", self.unit, ".4g"),
            Column("level", "dB", ".1f"),
            Column("growth", "1/s", ".4g"),
            Column("low", "1/s", ".4g"),
            Column("high", "1/s", ".4g"),
            Column("growing", "Hz", ".6g"),
            Column("decay", "1/s", ".4g"),
            Column("cut"),
            Column("harmonics", digits=".0f"),
            *(Column(name, unit, ".4g") for name, unit in self.others.items()),
            *((Column("scene frequency", "Hz", ".4g"), Column("scene growth", "1/s", ".4g")) if self.sweep else ()),
        )
        yield Table("events", columns, [*map(self._row, self.events)])

    def _row(self, event: Event) -> tuple[Any, ...]:
        """An event in the columns of the report."""
        return (*event[:-1], *event.at.values(), *(self.eigenvalue(event) if self.sweep else ()))

    def over(self, scene: Scene, key: str = "drive.speed") -> Events:
        """Return the events with the eigenvalues of a scene over `key`, whose values are a channel of `Event.at`.

        Raises UsageError without a channel in the unit of the key, SceneError for a key that the scene does not have.
        """
        from rig.analysis.linear.sweep import sweep
        from rig.scenes.axis import Axis, numbers, unknown

        keys = numbers(scene, ())
        if key not in keys:
            raise SceneError(scene.name, [unknown(key, keys, scene)])
        beside = next((name for name, unit in self.others.items() if same_unit(unit, keys[key])), None)
        if beside is None:
            told = ", ".join(f"{name} [{unit}]" for name, unit in self.others.items()) or "none"
            raise UsageError(
                f"{key} [{keys[key]}]: no channel beside the events has this unit ({told}); name it (--at)"
            )
        values = [*filter(math.isfinite, (event.at[beside] for event in self.events))]
        if not values:
            raise UsageError(f"{self.name}: no event, so that there is nothing to compare with {scene.name}")
        low = min(values)
        high = max(values)
        margin = max(0.25 * (high - low), 0.2 * max(abs(low), abs(high)))
        low = max(low - margin, 0.1 * low) if low > 0.0 else low - margin
        axis = Axis.of(key, np.linspace(low, high + margin, _POINTS), scene)
        return replace(self, sweep=sweep(scene, axis), beside=beside)

    def eigenvalue(self, event: Event) -> tuple[float, float]:
        """Frequency [Hz] and growth [1/s] of the scene at an event, of the mode next in frequency; NaN without."""
        if self.sweep is None:
            return math.nan, math.nan
        x = event.at[self.beside]
        if not math.isfinite(x):
            return math.nan, math.nan
        values = np.array(self.sweep.axis.values)
        modes = [
            (float(np.interp(x, values, f)), float(np.interp(x, values, growth)))
            for f, growth in zip(self.sweep.frequency.T, self.sweep.growth.T)
        ]
        known = [mode for mode in modes if math.isfinite(mode[0] + mode[1])]
        return min(known, key=lambda mode: abs(mode[0] - event.linear), default=(math.nan, math.nan))

    def facts(self) -> dict[str, Any]:
        """Return the settings, the events, and the eigenvalues of the scene."""
        return {
            "scene": self.scene,
            "channel": self.name,
            "unit": self.unit,
            "window": self.window,
            "lowest": self.lowest,
            "notes": self.notes,
            "events": [event._asdict() for event in self.events],
            "over": self.sweep and self.sweep.to_json(),
        }


class _Track(NamedTuple):
    """A tone in the windows `first` to `last`, strongest in `line`; `path`: window and line of each step."""

    first: int
    last: int
    line: int
    path: tuple[tuple[int, int], ...]


class _Tone(NamedTuple):
    """A track with `begin` and `end` [s], frequency [Hz], mean square, and density of the noise beside it.

    `course` [2, n]: times and the frequency then.
    """

    track: _Track
    begin: float
    end: float
    frequency: float
    square: float
    density: float
    cut: str
    course: Reals

    def between(self, begin: float, end: float) -> float:
        """The median frequency from `begin` to `end` [s]."""
        t, f = self.course
        f = f[(t >= begin) & (t <= end)]
        return float(np.nanmedian(f)) if np.isfinite(f).any() else self.frequency


def events(
    run: Run,
    name: str = "",
    at: Sequence[str] | None = None,
    window: float = 0.0,
    first: float = 0.0,
    last: float = math.inf,
    over: Scene | None = None,
    key: str = "",
) -> Events:
    """Find the vibration events of a channel from `first` to `last` [s].

    `name`: the channel; default: a sensor that measures vibration. `at`: channels whose means during the growth are
    told; default: speed of the drive, load and temperature, as far as the recording has them. `window`: length of the
    windows [s]; default: 40 ms, or eight periods of the strongest tone. `over`: a scene whose eigenvalues over `key`
    (drive.speed) are compared with the events (`Events.over`). Raises UsageError, and SceneError for the key.
    """
    if key and over is None:
        raise UsageError(f"key {key}: name the scene whose eigenvalues are compared with the events (--over SCENE)")
    name = name or vibration(run)
    limits = spans(run, name, first, last)
    named = conditions(run, name.removeprefix(MEASURED).removeprefix(TRUE)) if at is None else at
    if len(limits) == 1:
        result = _of_stretch(run, name, named, window, first, last)
    else:
        result = _joined(run, name, named, window, limits)
    return result if over is None else result.over(over, key or "drive.speed")


def _joined(run: Run, name: str, named: Sequence[str], window: float, limits: Sequence[tuple[float, float]]) -> Events:
    """The events of stretches that lie far apart, with the windows of the longest one. Raises UsageError."""
    parts = of_spans(run, name, limits)
    longest = max(parts, key=lambda part: part.v.size)
    whole = _of_stretch(run, name, named, window, *_within(longest, limits))
    results = list[Events]()
    notes = [f"{len(parts)} stretches, each with its own noise"]
    for part in parts:
        told = f"{part.start:.9g} to {part.start + part.seconds:.9g} s"
        try:
            result = whole if part is longest else _of_stretch(run, name, named, whole.window, *_within(part, limits))
        except UsageError as fault:
            notes.append(f"{told} is left out: {fault}")
            continue
        if result.frequencies.size != whole.frequencies.size:
            notes.append(f"{told} is left out: it is sampled at {part.rate:.6g} Hz, not at {longest.rate:.6g} Hz")
            continue
        results.append(result)
        notes.append(f"{told}: {counted(len(result.events), 'event')}{f' ({result.notes})' if result.notes else ''}")
    empty = np.full((1, whole.frequencies.size), np.nan, np.float32)
    step = 0.5 * whole.window
    times = [np.concatenate(([r.times[0] - step], r.times, [r.times[-1] + step])) for r in results]
    return replace(
        whole,
        events=tuple(event for result in results for event in result.events),
        times=np.concatenate(times),
        spectrum=np.concatenate([level for result in results for level in (empty, result.spectrum, empty)]),
        notes="; ".join(notes),
    )


def _within(part: Series, limits: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """The limits that a stretch lies within [s]."""
    return next((begin, end) for begin, end in limits if begin <= part.start <= end)


def _of_stretch(run: Run, name: str, named: Sequence[str], window: float, first: float, last: float) -> Events:
    """The events of a channel from `first` to `last` [s], with the means of the channels `named`."""
    channel = series(run, name, first, last)
    beside = [series(run, other, first, last) for other in named]
    others = {other.name: other for other in beside}
    if channel.v.size < 8 * 16:
        raise UsageError(
            f"{channel.name}: {counted(channel.v.size, 'sample')} at {channel.rate:g} Hz are too few for eight windows "
            "of 16 samples each; give a longer time span, or a channel with a higher rate"
        )
    v = channel.v - np.nanmean(channel.v)
    strongest = _strongest(v, channel.rate)
    seconds = window or max(_WINDOW, min(_PERIODS / strongest, v.size / channel.rate / 12.0))
    length = round(seconds * channel.rate)
    if length < 16 or v.size < 8 * length:
        raise UsageError(
            f"{channel.name}: {counted(v.size, 'sample')} at {channel.rate:g} Hz are too few for windows of "
            f"{length / channel.rate:.3g} s, of which eight are needed with 16 samples each; give another --window, a "
            "longer time span, or a channel with a higher rate"
        )
    hop = max(length // _STEPS, 1)
    power = _spectra(v, channel.rate, length, hop)
    heard = np.isfinite(power[:, 0])
    if heard.sum() < 8:
        raise UsageError(
            f"{channel.name}: {channel.notes()}; fewer than eight windows of {length / channel.rate:.3g} s are "
            "complete; give a shorter --window"
        )
    middles = 0.5 * length + hop * np.arange(len(power))
    times = np.asarray(channel.start + middles / channel.rate, np.float64)
    frequencies = np.arange(power.shape[1], dtype=np.float64) * (channel.rate / length)
    floor = np.maximum(_floor(power[heard]), np.finfo(np.float32).tiny)  # 0 of a constant channel
    shown = 10.0 * np.log10(np.maximum(power / floor, 1e-3)).astype(np.float32)
    search = _Search(channel, v, times, frequencies, floor, length / channel.rate)
    tones = [tone for tone in map(search.tone, _tracks(power, floor)) if tone is not None]
    heard_events = [search.event(tone, count, tones, others) for tone, count in _families(tones, channel.rate)]
    heard_events.sort(key=lambda event: event.begin)
    units = {key: other.unit for key, other in others.items()}
    lowest = float(frequencies[_LOWEST])
    notes = [channel.notes()]
    if strongest < lowest:
        needed = f"windows of {_PERIODS / strongest:.3g} s, and ten times this in all"
        notes.append(f"{strongest:.3g} Hz is stronger, but needs {needed}")
    if any(event.cut == "both" for event in heard_events):
        notes.append(_THROUGHOUT)
    return Events(
        scene_name(run),
        channel.name,
        channel.unit,
        tuple(heard_events),
        search.window,
        lowest,
        units,
        times,
        frequencies,
        shown,
        "; ".join(filter(None, notes)),
    )


def conditions(run: Run, name: str = "") -> list[str]:
    """Return the channels of speed of the drive, load and temperature of a recording, as far as it has them."""
    chosen = list[str]()
    units = known(run)
    try:
        chosen.append(drive(run))
    except (UsageError, Untrusted):
        pass

    def fitting(kinds: tuple[str, ...], words: tuple[str, ...]) -> list[str]:
        """The first channel in one of these units with one of these words in its name."""
        for other, unit in units.items():
            if unit in kinds and other != name and any(word in other.lower() for word in words):
                return [other]
        return []

    if not chosen:
        chosen += fitting(*_SPEEDS)
    return [*chosen, *fitting(*_LOADS), *fitting(*_TEMPERATURES)]


def _strongest(v: Reals, rate: float) -> float:
    """The frequency of the strongest tone [Hz]."""
    from scipy.signal import welch

    f, density = welch(np.nan_to_num(v), rate, nperseg=min(v.size // 2, 1 << 14))
    power = f * density  # of bands of equal ratio
    return float(f[_LOWEST + int(np.argmax(power[_LOWEST:]))])


def _spectra(v: Reals, rate: float, length: int, hop: int) -> Floats:
    """Power density [window, line] of windows of that length; NaN where samples are missing."""
    frames = np.lib.stride_tricks.sliding_window_view(v, length)[::hop]
    weights = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)
    scale = 2.0 / (rate * float(weights @ weights))
    power = np.empty((len(frames), length // 2 + 1), np.float32)
    rows = max(_CHUNK // length, 1)
    for a in range(0, len(frames), rows):
        spectra = np.abs(np.fft.rfft(frames[a : a + rows] * weights)) ** 2
        power[a : a + rows] = spectra * scale
    return power


def _floor(power: Floats) -> Reals:
    """Density of the noise in each line."""
    from scipy.ndimage import median_filter

    low = np.quantile(power, _QUIET, axis=0) / -math.log(1.0 - _QUIET)  # of an exponential distribution
    low = np.maximum(low, _DEPTH * float(power.max()))
    floor = np.asarray(median_filter(low, min(_LINES, low.size), mode="nearest"), np.float64)
    if len(power) >= 5 * _STEPS:  # the line's own noise: it jumps from window to window, a tone does not
        quiet = np.log(np.maximum(power, np.finfo(np.float32).tiny))
        bends = np.abs(quiet[: -2 * _STEPS] - 2.0 * quiet[_STEPS:-_STEPS] + quiet[2 * _STEPS :])
        calm = power[_STEPS:-_STEPS] <= np.median(power, axis=0)
        noisy = np.nanmedian(np.where(calm, bends, np.nan), axis=0) > 1.0
        of_line = np.quantile(power, 0.05, axis=0) / -math.log(0.95)
        floor = np.where(noisy, np.maximum(floor, of_line), floor)
    return floor


def _tracks(power: Floats, floor: Reals) -> Iterator[_Track]:
    """The tones that stand out, the strongest first."""
    over = np.nan_to_num(power / floor)
    over[:, :_LOWEST] = 0.0
    over[:, 1 - _STEPS :] = 0.0
    limit = math.log(max(over.size, 2) / _ONCE)
    rows, lines = np.nonzero(over > limit)
    order = np.argsort(-power[rows, lines], kind="stable")
    free = np.ones(over.shape, bool)
    missing = ~np.isfinite(power[:, 0])
    every = np.arange(over.shape[1])
    for k, line in zip(rows[order], lines[order]):
        if not free[k, line]:
            continue
        path = [(int(k), int(line))]
        ends = []
        for way in (-1, 1):
            where = int(k)
            place = int(line)
            missed = 0
            last = int(k)
            while 0 <= where + way < len(over) and missed <= _BRIDGE:
                where += way
                if missing[where]:
                    continue
                near = slice(max(place - _REACH, 0), place + _REACH + 1)
                best = near.start + int(np.argmax(np.where(free[where, near], over[where, near], 0.0)))
                if free[where, best] and over[where, best] > _LOW:
                    place = best
                    missed = 0
                    last = where
                    path.append((where, best))
                else:
                    missed += 1
            ends.append(last)
        path.sort()
        for where, place in path:  # what the tone spreads over the lines where it begins or ends within a window
            near = slice(max(where - _STEPS, 0), where + _STEPS + 1)
            away = np.abs(every - place)
            spread = 4.0 * float(power[where, place]) / np.maximum(math.pi * away, 1.0) ** 2
            covered = (away <= 2 * _REACH + 1) | (power[near] < spread)
            free[near] &= ~covered
        yield _Track(ends[0], ends[1], int(line), tuple(path))


class _Search(NamedTuple):
    """What tones are measured in: the channel, its samples without their mean, windows, lines and their noise."""

    channel: Series
    v: Reals
    times: Reals
    frequencies: Reals
    floor: Reals
    window: float

    def part(self, a: float, b: float) -> tuple[Reals, float]:
        """The samples from `a` to `b` [s], and the time of the first one."""
        rate = self.channel.rate
        start = self.channel.start
        i, j = (min(max(round((t - start) * rate), 0), self.v.size) for t in (a, b))
        return self.v[i:j], start + i / rate

    def tone(self, track: _Track) -> _Tone | None:
        """The tone of a track; None if it is hardly longer than a sample of its amplitude."""
        f = float(self.frequencies[track.line])
        spacing = float(self.frequencies[1])
        near = slice(max(track.line - _LINES // 2, 1), track.line + _LINES // 2 + 1)
        density = float(np.median(self.floor[near]))
        a = self.times[track.first] - 0.5 * self.window
        b = self.times[track.last] + 0.5 * self.window
        part, begin = self.part(a - 2.0 * self.window, b + 2.0 * self.window)
        reach = 2 + max(abs(line - track.line) for _, line in track.path)
        half = max(min(reach * spacing, 0.6 * f, 0.5 * self.channel.rate - f), spacing)
        z, step, power = mixed(part, self.channel.rate, f, half)
        t = begin + step * np.arange(z.size)
        size = np.abs(z) ** 2
        noise = density * power
        on = np.flatnonzero((size > 4.0 * noise) & (t > a) & (t < b))
        if on.size < 2:
            return None
        inside = slice(on[0], on[-1] + 1)
        heard = z[inside]
        course = f + np.angle(heard[1:] * heard[:-1].conj()) / (2.0 * math.pi * step)
        square = max(0.5 * (float(np.nanmean(size[inside])) - noise), np.finfo(float).tiny)
        cut = self.cut(track)  # there the amplitude is not known to the end
        begin = max(a, self.channel.start) if cut in ("begin", "both") else float(t[on[0]])
        end = min(b, float(self.channel.t[-1])) if cut in ("end", "both") else float(t[on[-1]])
        over_time = np.array([t[inside][1:], course])
        return _Tone(track, begin, end, float(np.nanmedian(course)), square, density, cut, over_time)

    def event(self, tone: _Tone, harmonics: int, tones: list[_Tone], others: dict[str, Series]) -> Event:
        """The event of a tone."""
        f = tone.frequency
        begin = tone.begin
        end = tone.end
        rate = self.channel.rate
        meanwhile = [other for other in tones if other is not tone and other.begin <= end and other.end >= begin]
        aside = min((abs(other.frequency - f) for other in meanwhile), default=math.inf)
        half = max(min(0.6 * f, 0.5 * rate - f, 0.6 * aside), float(self.frequencies[1]))
        lead = 0.5 * (end - begin) + 4.0 * self.window
        near = [other for other in tones if abs(other.frequency - f) < 1.6 * half]
        before = max((other.end for other in near if other.end < begin), default=-math.inf)
        after = min((other.begin for other in near if other.begin > end), default=math.inf)
        first = max(begin - lead, 0.5 * (before + begin))
        last = min(end + lead, 0.5 * (end + after))
        part, start = self.part(first, last)
        seconds = part.size / rate
        growth = grown(part, rate, f, tone.density, begin - start, end - start, half)
        decay = grown(part[::-1], rate, f, tone.density, seconds - (end - start), seconds - (begin - start), half)
        until = max(start + growth.knee if growth else end, begin + 2.0 * self.window)
        means = {}
        for key, other in others.items():
            growing = other.v[(other.t >= begin) & (other.t <= until)]
            means[key] = float(np.nanmean(growing)) if np.isfinite(growing).any() else math.nan
        band = tone.density * min(_THIRD * f, 0.5 * rate)
        rise = (*growth[:3], f + growth.offset) if growth else (math.nan,) * 4
        level = 10.0 * math.log10(tone.square / band)
        return Event(
            begin,
            end,
            f,
            math.sqrt(tone.square),
            level,
            *rise,
            -decay.rate if decay else math.nan,
            tone.cut,
            harmonics,
            means,
        )

    def cut(self, track: _Track) -> str:
        """Which ends of a tone lie at an end of the recording or at a gap: "", "begin", "end", "both"."""
        rate = self.channel.rate

        def is_cut(window: int, way: int) -> bool:
            centre = (self.times[window] - self.channel.start) * rate
            beyond = round(centre + way * (0.5 + 1.0 / _STEPS) * self.window * rate) + way
            near = self.v[max(min(round(centre), beyond), 0) : max(round(centre), beyond)]
            return not 0 <= beyond <= self.v.size or not np.isfinite(near).all()

        begins = is_cut(track.first, -1)
        ends = is_cut(track.last, 1)
        if begins and ends:
            return "both"
        if begins:
            return "begin"
        return "end" if ends else ""


def _families(tones: list[_Tone], rate: float) -> Iterator[tuple[_Tone, int]]:
    """The tones without the harmonics of others, also those above half of the rate, and how many each has.

    Also left out are those beside a far stronger tone, which a rig that is not linear spreads over the spectrum.
    """
    tones = sorted(tones, key=lambda tone: tone.frequency)
    orders = np.arange(2, 4 * _HARMONICS)
    bases = dict[int, tuple[int, int]]()
    for i, tone in enumerate(tones):
        for k, base in enumerate(tones):
            begin = max(tone.begin, base.begin)
            end = min(tone.end, base.end)
            if k == i or k in bases or end - begin < 0.5 * (tone.end - tone.begin):
                continue
            f = base.between(begin, end)
            jitter = _JITTER * (5.0 if tone.square < 0.01 * base.square else 1.0)
            folded = np.abs((orders * f + 0.5 * rate) % rate - 0.5 * rate)
            away = np.abs(folded - tone.between(begin, end))
            near = away < orders * max(2.0 / (end - begin), jitter * f)
            near &= (orders <= _HARMONICS) | (tone.square < base.square)
            if near.any() and (tone.frequency > base.frequency or tone.square < 0.1 * base.square):
                bases[i] = k, int(orders[np.argmax(near)])
                break
            if tone.square < _HIDDEN * base.square:
                bases[i] = k, 1
                break
    for i, tone in enumerate(tones):
        if i not in bases:
            yield tone, len({order for k, order in bases.values() if k == i and order > 1})
