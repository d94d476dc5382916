"""Starts and ends runs for the page, one at a time, under the supervisor of `rig run`, in a thread of this process.

A run that another terminal started can be followed instead: the page shows it and acts on it as an operator, and it
goes on when the server ends.

A run is `idle` (none yet), `starting` (processes start, kernels compile), `running`, `paused`, `ending` or `ended`.

Other live runs beside the page's own: those that this user has started in other terminals.
"""

from __future__ import annotations

import queue
import shlex
import threading
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rig import bus
from rig.bench.live import supervise
from rig.bench.live.outcome import AUTO, Outcome, Pace
from rig.bus import address
from rig.bus.messages import FINGERPRINT
from rig.bus.topics import Message
from rig.errors import OutputError, RigError, UsageError
from rig.scenes.scene import Scene
from rig.web.follower import Follower
from rig.web.frames import Frame

LINES = 300
"""Number of lines of a run that are kept."""
END_S = 60.0
"""Longest wait for the end of a run when the server ends [s]: the recorder may have much to write."""
COMMANDS = frozenset({"stop", "emergency", "pause", "resume", "step", "knock", "connect", "disconnect"})
_PHASES = {"pause": "paused", "resume": "running", "stop": "ending", "emergency": "ending"}
"""Command -> the phase of the run that begins with it."""


