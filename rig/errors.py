"""The errors of the project, in one tree.

RigError
├── SceneError        a scene, a key or a value that cannot be used; contains every fault found
├── UsageError        a command that cannot be carried out as given
│   ├── PartError     a plant, effect, sensor or controller from a file that cannot be used
│   │   └── Untrusted   code in a recording or a run that the user has not trusted
│   └── DeviceError   a board or its port that cannot be used
├── Interrupted       a command that was interrupted before it was complete
├── Singular          equations of motion of a mode set without a unique solution
├── NumericsError     the integration had to stop; contains time, mode set and state
│   ├── Diverged      the state exceeded the stated limit or is not finite
│   ├── Jammed        no mode set is consistent with the equations (Painleve)
│   └── Chatter       more events in one block than the scene allows
├── ControllerLost    a controller whose compiled code has failed; the run continues without it
├── ControllerFailed  a controller whose Python code raised an exception; contains the run up to there
├── WorkerError       a worker process that ended before its work was done
├── BusError          a connection, a topic or a message that failed
├── LogError          a recording that cannot be read
└── OutputError       a file that cannot be written: a recording, a figure, a table

A user's mistake never ends in a traceback: the commands print `str(error)` and exit with `error.exit_code`, one of
`ExitCode`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from enum import IntEnum
from typing import Any, TypeVar

T = TypeVar("T")

_ADDRESS = re.compile(r"\s*For further information visit https://errors\.pydantic\.dev/\S*")

_SHOWN = 12  # values of a state in a message


class ExitCode(IntEnum):
    """The exit codes of all commands. docs/commands.md lists them for users.

    FAILED       a check failed, a result is not complete, or the machine failed: a full disk, a killed process
    MISTAKE      the command cannot be carried out as given: a wrong option or scene, a recording that cannot be read
    TIMING       the timing verdict is INVALID
    STOPPED      the run diverged or passed a limit, had an emergency stop, or the stability report refuses it
    INTERRUPTED  a signal (Ctrl-C) ended the command before it was done; what it has computed or recorded is kept.
                 What has no end of its own is done when it is stopped: a run of an endless protocol, and a process
                 that follows the run of another one

    If several apply: STOPPED, FAILED, TIMING, INTERRUPTED, in this order.
    """

    DONE = 0
    FAILED = 1
    MISTAKE = 2
    TIMING = 3
    STOPPED = 4
    INTERRUPTED = 130


def kind_and_text(error: BaseException) -> str:
    """Return kind and text of any exception in one line, without the addresses that pydantic adds."""
    kind = type(error).__name__
    try:
        text = " ".join(_ADDRESS.sub("", str(error)).split())
    except Exception:  # of a class of the user, whose text cannot be made
        return kind
    return f"{kind}: {text}" if text else kind


class RigError(Exception):
    """Base of all errors of the project."""

    exit_code = ExitCode.MISTAKE


class SceneError(RigError):
    """A scene that cannot be used; `faults` holds one line for each fault, all found at once. One fault is one line."""

    def __init__(self, where: str, faults: Iterable[str]) -> None:
        self.where = where
        self.faults = tuple(faults)
        if len(self.faults) == 1 and "\n" not in self.faults[0]:
            text = f"{where}: {self.faults[0]}"
        else:
            text = "\n".join([f"{where}:", *(f"  {fault}" for fault in self.faults)])
        super().__init__(text)


class UsageError(RigError):
    """A command that cannot be carried out as given."""


class Faults:
    """Collects what is wrong with what a user asks for, in `found`, so that all of it is reported at once."""

    def __init__(self) -> None:
        self.found: list[str] = []

    def __call__(self, read: Callable[[], T], otherwise: T) -> T:
        """Return what `read` returns; `otherwise` if it raises SceneError or UsageError, which is kept."""
        try:
            return read()
        except (SceneError, UsageError) as error:
            self.found.append(str(error))
            return otherwise

    def raise_found(self) -> None:
        """Raise UsageError if something is wrong."""
        if self.found:
            raise UsageError("\n".join(self.found))


class Interrupted(RigError):
    """A command that was interrupted before it was complete."""

    exit_code = ExitCode.INTERRUPTED


class Singular(RigError):
    """The equations of motion of a mode set have no unique solution, for the reason `why`.

    `jams`: friction cancels the inertia (Painleve).
    """

    exit_code = ExitCode.STOPPED

    def __init__(self, why: str, mode: str, jams: bool = False) -> None:
        self.why = why
        self.mode = mode
        self.jams = jams
        super().__init__(f"{why}\n  in mode set {mode}")


class NumericsError(RigError):
    """The integration had to stop, for the reason `what` (one line).

    `time` [s], `mode` (the mode set in words) and `state` (named values) say where.
    """

    exit_code = ExitCode.STOPPED

    def __init__(self, what: str, time: float, mode: str, state: dict[str, float]) -> None:
        self.what = what
        self.time = time
        self.mode = mode
        self.state = state
        sizes = sorted(state, key=lambda name: abs(state[name]) if state[name] == state[name] else float("inf"))
        large = {*sizes[-_SHOWN:]} if len(state) > _SHOWN else state.keys()
        values = ", ".join(f"{name} = {value:.6g}" for name, value in state.items() if name in large)
        more = f"; and {len(state) - _SHOWN} smaller values" if len(state) > _SHOWN else ""
        super().__init__(f"{what}\n  at t = {time:.9g} s, in mode set {mode}\n  state: {values}{more}")


class Diverged(NumericsError):
    """The state exceeded the stated limit or is not finite."""


class Jammed(NumericsError):
    """No mode set is consistent with the equations."""


class Chatter(NumericsError):
    """More events in one block than the scene allows."""


class ControllerLost(RigError):
    """A controller's compiled code has crashed, hangs, or reports an error; the run continues without it."""

    exit_code = ExitCode.FAILED


class ControllerFailed(RigError):
    """The code of controller `name` raised an exception or ended Python at `t` [s]; `why` says what and where.

    `run`: the run up to there (rig.record.run.Run), if it was one in this process.
    """

    exit_code = ExitCode.FAILED

    def __init__(self, name: str, t: float, why: str) -> None:
        self.name = name
        self.run: Any = None
        super().__init__(f"controller {name} failed at t = {t:.9g} s: {why}")


class WorkerError(RigError):
    """A worker process ended before its work was done."""

    exit_code = ExitCode.FAILED


class BusError(RigError):
    """A connection, a topic or a message that failed."""


class PartError(UsageError):
    """A plant, effect, sensor or controller from a file that cannot be used."""


class Untrusted(PartError):
    """Code in a recording or a run that the user has not trusted."""


class DeviceError(UsageError):
    """A board or its port that cannot be used: absent, taken, without right, silent."""


class LogError(RigError):
    """A recording that cannot be read."""


class OutputError(RigError):
    """A file that cannot be written, e.g. because the disk is full: a recording, a figure, a table."""

    exit_code = ExitCode.FAILED
