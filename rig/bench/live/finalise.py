"""The end of a run: last messages, losses, the timing verdict and the summary.

The plant publishes how many messages it sent; recorders and controllers answer with how many they received. The
difference is a loss. Then the plant publishes the timing verdict and the totals again, so that they include it.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from rig.bench.live.hub import missing
from rig.bench.live.outcome import Job
from rig.bench.live.timing import TimingVerdict
from rig.bus import messages
from rig.bus.inbound import TICKS
from rig.controllers.runtime.loop import Loop
from rig.errors import BusError, ExitCode
from rig.printable import counted

if TYPE_CHECKING:
    from rig.bench.live.plant import Plant

# Longest wait for the totals of the other processes, and for a sign that a recorder still catches up [s].
ANSWERS_S = 5.0
# Longest wait for a recorder that catches up [s]. # chosen: what waits for it fits into 160 MB
CATCH_UP_S = 300.0
TELL_S = 2.0
"""Time between two lines about a recorder that catches up [s]."""
COUNTERS_S = 1.0  # longest wait for the counters of a controller [s]; it looks for questions ten times per second
LAST_ANSWER_S = 0.1  # longest wait for the answers to the last steps [s]


def finalise(plant: Plant) -> dict[str, Any]:
    """End the run of `plant` and return its summary."""
    hub = plant.hub
    experiment = plant.experiment
    runner = plant.runner
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
        if counts["skipped"]:
            plant.housekeeper.faults.append(f"{name} was behind and skipped {counted(counts['skipped'], 'step')}")
    experiment.journal.note("end", ended)
    hub.put_events()
    plant.in_plant.leave()
    plant.housekeeper.tell_health(now)
    lost, unknown = _lost_elsewhere(plant)
    lost |= _unanswered(plant, {name: counts["skipped"] for name, counts in counters.items()})
    hub.commands.receive()
    lost |= hub.commands.lost()
    verdict = timing_verdict(plant, lost, unknown)
    code = verdict.exit_code or (ExitCode.INTERRUPTED if plant.interrupted else ExitCode.DONE)
    if plant.fault or experiment.aborted:
        code = ExitCode.STOPPED
    elif ended == "failed":
        code = ExitCode.FAILED
    statistics = runner.statistics()
    t = runner.t_ns / 1e9
    summary: dict[str, Any] = {
        "run": plant.session.run,
        "scene": plant.scene.name,
        "verdict": verdict.word,
        "reasons": list(verdict.reasons),
        "exit_code": code,
        "ended": ended,
        "fault": plant.fault or experiment.aborted,
        "mode": _mode(plant.job),
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


def _mode(job: Job) -> str:
    """Which clock the run has, in the words of its summary."""
    if not job.pace:
        return "lockstep, not paced"
    return "lockstep" if job.in_lockstep else "paced"


def timing_verdict(plant: Plant, lost: dict[str, int], unknown: list[str]) -> TimingVerdict:
    """The timing verdict of a run. `lost`: messages by topic; `unknown`: processes whose losses are unknown."""
    faults = list(plant.housekeeper.faults)
    for name, commands in plant.experiment.exchange.all_queues.items():
        if commands.counts.safe:
            faults.append(f"safe values replaced the commands of {name} {counted(commands.counts.safe, 'time')}")
        if commands.counts.not_finite:
            faults.append(f"{counted(commands.counts.not_finite, 'command')} of {name} not finite")
    if plant.fault:
        faults.append(plant.fault.partition("\n")[0])
    clock = plant.scene.clock
    pacer = plant.housekeeper.pacer
    return plant.timing.verdict(
        clock.late_share_valid, clock.late_share_degraded, lost, faults, pacer is not None and pacer.stopped, unknown
    )


def _counters(plant: Plant) -> dict[str, dict[str, int]]:
    """Controller -> its counters (`Loop.counters`); those of another process are asked for, if it is still here."""
    counters = plant.in_plant.counters()
    here = plant.hub.watch.present
    for name in plant.experiment.exchange.queues:
        if name not in counters and ("controller", name) in here:
            with suppress(BusError, LookupError, TypeError):  # one in another language has none
                told = plant.session.ask(f"param/{name}", {"get": []}, COUNTERS_S)["counters"]
                counts = {what: told[what] for what in Loop.COUNTED}
                if all(type(count) is int and 0 <= count < TICKS for count in counts.values()):
                    counters[name] = counts
    return counters


def _unanswered(plant: Plant, skipped: Mapping[str, int]) -> dict[str, int]:
    """Return the number of steps without an answer, for each controller that was connected during the whole run.

    `skipped`: controller -> number of steps that it received and left out.
    """
    hub = plant.hub
    unanswered = {}
    if plant.job.in_lockstep:  # a step in lockstep is repeated until it is answered
        return {}
    here = plant.from_start & hub.watch.present
    deadline = time.monotonic() + LAST_ANSWER_S
    asked = plant.scene.controllers.keys() - hub.in_plant
    for name in sorted(name for role, name in here if role == "controller" and name in asked):
        left_out = skipped.get(name, 0)
        while hub.commands.unanswered(name) > left_out:
            left = deadline - time.monotonic()
            if left <= 0.0:
                break
            hub.commands.next(left)
        if (count := hub.commands.unanswered(name) - left_out) > 0:
            unanswered[f"step to {name}"] = count
    return unanswered


def _lost_elsewhere(plant: Plant) -> tuple[dict[str, int], list[str]]:
    """Return the messages that others miss ("topic to name" -> number), and the recorders that did not answer.

    Only the recorder of the run and controllers that drive an actuator count: a viewer may drop what it cannot draw,
    and a guest may use any name.
    """
    hub = plant.hub
    session = plant.session
    queues = plant.experiment.exchange.queues
    hub.totals.drain()
    hub.put_totals()
    own = messages.decode("total/plant", session.totals())
    sent = {topic: n for topic, n in zip(own.sent_topic, own.sent) if topic != "total/plant"}
    roles = dict.fromkeys(plant.recorders(), "recorder")
    asked = set(roles)
    roles |= {name: role for role, name in hub.watch.present if role == "controller" and name in queues}
    missed: dict[str, int] = {}
    t = plant.runner.t_ns / 1e9
    deadline = time.monotonic() + ANSWERS_S
    last = time.monotonic() + CATCH_UP_S
    tell = time.monotonic() + TELL_S
    while asked:
        left = min(deadline, last) - time.monotonic()
        if left <= 0.0:
            break
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
            missed[f"{topic} to {name}"] = count
    plant.housekeeper.faults += [f"{roles[name]} {name} did not report what it received" for name in sorted(asked)]
    away = plant.from_start - hub.watch.present
    gone = {name for role, name in away if role == "recorder" and plant.is_recorder(name)}
    return missed, [f"recorder {name}" for name in sorted(asked | gone)]
