"""Verifies a recording: it must be complete, and a re-simulation must give the same values.

The plant is simulated again from the scene in the file; commands and other actions from outside take effect at their
recorded ticks. `rig.bench.again.agreement` states how samples must agree. Events of the rig, its protocol and its
operators must be repeated. If samples do not agree because contact points have opened, they are compared up to the
first opening, and statistics after it.

A window that a trigger recorded can be simulated again only if it begins at t = 0. Otherwise the state at its begin is
unknown, and only its checksums are verified.

A re-simulation takes the commands as they are, so it says nothing of the measurement that a command answers and of its
status. Both follow from rules of the exchange, and a live recording contains what the controllers sent
(`command_faults`).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import repeat, zip_longest
from math import isfinite, isinf
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.bench.again.agreement import (
    BEFORE,
    ELSEWHERE,
    ROUNDED,
    SHORTEST,
    Openings,
    agreement,
    changed_place,
    compared,
    duration_ns,
    other_mode_sets,
    pairs,
    unknown,
)
from rig.bench.again.history import history_end, recorded_scene
from rig.bench.run.command_queue import AS_SENT, CLAMPED, SAFE
from rig.bench.run.experiment import EMERGENCY, FAULT, PLANT
from rig.bench.run.local_controllers import LOST
from rig.bench.run.simulate import Recorded, Tell, simulate
from rig.bus.impaired_link import ImpairedLink
from rig.errors import LogError
from rig.printable import counted
from rig.record import reader, user_notes
from rig.record.message_scan import Scan
from rig.record.reader import Decoder
from rig.record.recorded_setup import setup_of
from rig.record.run import Commands, Integers, Reals, Run
from rig.scenes.scene import Scene

_REPEATED = frozenset(
    {"step", "mark", "timeout", "limit", "knock", "parameter", "connected", "disconnected", "admitted", "dismissed"}
    | {EMERGENCY, FAULT}
)
"""Kinds of events that depend on ticks and commands only; others tell how processes and the clock behaved."""
_CONTACT = "contact"  # kind of event that a run on the bus does not publish

Event = Mapping[str, Any]

Wrong = tuple[NDArray[np.bool_], str]


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
    recorded, simulated = (_by_kind(each.events, kinds, end_ns) for each in (run, again))
    agree = 0
    differing = []
    for kind in sorted(recorded.keys() | simulated.keys()):
        pairs = list(zip_longest(recorded[kind], simulated[kind]))
        same = next((i for i, pair in enumerate(pairs) if not _agree(*pair, exact)), len(pairs))
        agree += same
        if same < len(pairs):
            first, other = pairs[same]
            t_ns = min(event["t_ns"] for event in (first, other) if event is not None)
            differing.append(f"event {kind} differs at t = {t_ns * 1e-9:.9g} s: {_shown(first)} and {_shown(other)}")
    return agree, differing


def _by_kind(events: Iterable[Event], kinds: frozenset[str], end_ns: int) -> dict[str, list[Event]]:
    events_of_kind: dict[str, list[Event]] = defaultdict(list)
    for event in events:
        # a value of a controller: in a re-simulation none works, and none can refuse
        of_controller = event["kind"] == "parameter" and event["text"].startswith("controllers.")
        if event["source"] == PLANT and event["kind"] in kinds and event["t_ns"] <= end_ns and not of_controller:
            events_of_kind[event["kind"]].append(event)
    return events_of_kind


def _agree(event: Event | None, other: Event | None, exact: bool) -> bool:
    if event is None or other is None or any(event[key] != other[key] for key in ("t_ns", "tick", "text")):
        return False
    shared = event["data"].keys() & other["data"].keys() if exact else ()  # older recordings contain less data
    return all(event["data"][key] == other["data"][key] for key in shared)


def _shown(event: Event | None) -> str:
    return "none" if event is None else f"{event['text']!r} at {event['t_ns']} ns {event['data'] or ''}".rstrip()


def command_faults(log: Path, run: Run, scene: Scene) -> Iterator[str]:
    """The first command of each controller that breaks a rule, with its time."""
    sent = _sent(log) if run.on_bus and run.commands else {}
    links = scene.links("act")
    for name, commands in run.commands.items():
        delay = _delay_ns(name, run, scene) // run.frame_ns
        link = links.get(name)
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
    admitted = [event["data"] for event in run.events if event["kind"] == "admitted" and event["source"] == PLANT]
    delays = (data.get("delay_ns", 0) for data in admitted if data.get("controller") == name)
    return next((delay for delay in delays if isinstance(delay, int)), 0)


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
        values = tuple(row)
        known = sent.get(answered, ())
        if known and status == AS_SENT:
            unsent[i] = not any(map(_follows, known, repeat(values), repeat(before or values)))
        elif known and status == CLAMPED:
            unclamped[i] = values in known
        before = values
    yield unsent, "with status 0 it has the values that the controller sent for this step, and it has others"
    yield unclamped, "with status 1 it has other values than the controller sent for this step, and it has the same"


def _follows(sent: Sequence[float], values: Sequence[float], before: Sequence[float]) -> bool:
    """Whether a command as it took effect is the sent one, completed by the values before it."""
    if len(sent) != len(values):
        return False
    commands = zip(sent, values, before)
    return all(value == given or value == held or not isfinite(given) for given, value, held in commands)


def _sent(log: Path) -> dict[str, dict[int, list[tuple[float, ...]]]]:
    """Controller -> tick -> commands that it sent over the bus in answer to this step."""
    scan = Scan(log)
    commands = dict[str, dict[int, list[tuple[float, ...]]]]()
    gathered = scan.payloads(("act/",))
    decode = Decoder(setup_of(scan))
    for topic, payloads in gathered.items():
        own = commands.setdefault(topic.removeprefix("act/"), {})
        for block in decode.columns(topic, payloads):
            for tick, values in zip(block["tick"].ravel().tolist(), block["values"].reshape(len(block["tick"]), -1)):
                own.setdefault(tick, []).append(tuple(values.tolist()))
    return commands


@dataclass(frozen=True)
class Verification:
    """The result of verifying a recording.

    `seconds`: simulated time [s]. `compared`: number of values compared. `events`: number of events that agree.
    `deviation`: largest deviation of a signal as a share of its range. `elsewhere`: differences between this machine
    and that of the recording: sources, processor, versions. `notes`: notes that the user should know, but that are not
    faults of the recording. `opened`: time of the first opening of a contact point [s], if samples were compared only
    up to there. `statistics`: statistics compared after it: of the recording, of the re-simulation, and the tolerance.
    `simulated`: whether the run was simulated again; not possible for a window that begins after t = 0. `user_notes`:
    notes that somebody wrote on the recording. They lie beside it and are not verified.
    """

    log: str
    seconds: float
    compared: int
    events: int
    identical: bool
    deviation: float
    elsewhere: tuple[str, ...]
    faults: tuple[str, ...]
    notes: tuple[str, ...] = ()
    opened: float | None = None
    statistics: tuple[str, ...] = ()
    simulated: bool = True
    user_notes: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether the recording is verified: no fault was found."""
        return not self.faults

    def to_json(self) -> dict[str, Any]:
        """The result as plain values for JSON."""
        return {**vars(self), "passed": self.passed}

    def text(self) -> str:
        """The result as text."""
        right = "verified" if self.simulated else "undamaged, but not simulated again"
        lines = [f"{self.log}: {right if self.passed else 'not verified'}"]
        lines += [f"  {line}" for line in (*self.faults, *self.notes)]
        lines += self._agreement() if self.simulated else []
        lines += ["  notes on it (not part of the recording, not verified):"] if self.user_notes else []
        return "\n".join([*lines, *(f"    {note}" for note in self.user_notes)])

    def _agreement(self) -> list[str]:
        """The comparison as lines."""
        rounded = "bit by bit" if self.identical or self.opened else "except for rounding errors"
        agreement = f"to {self.deviation:.1e} of their range" if self.deviation else rounded
        if isinf(self.deviation):
            agreement = "except for some that are missing or not finite in one of both"
        events = f", and {counted(self.events, 'event')}" if self.events else ""
        lines = [f"  {self.seconds:g} s simulated again, {counted(self.compared, 'number')} agree {agreement}{events}"]
        if self.opened is not None:
            lines = [
                f"  {self.seconds:g} s simulated again; a contact point opens first at t = {self.opened:.6g} s",
                f"  before: {counted(self.compared, 'number')} agree {agreement} ({BEFORE:g} is allowed)",
                "  from there on the motion is chaotic: statistics, recorded and here (what is allowed)",
                *(f"    {statistic}" for statistic in self.statistics),
            ]
        if self.elsewhere and not self.identical:
            lines.append(f"  recorded elsewhere: other {', '.join(self.elsewhere)}")
        return lines


