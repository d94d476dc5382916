"""Starts, observes and ends the processes of one run: plant, controllers, recorder, viewer.

The plant starts first, and the others when its run can be joined. If another process dies, this is reported, the plant
continues, and the timing verdict mentions it. When the plant ends in any way, all others end within seconds. The first
Ctrl-C ends the plant in the orderly way, a second one ends all processes. Only processes started here are ended.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rig import bus
from rig.bench.job import Job
from rig.bench.outcome import Outcome
from rig.bench.status import Live
from rig.bus import address
from rig.bus.port import Receiver, Session
from rig.child_process import Child, end
from rig.errors import BusError, Interrupted, LogError, RigError, UsageError
from rig.process import told_to_stop
from rig.record.message_scan import head
from rig.scenes.scene import Scene

_LINE = 400
"""Longest text of an event that is shown."""
JOIN_S = 30.0
"""Longest wait of a process for the run, and of the plant for the processes."""
VIEWER, RECORDER = ("viewer", "viewer"), ("recorder", "recorder")
LEAVE_S = 3.0
"""Time [s] in which all processes but the recorder must leave after the plant."""
WRITE_S = 20.0
"""Time [s] in which the recorder must finish its file."""
TOLD = frozenset(
    "begin joined left mark timeout parameter knock limit diverged fault never "
    "missing safe back refused flood overruled evicted pause warning".split()
)
"""Kinds of events that are shown during the run."""


def run(
    scene: Scene,
    *,
    pace: float | None = 1.0,
    lockstep: bool = False,
    duration: float | None = None,
    view: bool = False,
    web: bool = False,
    record: bool = True,
    out: Path | None = None,
    replace: bool = False,
    name: str | None = None,
    say: Callable[[str], object] | None = None,
) -> Outcome:
    """Run `scene` as processes; returns when all have ended.

    `pace` None: as fast as the controllers answer. `out`, which is overwritten only to `replace` it, is the recording.
    `say` gets lines; without it they go to standard error, under the live line.
    """
    address.directory()  # on a system without live runs this raises before anything starts
    expect = [("controller", controller) for controller in scene.controllers if controller not in scene.in_plant]
    expect += [RECORDER] if record else []
    expect += [VIEWER] if view or web else []
    job = Job(
        scene.to_json(),
        run=name,
        pace=pace,
        lockstep=lockstep,
        duration=duration,
        expect=tuple(expect),
        wait=JOIN_S,
        parent=os.getpid(),
        command=tuple(sys.argv),
    )
    live, interrupts = Live(), list[str]()
    with tempfile.TemporaryDirectory(prefix="friction-rig-") as folder, told_to_stop(interrupts.append):
        team = Team(Path(folder), job, out, replace, web, say or live.say)
        try:
            return team.run(live, interrupts)
        finally:
            live.done()
            end(team.children, 0.0)


class Team:
    """The processes of one run."""

    def __init__(
        self, folder: Path, job: Job, out: Path | None, replace: bool, web: bool, say: Callable[[str], object]
    ) -> None:
        self.job, self._out, self._replace, self._web, self._say = job, out, replace, web, say
        self._summary = folder / "summary.json"
        description = folder / "job.json"
        description.write_text(job.to_json())
        arguments = ["rig.bench.plant_process", str(description), str(self._summary)]
        self.plant = Child("the plant", arguments)
        self.others: dict[tuple[str, str], Child] = {}
        self.died: list[str] = []
        self.name = ""
        self._recorder: Child | None = None
        self._asked = 0
        self._over = False
        self._health: dict[str, Any] = {}

    @property
    def children(self) -> list[Child]:
        """All processes."""
        return [*self.others.values(), self.plant]

    def run(self, live: Live, interrupts: list[str]) -> Outcome:
        """Wait for the run, start the other processes, observe until the plant has ended, then end all others."""
        while not self.name:
            if self.plant.wait(0.02):
                break
            self._interrupt(interrupts)
            self._hear()
        if self.name:
            self._start()
        session = self._join()
        if session is not None:
            with session:
                health, events = session.subscribe("health"), session.subscribe("event/*")
                while not self.plant.wait(0.1):
                    self._interrupt(interrupts)
                    self._tell(events)
                    self._look(session)
                    self._hear()
                    self._show(health, live)
                self._tell(events)
        begun = self.plant.code != Interrupted.exit_code  # else the others may wait for it still
        recorder = self.others.get(RECORDER)
        rest = [child for child in self.others.values() if child is not recorder]
        killed = end(rest, LEAVE_S if begun else 0.0)
        if recorder is not None:  # it may have much to write to a slow disk
            killed += end([recorder], WRITE_S if begun else 0.0)
        self.died += [f"{name} did not end by itself" for name in killed]
        self._hear()
        return self._outcome()

    def _start(self) -> None:
        for role, name in self.job.expect:
            self.others[role, name] = Child(f"{role} {name}", self._arguments(role, name))
        self._recorder = self.others.get(RECORDER)

    def _arguments(self, role: str, name: str) -> list[str]:
        joining = ["--run", self.name, "--wait", str(JOIN_S)]
        if role == "controller":
            return ["rig.controllers.runtime.process", name, *joining]
        if role == "recorder":
            out = ["--out", str(self._out)] if self._out else []
            return ["rig", "record", *joining, *out, *(["--force"] if self._replace else [])]
        return ["rig", "view", *joining, *(["--web"] if self._web else [])]

    def _join(self) -> Session | None:
        """Join the run on the bus; None if the plant has already ended."""
        while not self.plant.wait(0.0):
            try:
                return bus.join(self.name, role="operator", name="supervisor", wait=0.5)
            except BusError:
                continue
        return None

    def _hear(self) -> None:
        """Show the output of the plant, which names its run, and of the viewer."""
        for text in self.plant.said():
            word, _, rest = text.partition(" ")
            if word == "run" and not self.name:
                self.name = rest
            self._say(text)
        if (viewer := self.others.get(VIEWER)) is not None:
            for text in viewer.said():
                self._say(text)

    def _look(self, session: Session) -> None:
        """Report processes that died before the end, and tell the plant not to wait for them."""
        for who, child in list(self.others.items()):
            if child.code is None or self._over:
                continue
            del self.others[who]
            self.died.append(child.told)
            self._say(f"{child.told}; the plant continues")
            try:
                session.ask("cmd/plant", {"do": "begin", "without": " ".join(who)}, timeout=1.0)
            except RigError:
                pass  # the plant is ending or busy; it waits for a bounded time only

    def _show(self, health: Receiver, live: Live) -> None:
        for message in health.drain():
            told = message.said
            self._health = {field.name: getattr(told, field.name) for field in told.DESCRIPTOR.fields}
            self._health["t"] = told.t_ns / 1e9
            live.show(self._health)

    def _tell(self, events: Receiver) -> None:
        for message in events.drain():
            event, who = message.said, message.topic[6:]  # of the topic's process, whatever the event says
            own = who == "plant"
            self._over = self._over or (own and event.kind == "end")
            if event.kind in TOLD and not (self._over and event.kind == "left"):  # all leave at the end
                text = "".join(filter(str.isprintable, event.text.partition("\n")[0][:_LINE]))
                self._say(f"{event.t_ns / 1e9:9.3f} s  {'' if own else f'{who}: '}{event.kind}: {text}")

    def _interrupt(self, interrupts: list[str]) -> None:
        """The first Ctrl-C ends the plant, the second one all processes."""
        while interrupts:
            name = interrupts.pop()
            if not self.name:  # before the first frame it has nothing to save
                self.plant.send(signal.SIGTERM)
                raise Interrupted(f"stopped by {name} before the first frame")
            if not self._asked:
                self._say("ending the run; once more to end it at once")
                self.plant.send(signal.SIGINT)
            else:
                for child in self.children:
                    child.send(signal.SIGTERM if self._asked == 1 else signal.SIGKILL)
            self._asked += 1

    def _outcome(self) -> Outcome:
        recorder = self._recorder
        said = recorder.tail[-1] if recorder is not None and recorder.tail else ""
        found = (Path(said.partition(": ")[0]), self._out)
        log = next((str(path) for path in found if path is not None and self._owns(path)), "")
        try:
            summary = json.loads(self._summary.read_text())
        except (OSError, ValueError):
            if not self.name or (self.plant.code or 0) > 0:
                raise UsageError(self.plant.told) from None
            summary = self._obituary()
        if "failed" in summary:
            fault = UsageError(summary["failed"])
            fault.exit_code = summary["exit_code"]
            raise fault
        account = said if " messages, " in said else ""  # it tells it when it has finished its file
        if recorder is None or not recorder.code:
            outcome = Outcome(summary, log, said, tuple(self.died))
            if "at the end" in account.rpartition(" messages, ")[2]:  # it does not know what was sent last
                return outcome.without_recording("the recorder was told to stop before the run had ended")
            return outcome
        died = self.died if account or recorder.told in self.died else [*self.died, recorder.told]
        return Outcome(summary, log, account, tuple(died)).without_recording(recorder.told)

    def _owns(self, path: Path) -> bool:
        """Whether a file is a recording of this run, and not of another run."""
        try:
            return path.is_file() and head(path).setup().run == self.name
        except LogError:
            return False

    def _obituary(self) -> dict[str, Any]:
        """The summary for a plant that died without publishing one."""
        known = self._health
        return {
            "run": self.name,
            "verdict": "INVALID",
            "reasons": [self.plant.told],
            "exit_code": 1,
            "ended": "the plant died",
            "fault": self.plant.told,
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
