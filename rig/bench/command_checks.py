"""Whether the recorded commands of controllers can be what took effect.

A re-simulation takes the commands as they are, so it says nothing of the measurement that a command answers and of its
status. Both follow from rules of the exchange, and a live recording contains what the controllers sent.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import repeat
from math import isfinite
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.bench.command_queue import AS_SENT, CLAMPED, SAFE
from rig.bench.experiment import PLANT
from rig.bus.impaired_link import ImpairedLink
from rig.record.message_scan import Scan
from rig.record.reader import Decoder
from rig.record.recorded_setup import setup_of
from rig.record.run import Commands, Run
from rig.scenes.scene import Scene

Wrong = tuple[NDArray[np.bool_], str]


def command_faults(log: Path, run: Run, scene: Scene) -> Iterator[str]:
    """The first command of each controller that breaks a rule, with its time."""
    sent = _sent(log) if run.on_bus and run.commands else {}
    links = scene.links("act")
    for name, commands in run.commands.items():
        delay, link = _delay_ns(name, run, scene) // run.frame_ns, links.get(name)
        rules = *_ruled(commands, delay, _on_time(run), link), *_as_sent(commands, sent.get(name, {}))
        for wrong, rule in rules:
            if wrong.any():
                at = int(np.argmax(wrong))
                t = int(commands.tick[at]) * run.frame_ns * 1e-9
                said = f"status {commands.status[at]}, answers the step of tick {commands.answered[at]}"
                yield f"the command of {name} at t = {t:.9g} s ({said}) cannot be right: {rule}"
                break


def _delay_ns(name: str, run: Run, scene: Scene) -> int:
    """The additional delay of the loop of a controller; of one that was admitted, the event of its admission has it."""
    if (section := scene.controllers.get(name)) is not None:
        return int(section.delay)
    admitted = [one["data"] for one in run.events if one["kind"] == "admitted" and one["source"] == PLANT]
    found = (data.get("delay_ns", 0) for data in admitted if data.get("controller") == name)
    return next((one for one in found if isinstance(one, int)), 0)


def _on_time(run: Run) -> bool:
    """Whether every command came as soon as it could: in one process, with no history of a live run.

    `Run.save` writes a live run as one of this process, but its summary has the verdict on its timing.
    """
    return not run.on_bus and "verdict" not in run.summary and "ancestor" not in run.provenance


def _ruled(commands: Commands, delay: int, on_time: bool, link: ImpairedLink | None) -> Iterator[Wrong]:
    """Rules of the exchange for a loop with a delay of `delay` ticks, whose commands come over `link`."""
    tick, answered, status, _ = commands
    safe = status == SAFE
    least, most = (0, 0) if link is None else (link.least, link.most)
    early = answered + delay + least > tick
    if link is not None and link.loss:
        lost = np.array([number >= 0 and link.loses(number) for number in answered.tolist()], np.bool_)
        yield lost, "the scene's link loses the answer to this step"
    yield (status < AS_SENT) | (status > SAFE), "a status is 0 (as sent), 1 (clamped or completed) or 2 (safe)"
    yield safe != (answered == -1), "safe values answer no step, all other commands answer one"
    yield ~safe & ((answered < 0) | early), "it took effect before it could arrive"
    if on_time:
        late = answered + delay + most < tick
        yield ~safe & late, "in one process a command takes effect as soon as its delay is over"


def _as_sent(commands: Commands, sent: dict[int, list[tuple[float, ...]]]) -> Iterator[Wrong]:
    """Rules for a command and what its controller sent for the step that it answers.

    A value can be the one that was in force before: if the controller sent none, or if its rig is still being built.
    """
    unsent = np.zeros(commands.tick.size, np.bool_)
    unclamped = unsent.copy()
    before: tuple[float, ...] = ()
    for i, (answered, status, row) in enumerate(
        zip(commands.answered.tolist(), commands.status.tolist(), commands.values.tolist())
    ):
        values, known = tuple(row), sent.get(answered, ())
        if known and status == AS_SENT:
            unsent[i] = not any(map(_follows, known, repeat(values), repeat(before or values)))
        elif known and status == CLAMPED:
            unclamped[i] = values in known
        before = values
    yield unsent, "with status 0 it has the values that the controller sent for this step, and it has others"
    yield unclamped, "with status 1 it has other values than the controller sent for this step, and it has the same"


def _follows(sent: Sequence[float], values: Sequence[float], before: Sequence[float]) -> bool:
    return len(sent) == len(values) and all(
        value == given or value == held or not isfinite(given) for given, value, held in zip(sent, values, before)
    )


def _sent(log: Path) -> dict[str, dict[int, list[tuple[float, ...]]]]:
    """Controller -> tick -> commands that it sent over the bus in answer to this step."""
    scan, found = Scan(log), dict[str, dict[int, list[tuple[float, ...]]]]()
    gathered = scan.payloads(("act/",))
    decode = Decoder(setup_of(scan))
    for topic, payloads in gathered.items():
        own = found.setdefault(topic.removeprefix("act/"), {})
        for block in decode.columns(topic, payloads):
            for tick, values in zip(block["tick"].ravel().tolist(), block["values"].reshape(len(block["tick"]), -1)):
                own.setdefault(tick, []).append(tuple(values.tolist()))
    return found