def verify(log: Path, tell: Tell | None = None) -> Verification:
    """Verify the recording `log`; `tell` gets the progress (`rig.bench.run.simulate`).

    Raises rig.errors.LogError if the file is no recording or has lost its scene.
    """
    run = reader.open(log)
    if run.measured or run.begin_ns:
        return _by_checksums(log, run)
    scene = recorded_scene(log, run)
    try:
        again = simulate(
            scene, {}, duration_ns(run), Recorded(run.commands, run.events, measured=run.measurements), tell=tell
        )
    except LogError as error:
        raise LogError(f"{log}: {error}") from None
    elsewhere = changed_place(run)
    notes = [note for note in (run.recovered, run.untold) if note]
    if scene.models != Scene.from_json(again.scene).models:
        elsewhere.append("model")
        notes.append("the recording has lost the model of its structure: one that was built here takes its place")
    elif scene.models and not run.models:
        notes.append("the recording has lost the model of its structure; the one that was built here is the same")
    common = list(pairs(run, again, modes=not (elsewhere or run.notes)))  # a lost one cannot be told from a mode set
    agreed = agreement(common, scene, bool(elsewhere))
    openings = Openings.of(run, again)
    chaotic = agreed.first and elsewhere and agreed.deviation > ELSEWHERE and openings.first is not None
    faults = [*unknown(run, again), *_gaps(run, again)]
    events = 0
    if not run.damage:
        faults += [*command_faults(log, run, scene), *_network(run, again)]
    if run.damage:
        notes.append("events were not compared, because of the damage")
    elif other := sorted(set(elsewhere) - ROUNDED):
        notes.append(f"events and mode sets were not compared: it was recorded with another {' and '.join(other)}")
    else:
        end_ns = round(openings.first * 1e9) if chaotic and openings.first is not None else duration_ns(run)
        events, others = differences(run, again, end_ns, exact=not elsewhere)
        faults += others
        if elsewhere and not run.notes:
            faults += other_mode_sets(run, again, end_ns)
    lost = [event["text"] for event in run.plant_events if event["kind"] == LOST]
    if run.fault in lost:  # controllers are not called again
        notes.append(run.fault)
    elif run.fault not in ("", run.damage, again.fault, again.summary["ended"]):  # a limit ends a run without a fault
        faults.insert(0, run.fault)
    if run.damage:
        faults.insert(0, run.damage)
    parts: list[str] = []
    allowed = ELSEWHERE
    if chaotic and openings.first is not None:
        agreed = agreement(common, scene, True, openings.first)
        allowed = BEFORE
        if fault := openings.fault(float(np.diff(run.time[:2]).sum())):
            faults.append(fault)
        else:
            parts, wrong = _statistics(run, again, openings.first)
            faults += wrong
    if agreed.first and (not elsewhere or agreed.deviation > allowed):
        faults.append(agreed.first)
    if not (run.sealed or run.damage):
        notes.append("no digest: an older version recorded it, and damage to its descriptions would not show")
    return Verification(
        log=str(log),
        seconds=duration_ns(run) * 1e-9,
        compared=agreed.compared,
        events=events,
        identical=not agreed.first and not parts,
        deviation=agreed.deviation,
        elsewhere=tuple(elsewhere),
        faults=tuple(faults),
        notes=tuple(notes),
        opened=openings.recorded if parts else None,
        statistics=tuple(parts),
        user_notes=_user_notes(log),
    )


