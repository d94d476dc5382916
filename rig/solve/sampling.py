"""The kernel that runs every instrument, over one frame or several.

Instrument after instrument runs over all frames that have been gathered: this takes two thirds of the time that frame
after frame takes, and the results are the same.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compiled.kernel import fused, inner, kernel
from rig.solve.expm import PART, PEEK, RESIDUE, STATE, STEP, degree_of, pole_weights, polynomial, state_after

# One instrument: its properties, then its state. Sample n is published at `sample_instant` n and taken `delay` earlier.
INSTRUMENT = np.dtype(
    [
        ("column", np.int64),  # of the output in Segments
        ("period", np.int64),  # whole ns between two samples, plus
        ("rest", np.int64),  # this many parts of a nanosecond, of which
        ("samples", np.int64),  # make one; after this many samples the pattern repeats,
        ("cycle", np.int64),  # this many ns later
        ("mean", np.float64),  # ns, the exact period
        ("delay", np.int64),  # ns
        ("first", np.int64),  # its poles are rows first .. last - 1 of `poles`
        ("last", np.int64),
        ("echo", np.int64),  # its echoes are rows echo .. silence - 1 of `echoes`
        ("silence", np.int64),
        ("averages", np.int64),
        ("holds", np.int64),
        ("direct", np.float64),
        ("gain", np.float64),
        ("offset", np.float64),
        ("slope", np.float64),
        ("warmth", np.float64),
        ("fade", np.float64),
        ("rise", np.float64),
        ("noise", np.float64),
        ("low", np.float64),
        ("high", np.float64),
        ("resolution", np.float64),
        ("slew", np.float64),  # largest change per sample
        ("dropouts", np.int64),
        ("most", np.int64),  # largest number of samples in one frame
        ("taken", np.int64),  # samples so far
        ("published", np.int64),
        ("kept", np.int64),  # number of the latest samples kept in its row of `samples`
        ("drawn", np.int64),  # next number in its row of `noise`
        ("gap", np.int64),  # next drop-out
        ("lost_until", np.int64),  # ns
        ("followed", np.float64),  # output of the slew limit
        ("previous", np.float64),  # last sample taken
        ("part", np.float64),  # s, length that the weights at PART belong to
        ("peek", np.float64),  # s, length that the weights at PEEK belong to
        ("clipped", np.int64),
        ("dropped_out", np.int64),
        ("slew_lost", np.int64),
    ],
    align=True,
)


GATHERED = 16
"""Most frames that the instruments run over at once."""
CLOCK = np.dtype(
    [
        ("now", np.int64),  # ns
        ("short", np.int64),  # 1: random numbers or room are short for GATHERED frames
        ("waiting", np.int64),  # number of frames that are gathered
    ],
    align=True,
)


class InstrumentTables(NamedTuple):
    """All instruments of a scene as arrays."""

    instruments: NDArray[Any]  # INSTRUMENT [n]
    poles: NDArray[np.complex128]  # [pole, COLUMNS]
    latest: NDArray[np.float64]  # [n] the last published sample
    fresh: NDArray[np.int64]  # [n] number of samples published in the last frame
    queue: NDArray[np.float64]  # [n, waiting] samples taken but not yet published
    samples: NDArray[np.float64]  # [n, room] the latest INSTRUMENT.kept published samples
    noise: NDArray[np.float64]  # [n, drawn ahead]
    gaps: NDArray[np.int64]  # [n, drawn ahead, 2] start and end of drop-outs [ns]
    past: NDArray[np.float64]  # [n, longest echo] filtered output at the last samples, for instruments with echoes
    echoes: NDArray[np.float64]  # [echo, 2] delay in samples, share
    clock: NDArray[Any]  # CLOCK [1]
    begins: NDArray[np.int64]  # [GATHERED + 1] first segment of each gathered frame, and the end of the last
    frame: int  # ns
    step: float  # s, length of a full segment


@fused
def sample_instant(s: Any, k: int) -> int:
    """The instant at which sample k of instrument s is published [ns]: k periods, rounded half to even."""
    return k * s.period if s.rest == 0 else uneven_instant(s, k)  # type: ignore[no-any-return]


@inner
def uneven_instant(s: Any, k: int) -> int:
    """The same for a period that is not a whole number of nanoseconds."""
    cycles = k // s.samples
    k -= cycles * s.samples
    more = k * s.rest // s.samples
    part = k * s.rest - more * s.samples
    t = k * s.period + more
    if 2 * part > s.samples or (2 * part == s.samples and t % 2 == 1):
        t += 1
    return cycles * s.cycle + t  # type: ignore[no-any-return]


@fused
def period_share(s: Any) -> float:
    """The period over the time since the last sample: corrects a mean that was taken over an uneven interval."""
    share = 1.0
    if s.rest != 0 and s.taken != 0:
        share = s.mean / (uneven_instant(s, s.taken) - uneven_instant(s, s.taken - 1))
    return share


@fused
def take_sample(s: Any, x: float, t: int, r: Any, i: int) -> float:
    """The sample that instrument s (row i) makes of the filtered output x at t [ns]; counts faults."""
    noise, gaps, past = r.noise, r.gaps, r.past
    x *= s.gain
    if s.echo < s.silence:
        past[i, s.taken % past.shape[1]] = x
        for e in range(s.echo, s.silence):
            x += r.echoes[e, 1] * past[i, (s.taken - int(r.echoes[e, 0])) % past.shape[1]]
    change = x - s.followed
    if change > s.slew:
        x = s.followed + s.slew
        s.slew_lost += 1
    elif change < -s.slew:
        x = s.followed - s.slew
        s.slew_lost += 1
    s.followed = x
    y = x + s.offset
    seconds = max(t, 0) * 1e-9
    y += s.slope * seconds
    if s.warmth != 0.0:
        left = np.exp(-s.fade * seconds) if s.fade != 0.0 else 1.0
        y += s.warmth * (left - np.exp(-s.rise * seconds))
    if s.noise > 0.0:
        y += s.noise * noise[i, s.drawn]
        s.drawn += 1
    if y > s.high:
        y = s.high
        s.clipped += 1
    elif y < s.low:
        y = s.low
        s.clipped += 1
    if s.resolution > 0.0:
        y = np.rint(y / s.resolution) * s.resolution
    if s.dropouts:
        while s.gap < gaps.shape[1] and gaps[i, s.gap, 0] <= t:
            s.lost_until = max(s.lost_until, gaps[i, s.gap, 1])
            s.gap += 1
        if t < s.lost_until:
            y = s.previous if s.holds else 0.0
            s.dropped_out += 1
    s.previous = y
    s.taken += 1
    return y  # type: ignore[no-any-return]


@kernel
def prepare_poles(tables: Any) -> None:
    """Compute the weights of all poles for a full segment."""
    for p in range(tables.poles.shape[0]):
        pole_weights(tables.poles, p, STEP, tables.step)


@kernel
def advance_instruments(tables: Any, segments: Any) -> None:
    """Run `run_instruments` on its own: one frame of all instruments."""
    tables.begins[0] = 0
    gather_frame(tables, segments)
    run_instruments(tables, segments)


@inner
def gather_frame(r: Any, segments: Any) -> None:
    """Note that `segments` describes another frame, which ends with its last segment."""
    clock = r.clock[0]
    clock.waiting += 1
    r.begins[clock.waiting] = segments.count[0]


@inner
def run_instruments(r: Any, segments: Any) -> None:
    """Run all instruments over the frames that are gathered; each is (now, now + frame] [ns].

    Segments of a frame that has not ended stay.
    """
    clock = r.clock[0]
    frame, step, frames, begins = r.frame, r.step, clock.waiting, r.begins
    start, length, coef = segments.start, segments.length, segments.coef
    instruments, poles, queue, room = r.instruments, r.poles, r.queue, r.queue.shape[1]
    snap = 1e-12 * (1e-9 * frame)  # a sample this close to the end of a segment is taken at its end
    same = 4e-15 * (1e-9 * frame)  # lengths this close differ by the rounding of start and length only
    short, finish = False, clock.now + frames * frame
    for i in range(instruments.shape[0]):
        s = instruments[i]
        column, delay, first, behind = s.column, s.delay, s.first, s.last
        due = sample_instant(s, s.taken) - delay
        now, f, tau = clock.now - frame, -1, 0.0
        place, number, kept, fresh = s.taken % room, s.published, s.kept, s.published
        for j in range(begins[0], begins[frames]):
            if j == begins[f + 1]:
                now += frame
                f += 1
                tau = 1e-9 * (due - now)
            end_ns, ends = now + frame, j == begins[f + 1] - 1
            h = length[j]
            end = start[j] + h
            base = 0.0  # for a running mean: the integral at the last sample
            if tau < end - snap and due <= end_ns:
                base = take_samples_inside(r, segments, i, j, now)
                place = s.taken % room
                due = sample_instant(s, s.taken) - delay
                tau = 1e-9 * (due - now)
            at = STEP
            if abs(h - step) > same:
                at = PART
                if abs(h - s.part) > same:
                    s.part = h
                    for p in range(first, behind):
                        pole_weights(poles, p, PART, h)
            x = -base
            degree = degree_of(coef, j, column)
            for p in range(first, behind):
                z = state_after(poles, p, at, coef, j, column, degree, 1.0)
                x += (poles[p, RESIDUE] * z).real
                poles[p, STATE] = z
                if abs(z.real) + abs(z.imag) < 1e-250:  # denormal numbers would cost 100 times as much
                    poles[p, STATE] = 0j
            if due <= end_ns and (tau <= end + snap or ends):  # a sample at the end of the segment
                base = x + base
                if s.averages:
                    x *= period_share(s)
                if s.direct != 0.0:
                    x += s.direct * polynomial(coef, j, column, 1.0)
                queue[i, place] = take_sample(s, x, due, r, i)
                place = place + 1 if place + 1 < room else 0
                due = sample_instant(s, s.taken) - delay
                tau = 1e-9 * (due - now)
            if s.averages:
                poles[first, STATE] -= base / poles[first, RESIDUE].real
            if ends:
                fresh, at = number, place - (s.taken - number)
                if at < 0:
                    at += room
                while sample_instant(s, number) <= end_ns:
                    r.latest[i] = r.samples[i, kept] = queue[i, at]
                    at = at + 1 if at + 1 < room else 0
                    number += 1
                    kept += 1
        r.fresh[i] = number - fresh
        s.published, s.kept = number, kept
        most = GATHERED * s.most
        if s.noise > 0.0 and s.drawn + most > r.noise.shape[1]:
            short = True
        if s.dropouts and r.gaps[i, r.gaps.shape[1] - 1, 0] <= finish + GATHERED * frame:
            short = True
        if kept + most > r.samples.shape[1]:
            short = True
    begins[0] = begins[frames]
    clock.now, clock.short, clock.waiting = finish, int(short), 0


@inner
def take_samples_inside(r: Any, segments: Any, i: int, j: int, now: int) -> float:
    """Take the samples of instrument i that are due inside segment j, in the frame that begins at `now` [ns].

    Returns the integral of a running mean at the last of them.
    """
    s, poles, coef = r.instruments[i], r.poles, segments.coef
    begin, h, column = segments.start[j], segments.length[j], s.column
    end = begin + h - 1e-12 * (1e-9 * r.frame)
    same = 4e-15 * (1e-9 * r.frame)
    base, degree = 0.0, degree_of(coef, j, column)
    due = sample_instant(s, s.taken) - s.delay
    while 1e-9 * (due - now) < end and due <= now + r.frame:
        part = 1e-9 * (due - now) - begin
        if abs(part - s.peek) > same:
            s.peek = part
            for p in range(s.first, s.last):
                pole_weights(poles, p, PEEK, part)
        x = 0.0
        for p in range(s.first, s.last):
            x += (poles[p, RESIDUE] * state_after(poles, p, PEEK, coef, j, column, degree, part / h)).real
        if s.averages:
            x, base = (x - base) * period_share(s), x
        if s.direct != 0.0:
            x += s.direct * polynomial(coef, j, column, part / h)
        place = s.taken % r.queue.shape[1]
        r.queue[i, place] = take_sample(s, x, due, r, i)
        due = sample_instant(s, s.taken) - s.delay
    return base
