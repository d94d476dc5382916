"""The end of a run: last messages, losses, the timing verdict and the summary.

The plant publishes how many messages it sent; recorders and controllers answer with how many they received. The
difference is a loss. Then the plant publishes the timing verdict and the totals again, so that they include it.
"""

from __future__ import annotations

import json
import os
import time
from contextlib import suppress
from typing import Any

from rig.bench.hub import missing
from rig.bench.plant_parts import PlantParts
from rig.bench.timing import TimingVerdict
from rig.bus import messages
from rig.errors import BusError, ExitCode
from rig.printable import counted

ANSWERS_S = 5.0
"""Longest wait for the totals of the other processes, and for a sign that a recorder still catches up [s]."""
CATCH_UP_S = 300.0
"""Longest wait for a recorder that catches up [s]. # chosen: what waits for it fits into 160 MB"""
TELL_S = 2.0
"""Time between two lines about a recorder that catches up [s]."""
COUNTERS_S = 1.0
"""Longest wait for the counters of a controller [s]; it looks for questions ten times per second."""
LAST_ANSWER_S = 0.1
"""Longest wait for the answers to the last steps [s]."""


def finalise(plant: PlantParts) -> dict[str, Any]:
    """End the run of `plant` and return its summary."""
    hub, experiment, runner = plant.hub, plant.experiment, plant.runner
    now = time.perf_counter_ns()
    wall = now - plant.begun_ns if plant.begun_ns else 0
    plant.operator.close()
    hub.collect()  # a batch of frames may have ended before its last tick
    hub.put_applied()
    hub.put_rest()
    ended = "diverged" if plant.fault else experiment.over or "failed"
    experiment.end()
    counters = _counters(plant)
    plant.housekeeper.faults += [*experiment.postponed.never, *plant.in_plant.failures]
    for name, counts in counters.items():
        if counts["refused"]:
            plant.housekeeper.faults.append(
                f"{counted(counts['refused'], 'answer')} of {name} not finite, and not sent"
            )
    experiment.journal.note("end", ended)
    hub.put_events()
    plant.in_plant.leave()
    plant.housekeeper.tell_health(now)
    lost, unknown = _lost_elsewhere(plant)
    lost |= _unanswered(plant)
    hub.commands.receive()
    lost |= hub.commands.lost()
    verdict = timing_verdict(plant, lost, unknown)
    statistics = runner.statistics()
    t = runner.t_ns / 1e9
    summary: dict[str, Any] = {
        "run": plant.session.run,
        "scene": plant.scene.name,
        "verdict": verdict.word,
        "reasons": list(verdict.reasons),
        "exit_code": _exit_code(plant, ended, verdict),
        "ended": ended,
        "fault": plant.fault or experiment.aborted,
        "mode": ("lockstep" if plant.job.in_lockstep else "paced") if plant.job.pace else "lockstep, not paced",
        "pace": plant.job.pace,
        "ticks": runner.tick,
        "seconds": t,
        "wall_seconds": wall / 1e9,
        "rate": t * 1e9 / wall if wall else 0.0,
        "timing": plant.timing.to_json() if plant.job.pace else {},
        "waiting": plant.waiting._asdict() if plant.waiting else {},
        "scheduling": plant.ahead.account if plant.ahead else "",
        "memory": plant.memory,
        "round_trip": hub.commands.round_trip.to_json(),
        "loop": experiment.exchange.counters(),
        "controllers": counters,
        "lost": lost,
        "unknown": unknown,
        "refused": plant.session.inbound.refusals(),
        "faults": plant.housekeeper.faults,
        "postponed": experiment.postponed.to_json(),
        "energy": statistics.pop("energy"),
        "plant": statistics,
        "audit": runner.audit(),
        "sensors": runner.bank.counters(),
        **({"network": network} if (network := experiment.network()) else {}),
        "processor_seconds": sum(os.times()[:2]),
    }
    summary = json.loads(json.dumps(summary, default=float))
    event = messages.event(runner.t_ns, runner.tick, "plant", "verdict", verdict.word, summary)
    plant.session.publisher("event/plant").put(event, runner.t_ns)
    hub.put_totals()
    return summary


def _exit_code(plant: PlantParts, ended: str, verdict: TimingVerdict) -> ExitCode:
    if plant.fault or plant.experiment.aborted:
        return ExitCode.STOPPED
    if ended == "failed":
        return ExitCode.FAILED
    return verdict.exit_code or (ExitCode.INTERRUPTED if plant.interrupted else ExitCode.DONE)