def _by_checksums(log: Path, run: Run) -> Verification:
    """The result for a window, whose state at the begin is not recorded, or a measurement: by checksums alone."""
    begin, end = run.begin_ns * 1e-9, duration_ns(run) * 1e-9
    why = (
        f"a window of a run, t = {begin:.3f} to {end:.3f} s, recorded by a trigger: {run.window}",
        f"not checked: a simulation starts at t = 0, and the file lacks what happened before t = {begin:.3f} s. "
        "Only a recording of the whole run can be simulated again: rig live record without --trigger",
    )
    if run.measured:
        why = (
            f"a measurement of {end:g} s, {counted(len(run.measurements), 'channel')}, from "
            f"{run.provenance.get('files', '')}",
            "there is no rig in it that could be simulated",
        )
    return Verification(
        log=str(log),
        seconds=end - begin,
        compared=0,
        events=0,
        identical=False,
        deviation=0.0,
        elsewhere=(),
        faults=(run.damage,) if run.damage else (),
        notes=(
            why[0],
            *(["checked: the checksums prove every byte of the file"] if run.sealed else []),
            why[1],
        ),
        simulated=False,
        user_notes=_user_notes(log),
    )


def _user_notes(log: Path) -> tuple[str, ...]:
    """The notes on a recording; why they cannot be read, if so: they never decide about the recording."""
    try:
        return tuple(map(str, user_notes.read(log).entries))
    except LogError as fault:
        return (str(fault),)


