"""Starts, observes and ends the processes of one run: plant, controllers, recorder, viewer.

All start at once, because their imports take as long as the plant's; the others are told the name of the run when it
can be joined. If another process ends unexpectedly, this is reported, the plant continues, and the timing verdict
mentions it. When the plant ends for any reason, all others end within seconds. The first Ctrl-C ends the plant in
order, a second one ends all processes. Only processes started here are ended.

Events of the run are shown as lines (`EventLines`). All lines of the last run are kept for a bug report (`RunLog`): at
most `MOST_KEPT` in the user's state folder.
"""

from __future__ import annotations

import os
import signal
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace as replace_fields
from pathlib import Path
from typing import Any

import platformdirs

from rig import bus
from rig.bench.live.machine_load import MachineLoad
from rig.bench.live.outcome import CALLING, Job, Outcome, Pace, called
from rig.bench.live.status import Live
from rig.bus import address
from rig.bus.port import Receiver, Session
from rig.bus.tickets import Listener
from rig.errors import BusError, ExitCode, Interrupted, LogError, RigError, UsageError
from rig.extras import check
from rig.machine.files import RUNS
from rig.machine.process import Child, end, told_to_stop
from rig.printable import printable
from rig.record.recorded_setup import head, setup_of
from rig.scenes.scene import Scene

_LINE = 400
"""Longest text of an event that is shown."""
ELSEWHERE = frozenset({"step", "overrun", "end", "verdict"})
"""Kinds of events that the live line or the summary shows; all others are shown as lines."""
MOST_SHOWN = 20  # most lines of one call

MOST_KEPT = 2000
"""Most lines that are kept, the latest ones."""
LONGEST = 1000
"""Most characters of a line."""

JOIN_S = 30.0
"""Longest wait of a process for the run, and of the plant for the processes."""
VIEWER = ("viewer", "viewer")
RECORDER = ("recorder", "recorder")
LEAVE_S = 3.0
"""Time [s] in which all processes but the recorder must leave after the plant."""
# Time [s] in which the recorder must finish its file. # chosen: a slow disk takes 100 MB in it
WRITE_S = 120.0
TELL_S = 2.0
"""Time [s] after which it is told that the recorder is waited for."""
# Time [s] after which it is told that the rehearsal waits for a controller. # chosen
SILENT_S = 5.0
PRINTED = 5  # most lines that a process prints which are shown at a time, ten times a second; others are counted


class EventLines:
    """Shows events of a run: `say` gets a line for each."""

    def __init__(self, say: Callable[[str], object]) -> None:
        self._say = say
        self.over = False
        """Whether the plant has announced the end of the run."""

    def show(self, events: Receiver) -> None:
        """Show the events that have arrived."""
        lines: list[str] = []
        for message in events.drain():
            event = message.said
            who = message.topic[6:]  # of the topic's process, whatever the event says
            own = who == "plant"
            self.over = self.over or (own and event.kind == "end")
            if event.kind not in ELSEWHERE and not (self.over and event.kind == "left"):  # all leave at the end
                first = event.text.partition("\n")[0]
                text = "".join(filter(str.isprintable, f"{event.kind[:_LINE]}: {first[:_LINE]}"))
                lines.append(f"{event.t_ns / 1e9:9.3f} s  {'' if own else f'{who}: '}{text}")
        for line in lines[:MOST_SHOWN]:
            self._say(line)
        if len(lines) > MOST_SHOWN:
            self._say(f"            {len(lines) - MOST_SHOWN} more events: rig report shows those that are recorded")


def path() -> Path:
    """The file with the messages of the last run; it may not exist."""
    return platformdirs.user_state_path("friction-rig") / "last_run.log"


class RunLog:
    """Passes the lines of a run on to `say` and keeps them for a file."""

    def __init__(self, say: Callable[[str], object]) -> None:
        self._say = say
        self._lines: deque[str] = deque(maxlen=MOST_KEPT)

    def say(self, text: str) -> None:
        """Show a line, and keep it."""
        self.add(text)
        self._say(text)

    def add(self, text: str) -> None:
        """Keep text without showing it."""
        self._lines.extend(line[:LONGEST] for line in text.splitlines())

    def write(self) -> None:
        """Replace the file of the run before. If the folder cannot be written, only the log is lost."""
        text = "".join(f"{line}\n" for line in self._lines)
        with suppress(OSError):
            path().parent.mkdir(parents=True, exist_ok=True)
            path().write_text(text)


