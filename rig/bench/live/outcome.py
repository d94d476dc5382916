"""What a plant process is to do, and how a run ended: its job, its summary, its recording, its exit code.

The parent of a plant process passes it a `Job` as a JSON file. An `Outcome` is what is left of a run that has ended.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

from rig.bench.live import status
from rig.bench.live.timing import NOTHING_LOST
from rig.controllers.device import Device, too_slow
from rig.errors import DeviceError, ExitCode, UsageError
from rig.scenes.scene import Scene

if TYPE_CHECKING:
    from rig.bus.tickets import Listener

CALLING = "calling"
"""File beside that of the summary, with the name of the controller that the rehearsal is calling."""
AUTO: Literal["auto"] = "auto"
"""The pace of a run that finds on its machine which one holds: real time, or the largest one below it."""
Pace = float | Literal["auto"] | None
"""The pace that a user asks for: simulated time over wall time, `AUTO`, or None: as fast as the controllers answer."""


def called(role: str, name: str) -> str:
    """Return a process in words: `controller nf`, but `recorder` where role and name are the same."""
    return role if role == name else f"{role} {name}"


@dataclass(frozen=True)
class Job:
    """The settings of one run of the plant. Raises UsageError for a pace that is not positive.

    `scene`: the scene as JSON text (`Scene.to_json`). `pace`: simulated time over wall time; None: lockstep, as fast as
    the controllers answer. `adapts`: whether the run takes a smaller pace where this one does not hold on its machine.
    `duration`: simulated time [s]; by default the duration of the protocol. `expect`: role and
    name of the processes for which the first frame waits. `wait`: longest wait for them [s]. `parent`: id of the parent
    process; this process ends when the parent has ended. 0: none. `command`: the user's command line, for the
    recording. `listener`: where other hosts reach the run; the wait for a controller with a ticket has no limit.
    """

    scene: str
    run: str | None = None
    endpoint: str | None = None
    pace: float | None = 1.0
    lockstep: bool = False
    adapts: bool = False
    duration: float | None = None
    expect: tuple[tuple[str, str], ...] = ()
    wait: float = 20.0
    parent: int = 0
    command: tuple[str, ...] = ()
    listener: Listener | None = None

    def __post_init__(self) -> None:
        if self.pace is not None and self.pace <= 0.0:
            raise UsageError(f"the pace is {self.pace:g}; it must be above zero")

    @property
    def in_lockstep(self) -> bool:
        """Whether each frame waits for the answers of the controllers."""
        return self.lockstep or self.pace is None

    @classmethod
    def at(cls, pace: Pace, scene: Scene, **settings: Any) -> Job:
        """The job of a run of `scene` at the pace that its user asks for."""
        if pace != AUTO:
            return cls(scene.to_json(), pace=pace, **settings)
        return cls(scene.to_json(), pace=min(scene.clock.pace_limit or 1.0, 1.0), adapts=True, **settings)

    def to_json(self) -> str:
        """The job as JSON text."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Job:
        """The job from the JSON text of `to_json`."""
        fields = json.loads(text)
        fields["expect"] = tuple((role, name) for role, name in fields["expect"])
        if fields["listener"] is not None:
            from rig.bus.tickets import Listener  # a run of this process alone needs no bus

            fields["listener"] = Listener(**{**fields["listener"], "seats": tuple(fields["listener"]["seats"])})
        return cls(**{**fields, "command": tuple(fields["command"])})


def keeps_up(scene: Scene, pace: Pace) -> None:
    """Raise UsageError if `pace` exceeds the pace limit that `scene` states or its boards, or one cannot be used."""
    boards = [section for section in scene.controllers.values() if isinstance(section, Device)]
    for section in boards:
        section.address.check()
        fastest = 1.0 if pace == AUTO else pace
        slow = too_slow(section, fastest) if fastest is not None and section.address.has_rate else ""
        if slow:
            raise DeviceError(slow)
    limit = scene.clock.pace_limit
    if pace is not None and pace != AUTO and limit is not None and pace > limit:
        raise UsageError(
            f"{scene.name} cannot run at a pace of {pace:g}: {scene.slow}. What works: rig simulate; "
            f"rig run --lockstep; rig run --pace {limit:g}, or --pace auto where this machine is slower. To try it "
            f"anyway: -p clock.pace_limit={pace:g}"
        )


@dataclass(frozen=True)
class Outcome:
    """The outcome of a run.

    `summary`: the summary that the plant published; if the plant died, what is known. `log`: path of the recording.
    `account`: the recorder's text about the finished recording; empty if it did not finish it. `died`: processes that
    died or had to be killed, in words. `machine`: shares of the processors' time that others took
    (rig.bench.live.pace). `unrecorded`: whether a recording was requested that is missing or incomplete.
    """

    summary: Mapping[str, Any]
    log: str = ""
    account: str = ""
    died: tuple[str, ...] = field(default_factory=tuple)
    machine: Mapping[str, float] = field(default_factory=dict)
    unrecorded: bool = False

    def without_recording(self, why: str) -> Outcome:
        """The same outcome for a run with an incomplete recording: at best DEGRADED; `why` says what is lost."""
        reasons = [reason for reason in self.summary["reasons"] if reason != NOTHING_LOST]
        verdict = "DEGRADED" if self.summary["verdict"] == "VALID" else self.summary["verdict"]
        summary = {**self.summary, "verdict": verdict, "reasons": [*reasons, f"the recording is not complete: {why}"]}
        return replace(self, summary=summary, unrecorded=True)

    @property
    def exit_code(self) -> ExitCode:
        """The exit code of the command."""
        code = ExitCode(self.summary["exit_code"])
        return ExitCode.FAILED if self.unrecorded and code in (ExitCode.DONE, ExitCode.INTERRUPTED) else code

    def to_json(self) -> dict[str, Any]:
        """The outcome as plain values for JSON."""
        return {**self.summary, "log": self.log, "died": list(self.died), "machine": dict(self.machine)}

    def text(self) -> str:
        """The summary as text, with commands to try next."""
        broken = self.unrecorded and not self.account  # a finished file needs no recovery
        commands = ("recover",) if broken else ("report", "verify", "live replay")
        following = [f"rig {command} {self.log}" for command in commands] if self.log else []
        return status.summary(self.to_json(), self.account or self.log, following)
