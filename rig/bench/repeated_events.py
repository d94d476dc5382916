"""Events of a recording that its re-simulation must repeat: those of the rig, its protocol and its operators."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from itertools import zip_longest
from typing import Any

from rig.bench.experiment import EMERGENCY, PLANT
from rig.bench.fault_times import FAULT
from rig.record.run import Run

_REPEATED = frozenset(
    {"step", "mark", "timeout", "limit", "knock", "parameter", "connected", "disconnected", "admitted", "dismissed"}
    | {EMERGENCY, FAULT}
)
"""Kinds of events that depend on ticks and commands only; others tell how processes and the clock behaved."""
_CONTACT = "contact"
"""Kind of event that a run on the bus does not publish."""

Event = Mapping[str, Any]


def differences(run: Run, again: Run, end_ns: int, exact: bool = True) -> tuple[int, list[str]]:
    """Compare the events of `run` up to `end_ns` with those of its re-simulation `again`, to the last bit.

    Returns the number of events that agree, and the first one of each kind that does not, as text. Contacts are
    compared if the outputs were recorded at every step in one process: the bus does not carry contacts. Not `exact`: on
    another processor, where contacts move by rounding errors and are not compared, and neither are numbers of events.
    """
    every_step = (
        exact and not run.on_bus and run.time.size > 1 and round(float(run.time[1] - run.time[0]) * 1e9) == run.step_ns
    )
    kinds = _REPEATED | ({_CONTACT} if every_step else frozenset())
    recorded, simulated = (_by_kind(one.events, kinds, end_ns) for one in (run, again))
    agrees = _agree if exact else _alike
    agree, found = 0, []
    for kind in sorted(recorded.keys() | simulated.keys()):
        pairs = list(zip_longest(recorded[kind], simulated[kind]))
        same = next((i for i, pair in enumerate(pairs) if not agrees(*pair)), len(pairs))
        agree += same
        if same < len(pairs):
            one, other = pairs[same]
            t_ns = min(event["t_ns"] for event in (one, other) if event is not None)
            found.append(f"event {kind} differs at t = {t_ns * 1e-9:.9g} s: {_shown(one)} and {_shown(other)}")
    return agree, found


def _by_kind(events: Iterable[Event], kinds: frozenset[str], end_ns: int) -> dict[str, list[Event]]:
    found: dict[str, list[Event]] = defaultdict(list)
    for event in events:
        if (
            event["source"] == PLANT
            and event["kind"] in kinds
            and event["t_ns"] <= end_ns
            and not _of_controller(event)
        ):
            found[event["kind"]].append(event)
    return found


def _of_controller(event: Event) -> bool:
    """Whether the protocol changes a value of a controller: in a re-simulation none works, and none can refuse."""
    return bool(event["kind"] == "parameter" and event["text"].startswith("controllers."))


def _alike(one: Event | None, other: Event | None) -> bool:
    return one is not None and other is not None and all(one[key] == other[key] for key in ("t_ns", "tick", "text"))


def _agree(one: Event | None, other: Event | None) -> bool:
    if one is None or other is None or not _alike(one, other):
        return False
    shared = one["data"].keys() & other["data"].keys()  # older recordings contain less data
    return all(one["data"][key] == other["data"][key] for key in shared)


def _shown(event: Event | None) -> str:
    if event is None:
        return "none"
    data = f" {event['data']}" if event["data"] else ""
    return f"{event['text']!r} at {event['t_ns']} ns{data}"