class RunControl:
    """The present run. `changed()` is called whenever `state` changes, `frame`, `news` and `arrived` as by `Follower`.

    `say` gets the lines for the terminal. All methods may be called from any thread.
    """

    def __init__(
        self,
        changed: Callable[[], object],
        frame: Callable[[Frame], object],
        news: Callable[[str, Any], object],
        say: Callable[[str], object] = lambda _: None,
        arrived: Callable[[Sequence[Message]], object] = lambda _: None,
    ) -> None:
        self._changed = changed
        self._frame = frame
        self._news = news
        self._say = say
        self._arrived = arrived
        self._lock = threading.Lock()
        self._idle = threading.Event()
        self._idle.set()
        self._follower: Follower | None = None
        self._interrupts: list[str] = []
        self._lines: deque[str] = deque(maxlen=LINES)
        self._phase = "idle"
        self._number = 0
        self._looked = self._leaving = False
        """Of a run of another terminal: whether its status is known, and whether the page leaves it."""
        self._facts: dict[str, Any] = {}
        # Processes inherit the priority of the thread that starts them: this one has that of the user, and not that of
        # the threads that serve pages, which leave the processor to the run.
        self._orders: queue.SimpleQueue[tuple[Any, ...]] = queue.SimpleQueue()
        threading.Thread(target=self._work, name="supervisor", daemon=True).start()

    @property
    def state(self) -> dict[str, Any]:
        """Phase, number, name and scene of the run; its lines and, when it has ended, its outcome or fault."""
        return {"phase": self._phase, "number": self._number, **self._facts, "lines": list(self._lines)}

    @property
    def active(self) -> bool:
        """Whether a run is going on."""
        return self._phase not in ("idle", "ended")

    @property
    def events(self) -> list[dict[str, Any]]:
        """The latest events of the run."""
        return list(self._follower.events) if self._follower is not None else []

    def start(
        self, scene: Scene, given: str, changes: dict[str, str], pace: Pace = 1.0, duration: float | None = None
    ) -> dict[str, Any]:
        """Start a run of `scene` and return the state. Raises UsageError while another one is going on.

        `given`, `changes`: name or file and changed values, for the command line that the recording states. `pace`,
        `duration` [s]: as for `rig.bench.live.supervise.run`.
        """
        command = ["rig", "run", given]
        for key, value in changes.items():
            command += ["-p", f"{key}={value}"]
        if pace != 1.0:
            command += ["--pace", _as_text(pace)]
        if duration is not None:
            command += ["--duration", repr(duration)]
        with self._lock:
            self._refuse_second()
            self._begin(scene.name, scene.title, pace, shlex.join(command))
            self._idle.clear()
            self._orders.put((scene, pace, duration, command))
        self._changed()
        return self.state

    def follow(self, body: dict[str, Any]) -> dict[str, Any]:
        """Follow the live run `run` of another terminal and return the state. Raises UsageError, BusError."""
        live = address.find(str(body.get("run") or "-"))
        with self._lock:
            self._refuse_second()
            self._begin(live.scene, live.scene, None, "")
            self._facts |= {"run": live.run, "foreign": True}
            self._follow(live.run)
        self._changed()
        return self.state

    def follow_ticket(self, ticket: Path) -> None:
        """Follow a run on another host as its operator, with the ticket in a file. Raises BusError."""
        with bus.join(role="operator", name="page", ticket=ticket) as session:
            run = session.run
        with self._lock:
            self._refuse_second()
            self._begin(run, run, None, "")
            self._facts |= {"run": run, "foreign": True}
            self._follow(run, ticket=ticket)
        self._changed()

    def leave(self, _: dict[str, Any]) -> dict[str, Any]:
        """Stop following a run of another terminal, which continues. Raises UsageError for a run of the page."""
        if not (self.active and self._foreign):
            raise UsageError("no run of another terminal is followed")
        self._leave()
        return self.state

    def others(self, _: dict[str, Any]) -> list[dict[str, Any]]:
        """Of each live run of another terminal: `run`, `scene`, `started` [s since 1970], `why` it cannot be followed.

        The directory of runs is private, so runs of other users are not among them.
        """
        mine = self._facts["run"] if self.active else ""
        why = "another version of friction-rig runs it: follow it with that version's rig view"
        return [
            {"run": r.run, "scene": r.scene, "started": r.started, "why": "" if r.speaks == FINGERPRINT else why}
            for r in address.list_runs()
            if r.run != mine
        ]

    def command(self, body: dict[str, Any]) -> dict[str, Any]:
        """Carry out a command (`COMMANDS`) in the present run, as the operators' commands of the command line do.

        `run` in the body, if given, is the run that the page shows. Raises UsageError without a run and for another
        one, BusError for what the plant refuses.
        """
        self._check(body)
        what = body.get("do")
        if not isinstance(what, str) or what not in COMMANDS:
            raise UsageError(f"{what!r:.80} is not a command; there are: {', '.join(sorted(COMMANDS))}")
        follower = self._follower
        if what in ("stop", "emergency") and not self._foreign and (follower is None or self._phase == "starting"):
            self._interrupt()
            return {}
        if follower is None:
            raise UsageError("the run has not begun yet")
        if what == "stop" and self._phase == "ending":  # the plant no longer answers
            return {}
        try:
            answer = follower.command({key: value for key, value in body.items() if key != "run"})
        except UsageError:
            if what in ("stop", "emergency") and self._phase in ("ending", "ended"):  # it ended meanwhile
                return {}
            raise
        phase = _PHASES.get(what)
        if phase and self._phase in ("running", "paused"):
            self._phase = phase
            self._changed()
        return answer

    def set(self, body: dict[str, Any]) -> dict[str, Any]:
        """Change the value `key` of the present run to `value`, as `rig live tune` does. Raises as `command`."""
        self._check(body)
        if not isinstance(body.get("key"), str) or "value" not in body:
            raise UsageError('expected "key" and "value", e.g. {"key": "load.force", "value": "15 N"}')
        if self._follower is None:
            raise UsageError("the run has not begun yet")
        return self._follower.set(body["key"], body["value"])

    def end(self) -> None:
        """End the present run in order and wait for its end; leave one of another terminal."""
        if self._foreign:
            self._leave()
        for _ in range(2):
            if not self._idle.is_set():
                self._interrupt()
                self._idle.wait(END_S)

    def kill(self) -> None:
        """End all processes of the present run at once, as a second Ctrl-C does."""
        self._interrupt()

    @property
    def _foreign(self) -> bool:
        """Whether another terminal started the present run."""
        return bool(self._facts.get("foreign"))

    def _leave(self) -> None:
        self._leaving = True
        if self._follower is not None:
            self._follower.stop()

    def _refuse_second(self) -> None:
        if self.active:
            what = self._facts["run"] or f"of {self._facts['scene']}"
            how = "stop following it first" if self._foreign else "stop it first, or wait for its end"
            raise UsageError(f"run {what} is active; {how}")

    def _begin(self, scene: str, title: str, pace: Pace, command: str) -> None:
        self._phase = "starting"
        self._number += 1
        self._follower = None
        self._interrupts = []
        self._lines = deque(maxlen=LINES)
        self._looked = self._leaving = False
        self._facts = {"run": "", "scene": scene, "title": title, "pace": pace, "command": command}
        self._facts |= {"fault": "", "outcome": None, "log": "", "foreign": False}
        for kind, nothing in (("setup", None), ("values", []), ("status", None)):  # the new run has none yet
            self._news(kind, nothing)

    def _check(self, body: dict[str, Any]) -> None:
        if not self.active:
            raise UsageError("no run is active; start one first")
        shown = body.get("run")
        if shown and shown != self._facts["run"]:
            present = self._facts["run"] or "starting"
            raise UsageError(
                f"this page shows the run {shown!s:.80}, which has ended; the present run is {present}: reload the page"
            )

    def _interrupt(self) -> None:
        with self._lock:
            if self.active and not self._foreign:
                self._interrupts.append("the page")
                self._phase = "ending"
        self._changed()

    def _work(self) -> None:
        while True:
            self._run(*self._orders.get())
            self._idle.set()

    def _run(self, scene: Scene, pace: Pace, duration: float | None, command: list[str]) -> None:
        try:
            outcome = supervise.run(
                scene,
                pace=pace,
                duration=duration,
                say=self._hear,
                command=command,
                interrupts=self._interrupts,
                begun=self._begun,
            )
            if self._follower is not None:
                self._follower.outlast()
            self._conclude(outcome)
        except RigError as fault:
            self._facts["fault"] = str(fault)
        except OSError as fault:  # of the system, as a full disk
            self._facts["fault"] = str(OutputError(f"the run could not be carried out: {fault}"))
        except Exception as fault:  # a fault of the program: the server goes on, and says it
            self._facts["fault"] = f"the run failed: {type(fault).__name__}: {fault}"
        finally:
            if self._follower is not None:
                self._follower.stop()
            with self._lock:
                self._phase = "ended"
            if self._facts["fault"]:
                self._say(self._facts["fault"])
            self._changed()

    def _conclude(self, outcome: Outcome) -> None:
        self._say(outcome.text())
        summary = outcome.summary
        self._facts["outcome"] = {
            "verdict": summary["verdict"],
            "reasons": list(summary["reasons"]),
            "ended": summary["ended"],
            "fault": summary["fault"],
            "died": list(outcome.died),
            "unrecorded": outcome.unrecorded,
            "exit_code": int(outcome.exit_code),
            "text": outcome.text(),
        }
        self._facts["log"] = Path(outcome.log).name if outcome.log else ""

    def _begun(self, run: str) -> None:
        """The run can be joined; in the thread of the supervisor."""
        self._facts["run"] = run
        self._say(f"run {run}: {self._facts['command']}")
        self._follow(run, trust=True)

    def _hear(self, line: str) -> None:
        """One line of the supervisor, in its thread."""
        self._lines.append(line)
        self._changed()

    def _follow(self, run: str, trust: bool = False, ticket: Path | None = None) -> None:
        number = self._number

        def of_present(call: Callable[..., object]) -> Callable[..., None]:
            def told(*news: Any) -> None:
                if number == self._number:  # else the last words about a run before the present one
                    call(*news)

            return told

        frame = of_present(self._frame)
        news = of_present(self._told)
        arrived = of_present(self._arrived)
        self._follower = Follower(run, frame, news, arrived, trust, ticket)
        self._follower.start()

    def _told(self, kind: str, content: Any) -> None:
        """News of the follower, in its thread."""
        if kind in ("setup", "values", "status"):
            self._news(kind, content)
        before = self._phase
        if kind == "fault":
            self._lines.append(f"the page cannot follow the run: {content}")
            if self._foreign:
                self._facts["fault"] = str(content)
            self._changed()
        elif kind == "setup" and self._foreign:
            self._facts |= {"scene": content["scene"], "title": content["title"]}
            self._changed()
        elif kind == "values" and self._phase == "starting":  # it reads them when the first frame has been computed
            self._phase = "running"
        elif kind == "status" and self._facts["pace"] == AUTO:
            self._facts["pace"] = content["pace"]
            self._changed()
        elif kind == "status" and self._foreign and not self._looked:  # what happened before it was followed
            self._looked = True
            self._facts["pace"] = content["pace"]
            self._phase = "paused" if content["paused"] else self._phase
            self._changed()
        elif kind == "phase" and self._phase in ("running", "paused"):
            self._phase = content
        elif kind == "summary" and self._foreign:
            self._conclude(Outcome(content))
        elif kind == "left" and self._foreign:
            self._left()
        if self._phase != before:
            self._changed()

    def _left(self) -> None:
        """A run of another terminal is no longer followed."""
        with self._lock:
            self._phase = "ended"
        if self._leaving:
            self._lines.append(f"run {self._facts['run']} is no longer followed")
        elif not (self._facts["outcome"] or self._facts["fault"]):
            died = "has ended without a summary: its plant ended unexpectedly; its terminal shows the reason"
            self._facts["fault"] = f"run {self._facts['run']} {died}"


def _as_text(pace: Pace) -> str:
    """The value of the option `--pace`."""
    if pace is None:
        return "max"
    return AUTO if pace == AUTO else f"{pace:g}"
