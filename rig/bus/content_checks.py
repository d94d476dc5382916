"""Checks of the content of messages: bounds of their fields, and what must hold between their fields."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from rig.bus import messages, topics
from rig.bus.arrivals import Count, Refused
from rig.bus.json_text import read_json
from rig.errors import BusError

PAYLOAD = 1 << 24
"""Longest message [bytes]. From another process the hub accepts at most `rig.bus.access.FROM_LEAVES`."""
TICKS, TIMES_NS, SPAN_NS = 1 << 53, 1 << 62, 1 << 42
"""Bounds of tick, simulated time and sample interval."""
TOPICS = 1024
"""Most topics that are counted one by one."""
_BOUNDS = {"tick": TICKS, "t_ns": TIMES_NS, "t0_ns": TIMES_NS, "dt_ns": SPAN_NS}
ContentCheck = Callable[[str, Any, dict[str, Count], Count, float], None]
"""(topic, message, counts of all topics, count of this topic, time [s]): raises Refused if the content is wrong."""

FIELDS = {"State": (("tick", TICKS), ("t_ns", TIMES_NS))} | {
    kind: tuple((name, limit) for name, limit in _BOUNDS.items() if isinstance(getattr(made(), name, None), int))
    for kind, made in messages.TYPES.items()
}
"""Kind of message -> its bounded fields and the bound of each."""


def content_checks(sensors: int | None) -> dict[str, ContentCheck]:
    """The check of each kind of message that has one. `sensors`: number of sensors of the scene, if known."""
    return {
        "Step": partial(_check_step, sensors),
        "Applied": _check_applied,
        "Band": _check_band,
        "Event": _check_event,
        "Totals": _check_totals,
    }


def _check_step(sensors: int | None, topic: str, step: Any, counts: dict[str, Count], count: Count, now: float) -> None:
    if step.tick != count.tick + 1 and not count.plausible(step.tick - count.tick, now):
        raise Refused("implausible tick", f"tick {step.tick} after tick {count.tick}")
    values = len(step.values)
    if sensors not in (None, values):
        raise Refused("wrong length", f"a Step of {values} values for {sensors} sensors")
    if step.heard:
        fresh = step.fresh
        if any(not 0 <= place < min(values, len(fresh)) for place in step.heard):
            raise Refused("wrong length", "a Step contains samples of a sensor that does not exist")
        brought = [fresh[place] for place in step.heard]
        if min(brought) < 0 or sum(brought) != len(step.samples):
            raise Refused("wrong length", f"a Step contains {len(step.samples)} samples, but announces {sum(brought)}")
    count.tick = step.tick


def _check_applied(topic: str, content: Any, counts: dict[str, Count], count: Count, now: float) -> None:
    if content.ticks:
        try:
            messages.commands(content)
        except BusError as fault:
            raise Refused("wrong length", str(fault)) from None


def _check_band(topic: str, band: Any, counts: dict[str, Count], count: Count, now: float) -> None:
    spans, times = len(band.ends_ns), [band.t0_ns, *band.ends_ns]
    even = len(band.low) == len(band.high) and not (len(band.low) % spans if spans else len(band.low))
    met = len(band.counts) == spans and sum(band.counts) == len(band.modes) and min(band.counts, default=1) > 0
    if times != sorted(set(times)) or times[-1] >= TIMES_NS or not 0 < band.step_ns < SPAN_NS:
        raise Refused("out of bounds", f"a Band from {times[0]} to {times[-1]} ns in steps of {band.step_ns} ns")
    if not (even and met and len(band.pair) in (0, 2 * len(band.pair_modes))):
        raise Refused("wrong length", f"a Band of {spans} spans whose columns differ in length")


def _check_event(topic: str, content: Any, counts: dict[str, Count], count: Count, now: float) -> None:
    read_json(content.data.encode() or b"{}", PAYLOAD, finite=False)


def _check_totals(topic: str, content: Any, counts: dict[str, Count], count: Count, now: float) -> None:
    sent, heard = content.sent_topic, content.heard_topic
    if len(sent) != len(content.sent) or not len(heard) == len(content.received) == len(content.lost):
        raise Refused("wrong length", "Totals whose columns differ in length")
    if max(len(sent), len(heard)) > TOPICS:
        raise Refused("too many topics", f"Totals of more than {TOPICS} topics")
    if foreign := [one for one in sent if topics.owner(one) not in topic.split("/") and topic != "total/plant"]:
        raise Refused("not its own topic", f"{topic} claims messages on {foreign[0][:80]}, which it does not own")
    nothing = Count()
    pairs = (*zip(sent, content.sent), *zip(heard, content.received), *zip(heard, content.lost))
    for one, number in pairs:
        seen = counts.get(one, nothing)
        if number < 0 or not seen.plausible(number - 1 - seen.last, now):
            raise Refused("implausible number", f"Totals of {number} messages on {one[:80]}")