def run(
    scene: Scene,
    *,
    pace: Pace = 1.0,
    lockstep: bool = False,
    duration: float | None = None,
    view: bool = False,
    web: bool = False,
    record: bool = True,
    out: Path | None = None,
    replace: bool = False,
    trigger: Sequence[str] = (),
    name: str | None = None,
    say: Callable[[str], object] | None = None,
    command: Sequence[str] | None = None,
    interrupts: list[str] | None = None,
    begun: Callable[[str], object] = lambda run: None,
    listener: Listener | None = None,
) -> Outcome:
    """Run `scene` as processes; returns when all have ended.

    `pace` None: as fast as the controllers answer; "auto": real time, or the largest pace below it that holds on this
    machine. `out`, which is overwritten only to `replace` it, is the recording. `trigger`: options of `rig live record`
    for windows instead of the whole run. `say` gets lines; without it they go to standard error, under the live line.
    `command`: the command line that the recording states, by default that of this process. `interrupts`: a list that
    is looked at ten times a second; an entry acts as Ctrl-C does, and is its name. `begun` gets the name of the run
    when it can be joined. `listener`: where other hosts reach the run; it starts no controllers that have tickets.
    """
    address.directory()  # on a system without live runs this raises before anything starts
    if record and out is None:
        where = next(existing for existing in (RUNS, *RUNS.parents) if existing.exists())
        if not os.access(where, os.W_OK | os.X_OK):
            raise UsageError(
                f"{RUNS} cannot be written: you may not write to {where.resolve()}; name a file with --out"
            )
    expect = [("controller", controller) for controller in scene.controllers if controller not in scene.in_plant]
    expect += [RECORDER] if record else []
    if view or web:
        check("rerun", "view", "the live view")
        expect += [VIEWER]
    job = Job.at(
        pace,
        scene,
        run=name,
        lockstep=lockstep,
        duration=duration,
        expect=tuple(expect),
        wait=JOIN_S,
        parent=os.getpid(),
        command=tuple(command or sys.argv),
        listener=listener,
    )
    live = Live()
    interrupts = [] if interrupts is None else interrupts
    load = MachineLoad()
    log = RunLog(say or live.say)
    with tempfile.TemporaryDirectory(prefix="friction-rig-") as folder, told_to_stop(interrupts.append):
        team = RunProcesses(Path(folder), job, out, replace, web, log.say, trigger, begun)
        try:
            outcome = replace_fields(team.run(live, interrupts), machine=load.shares())
            log.add(outcome.text())
            return outcome
        except RigError as fault:
            log.add(str(fault))
            raise
        finally:
            live.done()
            end(team.children, 0.0)
            log.write()