def timing_verdict(plant: PlantParts, lost: dict[str, int], unknown: list[str]) -> TimingVerdict:
    """The timing verdict of a run. `lost`: messages by topic; `unknown`: processes whose losses are unknown."""
    faults = list(plant.housekeeper.faults)
    for name, queue in plant.experiment.exchange.all_queues.items():
        if queue.counts.safe:
            faults.append(f"safe values replaced the commands of {name} {counted(queue.counts.safe, 'time')}")
        if queue.counts.not_finite:
            faults.append(f"{counted(queue.counts.not_finite, 'command')} of {name} not finite")
    if plant.fault:
        faults.append(plant.fault.partition("\n")[0])
    clock, pacer = plant.scene.clock, plant.housekeeper.pacer
    broken = pacer is not None and pacer.stopped
    return plant.timing.verdict(clock.late_share_valid, clock.late_share_degraded, lost, faults, broken, unknown)


def _counters(plant: PlantParts) -> dict[str, dict[str, int]]:
    """Controller -> its counters (`Loop.counters`); those of another process are asked for, if it is still here."""
    found, here = plant.in_plant.counters(), plant.hub.watch.present
    for name in plant.experiment.exchange.queues:
        if name not in found and ("controller", name) in here:
            with suppress(BusError, LookupError, TypeError, ValueError):  # one in another language has none
                told = plant.session.ask(f"param/{name}", {"get": []}, COUNTERS_S)["counters"]
                found[name] = {what: int(told[what]) for what in ("updates", "held", "refused")}
    return found


def _unanswered(plant: PlantParts) -> dict[str, int]:
    """Return the number of steps without an answer, for each controller that was connected during the whole run."""
    hub, found = plant.hub, {}
    if plant.job.in_lockstep:  # a step in lockstep is repeated until it is answered
        return {}
    here = plant.from_start & hub.watch.present
    deadline = time.monotonic() + LAST_ANSWER_S
    asked = plant.scene.controllers.keys() - hub.in_plant
    for name in sorted(name for role, name in here if role == "controller" and name in asked):
        while hub.commands.unanswered(name) > 0 and (left := deadline - time.monotonic()) > 0.0:
            hub.commands.next(left)
        if (count := hub.commands.unanswered(name)) > 0:
            found[f"step to {name}"] = count
    return found


def _lost_elsewhere(plant: PlantParts) -> tuple[dict[str, int], list[str]]:
    """Return the messages that others miss ("topic to name" -> number), and the recorders that did not answer.

    Only the recorder of the run and controllers that drive an actuator count: a viewer may drop what it cannot draw,
    and a guest may use any name.
    """
    hub, session = plant.hub, plant.session
    hub.totals.drain()
    hub.put_totals()
    own = messages.decode("total/plant", session.totals())
    sent = {topic: n for topic, n in zip(own.sent_topic, own.sent) if topic != "total/plant"}
    roles = dict.fromkeys(plant.recorders(), "recorder")
    asked = set(roles)
    roles |= {name: role for role, name in hub.watch.present if role == "controller" and hub.drives(name)}
    found: dict[str, int] = {}
    t, deadline = plant.runner.t_ns / 1e9, time.monotonic() + ANSWERS_S
    last, tell = time.monotonic() + CATCH_UP_S, time.monotonic() + TELL_S
    while asked and (left := min(deadline, last) - time.monotonic()) > 0.0:
        message = hub.totals.get(left)
        if message is None:
            break
        name = message.topic.partition("/")[2]
        if name not in roles or not hub.commands.speaks_for(message.user, name):
            continue
        if roles[name] == "recorder" and "total/plant" not in message.said.heard_topic:
            deadline = time.monotonic() + ANSWERS_S  # a plant as fast as possible outruns it; it goes on writing
            if time.monotonic() > tell:
                tell = time.monotonic() + TELL_S
                plant.say(f"waiting for {name}: {message.t_ns / 1e9:.1f} of {t:.1f} s are written")
            continue
        asked.discard(name)
        wanted = sent if roles[name] == "recorder" else {"step": sent["step"]}
        whole = (roles[name], name) in plant.from_start
        for topic, count in missing(wanted, message.said, whole).items():
            found[f"{topic} to {name}"] = count
    for name in sorted(asked):
        plant.housekeeper.faults.append(f"{roles[name]} {name} did not report what it received")
    away = plant.from_start - hub.watch.present
    gone = {name for role, name in away if role == "recorder" and plant.is_recorder(name)}
    return found, [f"recorder {name}" for name in sorted(asked | gone)]
