"""The outcome of a run of a case, and its test result: green, amber or red, and one reason."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rig.bench.live.pace import PAUSE
from rig.errors import Chatter, Diverged, Jammed, NumericsError, RigError, SceneError, UsageError
from rig.printable import counted
from rig.qualify.torture.case import Case

Array = NDArray[np.float64]
Colour = Literal["green", "amber", "red"]
Reason = Literal[
    "",
    "NaN",
    "energy",
    "creep",
    "chatter",
    "iteration cap",
    "missed event",
    "order lost",
    "refused",
    "overrun",
    "cost",
    "recording",
]
SMOOTH = 1e-9
"""Largest residual of the energy balance, relative to its largest term, without events,"""
WITH_EVENTS = 1e-6
"""with events,"""
WITH_FILM = 1e-2
"""and of a film of points."""
ROUND = 1e-9
"""Relative size below which forces, powers and the slip of a stuck contact count as rounding."""
LATE = 1e-3
"""Largest delay of an event, over the mean distance of events."""
_TOGETHER = 1e-9  # s: events that are simultaneous
_TINY = 1e-30  # least scale of a relative number, where everything is zero


class OutOfTime(Exception):
    """The cell has reached its time limit [s]."""

    def __init__(self, limit: float) -> None:
        super().__init__(f"exceeds its time limit of {limit:g} s")


FAULTS = (OutOfTime, RigError, ValueError)
"""What ends a cell without an outcome."""


@dataclass
class RunOutcome:
    """The outcome of a run. Events: (time [s], what). `stuck`: share of the ticks in which every contact sticks."""

    events: list[tuple[float, str]] = field(default_factory=list)
    count: int = 0
    ticks: int = 0
    stuck: float = 0.0
    stuck_now: bool = False
    negative_power: float = 0.0
    outside_cone: float = 0.0
    pulling: float = 0.0
    held: float = 0.0
    """Largest pull [N] of a contact that cannot open, in a scene without separation."""
    creep: float = 0.0
    not_finite: int = 0
    measurements: int = 0
    """Samples that the sensors published after the first."""
    energy: float = 0.0
    with_film: bool = False
    """The rig is a film of points: the residual of its energy balance falls with the square of the step."""
    burst: int = 0
    """Frames run without a wait after a pause."""
    ended: dict[str, float] = field(default_factory=dict)
    began: dict[str, float] = field(default_factory=dict)
    largest: dict[str, float] = field(default_factory=dict)
    trials: int = 0
    opened: int = 0
    seconds: float = 0.0
    """Processor time in total [s]."""
    carrying: float = 0.0
    """Processor time of the plant alone [s], without building and checking: its speed is no test result."""
    notes: list[str] = field(default_factory=list)
    slips: list[Array] = field(default_factory=list)
    """For methods without a mode for stick: the largest slip speed of any contact at every step."""


@dataclass(frozen=True)
class CellResult:
    """A colour, a reason ("" if green), and a line of text with the number that decided."""

    colour: Colour
    reason: Reason = ""
    detail: str = ""


def red(reason: Reason, text: str) -> CellResult:
    """Return a failure."""
    return CellResult("red", reason, text)


def amber(reason: Reason, text: str) -> CellResult:
    """Return neither success nor failure: no result, or an expensive one."""
    return CellResult("amber", reason, text)


def fault(error: Exception) -> CellResult:
    """Return the result of a run that one of `FAULTS` ended."""
    lines = error.faults if isinstance(error, SceneError) else str(error).splitlines()
    text = str(lines[0]) if lines else str(error)
    if isinstance(error, OutOfTime):
        return amber("cost", text)
    if not isinstance(error, NumericsError):
        return (amber if isinstance(error, UsageError) else red)("refused", text)
    finite = isinstance(error, Diverged) and all(np.isfinite(list(error.state.values())))
    kinds: dict[type[NumericsError], Reason] = {Chatter: "chatter", Jammed: "iteration cap"}
    kind = kinds.get(type(error), "energy" if finite else "NaN")
    return red(kind, f"at {error.time:.6g} s: {text}")


def judge(case: Case, outcome: RunOutcome, reference: RunOutcome | None, step: float = 1e-3) -> CellResult:
    """Return the result of a run in steps of `step` [s] that completed: its first fault."""
    checks = (_physical(case, outcome, reference), _expected(case, outcome, reference), _on_time(outcome, step))
    green = CellResult("green", "", ", ".join(outcome.notes))
    return next(itertools.chain(*checks), green)


def _physical(case: Case, outcome: RunOutcome, reference: RunOutcome | None) -> Iterator[CellResult]:
    """Faults of numbers, contacts, sticking and energy."""
    if outcome.not_finite:
        yield red("NaN", "a state or a measurement is not finite")
    if outcome.outside_cone > ROUND:
        yield red("missed event", f"friction is {outcome.outside_cone:.2g} outside of its cone")
    if outcome.pulling > ROUND:
        yield red("missed event", f"a contact pulls with {outcome.pulling:.2g} of its load")
    if outcome.slips and reference is not None and reference.stuck > 1e-3:
        slips = np.concatenate(outcome.slips)
        creeping = float(np.quantile(slips, 0.5 * reference.stuck))
        if creeping > ROUND * max(float(slips.max()), _TINY):
            share = 100.0 * reference.stuck
            text = f"never sticks; slips by {creeping:.2g} m/s where it should stick {share:.0f} % of the time"
            yield red("creep", text)
    if outcome.creep > ROUND:
        yield red("creep", f"slips by {outcome.creep:.2g} of its speed in stick")
    for name in case.expect.still:
        if name in outcome.ended and outcome.ended[name] != outcome.began[name]:
            yield red("creep", f"{name} has moved by {outcome.ended[name] - outcome.began[name]:.3g}")
    bound = SMOOTH
    if outcome.with_film:
        bound = WITH_FILM
    elif outcome.count or case.acts:
        bound = WITH_EVENTS
    if outcome.energy > bound:
        yield red("energy", f"residual of the energy balance {outcome.energy:.2g}, allowed {bound:g}")
    if outcome.negative_power > ROUND:
        yield red("energy", f"friction returns {outcome.negative_power:.2g} of its largest power")


def _expected(case: Case, outcome: RunOutcome, reference: RunOutcome | None) -> Iterator[CellResult]:
    """Deviations from what the case expects, and from the events of the reference."""
    for name, most in case.expect.largest.items():
        if not outcome.largest.get(name, 0.0) <= most:
            yield red("energy", f"{name} reaches {outcome.largest[name]:.4g}, allowed {most:g}")
    for name, most in case.expect.ends.items():
        if name in outcome.ended and not abs(outcome.ended[name]) <= most:
            yield red("energy", f"{name} ends at {outcome.ended[name]:.4g}, allowed {most:g}")
    if case.expect.stuck is not None and outcome.ended and outcome.stuck_now != case.expect.stuck:
        yield red("missed event", f"is not {'stuck' if case.expect.stuck else 'sliding'} at the end")
    if reference is None:
        return
    if outcome.count != reference.count:
        text = f"{counted(outcome.count, 'event')}, the reference has {reference.count}"
        yield red("missed event" if outcome.count < reference.count else "chatter", text)
    pairs = list(zip(outcome.events, reference.events))
    for number, ((_, ours), (_, theirs)) in enumerate(pairs, 1):
        if ours != theirs and not _tie(outcome, reference, number - 1):
            yield red("order lost", f"event {number} is {ours!r}, that of the reference {theirs!r}")
    if len(outcome.events) > 1:
        apart = (reference.events[-1][0] - reference.events[0][0]) / (len(reference.events) - 1)
        late = max(abs(ours - theirs) for (ours, _), (theirs, _) in pairs)
        if late > LATE * max(apart, _TINY):
            yield amber("order lost", f"events are up to {late / apart:.2g} of their mean distance late")


def _tie(outcome: RunOutcome, reference: RunOutcome, at: int) -> bool:
    """Whether both have the same simultaneous events at that instant, in any order."""
    instant, _ = outcome.events[at]

    def simultaneous(run: RunOutcome) -> list[str]:
        return sorted(what for time, what in run.events if abs(time - instant) < _TOGETHER)

    return simultaneous(outcome) == simultaneous(reference)


def _on_time(outcome: RunOutcome, step: float) -> Iterator[CellResult]:
    """Faults of pace."""
    if outcome.burst * step > PAUSE * 1e-9:
        yield red("overrun", f"{counted(outcome.burst, 'frame')} in one burst after a pause")