class RunProcesses:
    """The processes of one run."""

    def __init__(
        self,
        folder: Path,
        job: Job,
        out: Path | None,
        replace: bool,
        web: bool,
        say: Callable[[str], object],
        trigger: Sequence[str] = (),
        begun: Callable[[str], object] = lambda run: None,
    ) -> None:
        self._trigger = trigger
        self._begun = begun
        self.job = job
        self._out = out
        self._replace = replace
        self._web = web
        self._say = say
        self._calling_file = folder / CALLING
        self._summary: dict[str, Any] = {}  # what the plant told at its end
        self.plant = Child("the plant", ["rig.bench.live.plant_process", str(self._calling_file)], fed=True)
        self.plant.feed(job.to_json())
        self.plant.dismiss()
        self.others: dict[tuple[str, str], Child] = {}
        self.died: list[str] = []
        self.name = ""
        self._recorder: Child | None = None
        self._file = ""  # the file in which the recorder said that it records
        self._recording: dict[str, Any] = {}  # what the recorder told of its finished recording (rig.record.recorder)
        self._asked = 0
        self._events = EventLines(say)
        self._health: dict[str, Any] = {}

    @property
    def children(self) -> list[Child]:
        """All processes."""
        return [*self.others.values(), self.plant]

    def run(self, live: Live, interrupts: list[str]) -> Outcome:
        """Start the other processes, wait for the run, observe until the plant has ended, then end all others."""
        told = False
        away = () if self.job.listener is None else self.job.listener.seats
        for who in self.job.expect:
            if who[0] == "controller" and who[1] in away:
                continue
            self.others[who] = Child(called(*who), self.arguments(*who), fed=True)
        self._recorder = self.others.get(RECORDER)
        while not self.name:
            if self.plant.wait(0.02):
                break
            self._interrupt(interrupts)
            self._hear()
            silent = "" if told else self._silent()
            if silent:
                told = True
                self._say(f"the plant rehearses the run; {silent}. Ctrl-C ends it")
        for child in self.others.values():
            if self.name:
                child.feed(self.name)
            child.dismiss()
        session = self._join()
        if session is not None:
            with session:
                health = session.subscribe("health")
                events = session.subscribe("event/*")
                while not self.plant.wait(0.1):
                    self._interrupt(interrupts)
                    self._events.show(events)
                    self._look(session)
                    self._hear()
                    self._show(health, live)
                self._events.show(events)
        self._hear()
        summary = self._summary  # or why there was no run; empty if the plant died
        begun = "failed" not in summary  # else the others may wait for it still
        recorder = self.others.get(RECORDER)
        rest = [child for child in self.others.values() if child is not recorder]
        killed = end(rest, LEAVE_S if begun else 0.0)
        if recorder is not None:
            if begun:
                self.wait_for_file(recorder, interrupts)
            killed += end([recorder], 0.0)
        self.died += [f"{name} did not end by itself" for name in killed]
        self._hear()
        return self._outcome(summary)

    def wait_for_file(self, recorder: Child, interrupts: list[str]) -> None:
        """Wait until the recorder has finished its file: a slow disk may have much to write."""
        begun = time.monotonic()
        told = False
        while not recorder.wait(0.1):
            waited = time.monotonic() - begun
            if waited >= WRITE_S:
                break
            if waited > TELL_S and not told:
                told = True
                self._say("waiting for the recorder, which finishes its file")
            self._interrupt(interrupts)

    def arguments(self, role: str, name: str) -> list[str]:
        """Module and arguments of the process of this role and name."""
        joining = ["--run", bus.TOLD, "--wait", str(JOIN_S)]
        if role == "controller":
            return ["rig.controllers.runtime.process", name, *joining]
        if role == "recorder":
            out = ["--out", str(self._out)] if self._out else []
            return ["rig", "live", "record", *joining, *out, *(["--force"] if self._replace else []), *self._trigger]
        return ["rig", "view", *joining, *(["--web"] if self._web else [])]

    def _join(self) -> Session | None:
        """Join the run on the bus; None if the plant has already ended."""
        while not self.plant.wait(0.0):
            with suppress(BusError):
                return bus.join(self.name, role="operator", name="supervisor", wait=0.5)
        return None

    def _hear(self) -> None:
        """Take in what the processes tell, and show what they print: that may be a user's code, and is only shown."""
        printing = [child for child in self.children if child is not self._recorder]
        for child in printing:
            for line in child.new_lines(PRINTED):
                self._say(f"{child.name.removeprefix('the ')}: {printable(line)}")
        for kind, value in self.plant.new_words():
            if kind == "run":
                self.name = value
                self._begun(value)
            elif kind == "say":
                self._say(value)
            elif kind == "summary":
                self._summary = value
        for kind, value in self._recorder.new_words() if self._recorder is not None else ():
            if kind == "file":
                self._file = value
            elif kind == "recording":
                self._recording = value

    def _look(self, session: Session) -> None:
        """Report processes that died before the end, and tell the plant not to wait for them."""
        for who, child in list(self.others.items()):
            if child.code is None or self._events.over:
                continue
            self._hear()
            del self.others[who]
            self.died.append(child.ending)
            begun = bool(self._health)  # before, the plant says what it does without it
            self._say(f"{child.ending}; the plant continues" if begun else child.ending)
            with suppress(RigError):  # the plant is ending or busy; it waits for a bounded time only
                session.ask("cmd/plant", {"do": "begin", "without": called(*who)}, timeout=1.0)

    def _show(self, health: Receiver, live: Live) -> None:
        for message in health.drain():
            content = message.said
            self._health = {field.name: getattr(content, field.name) for field in content.DESCRIPTOR.fields}
            self._health["t"] = content.t_ns / 1e9
            live.show(self._health)

    def _interrupt(self, interrupts: list[str]) -> None:
        """The first Ctrl-C ends the plant, the second one all processes."""
        while interrupts:
            name = interrupts.pop()
            if not self.name:  # before the first frame it has nothing to save
                self.plant.send(signal.SIGTERM)
                raise Interrupted(f"stopped by {name} before the first frame{self._called()}")
            if not self._asked:
                self._say("ending the run; press Ctrl-C again to end at once")
                self.plant.send(signal.SIGINT)
            else:
                if self._asked == 1:
                    self._say("ending all processes; the recorder writes what it has; press Ctrl-C again to kill them")
                for child in self.children:
                    child.send(signal.SIGTERM if self._asked == 1 else signal.SIGKILL)
            self._asked += 1

    def _outcome(self, summary: dict[str, Any]) -> Outcome:
        if not summary:
            if not self.name or (self.plant.code or 0) > 0:
                raise UsageError(self.plant.ending + self._called())
            summary = self._obituary()
        if "failed" in summary:
            fault = UsageError(summary["failed"])
            fault.exit_code = ExitCode(summary["exit_code"])
            raise fault
        recorder = self._recorder
        files = [Path(file) for file in self._recording.get("files", [self._file])]
        log = next((str(path) for path in files if self._owns(path)), "")
        account = self._recording.get("text", "")
        why = "" if recorder is None else self._incomplete(recorder, files, summary["seconds"])
        if not why:
            return Outcome(summary, log, account, tuple(self.died))
        died = self.died if account or why in self.died else [*self.died, why]
        return Outcome(summary, log, account, tuple(died)).without_recording(why)

    def _incomplete(self, recorder: Child, files: Sequence[Path], seconds: float) -> str:
        """Why there is no complete recording of the run, which lasted `seconds`; "" if there is one."""
        told = self._recording
        if recorder.code or not told:
            return recorder.ending
        if not told["totals"]:  # it does not know what was sent last
            return "the recorder was told to stop before the run had ended"
        if gone := [path for path in files if not self._owns(path) and (path.is_file() or not path.exists())]:
            return f"{gone[0]} was removed or replaced after it was written"
        if not told["windows"] and told["seconds"] < seconds - 1e-6:
            return f"it ends at t = {told['seconds']:.6g} s, the run at {seconds:.6g} s"
        return ""

    def _called(self) -> str:
        """Which controller the plant was calling in its rehearsal when it ended, as the end of a sentence."""
        name, _ = self._calling()
        return f", while it rehearsed the run and called the controller {name}" if name else ""

    def _silent(self) -> str:
        """Which controller has not answered the rehearsal for `SILENT_S`; "" if none."""
        name, since = self._calling()
        silent = f"the controller {name} has not answered for {SILENT_S:g} s"
        return silent if name and time.time() - since > SILENT_S else ""

    def _calling(self) -> tuple[str, float]:
        """The controller that the rehearsal is calling, "" if none, and since when (time.time)."""
        with suppress(OSError):
            return self._calling_file.read_text().partition("\n")[0], self._calling_file.stat().st_mtime
        return "", 0.0

    def _owns(self, path: Path) -> bool:
        """Whether a file is a recording of this run, and not of another run."""
        with suppress(LogError):
            return path.is_file() and setup_of(head(path)).run == self.name
        return False

    def _obituary(self) -> dict[str, Any]:
        """The summary for a plant that died without publishing one."""
        known = self._health
        ending = self.plant.ending
        within = sorted(Scene.from_json(self.job.scene).in_plant)
        if within:
            ending += f"; it called {', '.join(within)} in its own process"
        return {
            "run": self.name,
            "verdict": "INVALID",
            "reasons": [ending],
            "exit_code": ExitCode.FAILED,
            "ended": "the plant died",
            "fault": ending,
            "mode": "lockstep" if self.job.in_lockstep else "paced",
            "ticks": known.get("tick", 0),
            "seconds": known.get("t", 0.0),
            "wall_seconds": 0.0,
            "timing": {},
            "waiting": {},
            "scheduling": "",
            "memory": "",
            "round_trip": {"max": 0.0},
            "loop": {},
            "lost": {},
            "unknown": [],
            "faults": [],
            "plant": {},
        }