def _statistics(run: Run, again: Run, opened: float) -> tuple[list[str], list[str]]:
    """Statistics compared from the first opening `opened` [s] on, and those that do not agree."""
    end = float(min(run.time[-1], again.time[-1]))
    if end - opened < SHORTEST:
        return [f"{end - opened:.3g} s are too few for statistics ({SHORTEST:g} s are needed): not compared"], []
    both = list(compared(run, again, opened, end))
    return list(map(str, both)), [f"does not agree: {statistic}" for statistic in both if not statistic.agrees]


def _gaps(run: Run, again: Run) -> Iterator[str]:
    """Faults for samples that a sensor published and commands that took effect, but that are not in the file."""
    lost = run.summary.get("lost")
    for way, count in (lost if isinstance(lost, dict) else {}).items():
        if way.startswith("applied/") and way.endswith(" to recorder"):
            name = way.removeprefix("applied/").removesuffix(" to recorder")
            were = "was" if count == 1 else "were"
            messages = counted(count, "message")
            yield f"{messages} of the commands of {name} {were} lost on the way: the run cannot be repeated"
    for name in sorted(run.commands.keys() - again.commands.keys()):
        yield f"the commands of {name} are recorded, but not that it was admitted: the run cannot be repeated"
    for name, (t_ns, _) in run.measurements.items():
        if name not in again.measurements:
            continue
        expected = again.measurements[name].t_ns
        if run.window and t_ns.size:  # its end cuts the blocks of each sensor at another instant
            expected = expected[expected <= t_ns[-1]]
        missing = expected.size - t_ns.size
        if missing > 0:
            yield f"{counted(missing, 'sample')} of {name} {_are(missing)} missing"
        elif missing:
            ended = again.summary["ended"]
            yield f"{counted(-missing, 'sample')} of {name} are more than the re-simulation has, which ended: {ended}"
    t_ns = np.rint(run.time * 1e9).astype(np.int64)
    history_ns = history_end(run)
    old = t_ns <= history_ns  # outputs of a history may be farther apart than those that were simulated after it
    rows = _missing_rows(t_ns[old]) + _missing_rows(t_ns[~old], history_ns if old.any() else None)
    for name, v in run.signals.items():
        if name not in again.signals:
            continue
        if missing := rows + int(np.count_nonzero(np.isnan(v) & ~np.isnan(_at(again, name, run.time)))):
            yield f"{counted(missing, 'sample')} of the output {name} {_are(missing)} missing"


def _network(run: Run, again: Run) -> Iterator[str]:
    """Impaired links of measurements of which the recording counts other messages than the re-simulation.

    In a re-simulation no controller works, so the links of commands carry nothing.
    """
    for topic, counts in run.summary.get("network", {}).items():
        here = again.summary.get("network", {}).get(topic)
        if topic.startswith("meas/") and counts != here:
            yield f"the summary counts {counts} on the link {topic}, the re-simulation {here}"


def _missing_rows(t_ns: Integers, before: int | None = None) -> int:
    """Number of instants at which no output was recorded: they are recorded at even distances.

    `before` [ns]: the instant before the first one; without it the first one is 0.
    """
    if t_ns.size < 2:
        return 0
    step = int(np.median(np.diff(t_ns)))
    gaps = np.diff(t_ns, prepend=-step if before is None else before)
    return int(np.sum(np.rint(gaps / step).astype(np.int64) - 1)) if step else 0


def _at(run: Run, name: str, time: Reals) -> Reals:
    """Values of an output at instants that `run` has; NaN at others."""
    rows = np.minimum(np.searchsorted(run.time, time - 0.5e-9), run.time.size - 1)
    return np.where(np.abs(run.time[rows] - time) < 0.5e-9, run.signals[name][rows], np.nan)


def _are(number: int) -> str:
    return "is" if number == 1 else "are"
