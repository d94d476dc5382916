"""Asks a board that is present for the steps of a recording again, and compares its commands with the recorded ones."""

from __future__ import annotations

from typing import Any

from rig import controllers, design
from rig.bench.run.command_queue import AS_SENT
from rig.bench.run.simulate import Recorded, simulate
from rig.controllers.blocks.base import Values
from rig.controllers.device import DeviceController
from rig.errors import ControllerFailed, DeviceError
from rig.printable import counted
from rig.record.run import Run
from rig.scenes.scene import Scene


class _Compared:
    """The controller on the board, with the recorded commands by the time of their step [ns].

    It compares up to the first step that the recording has no command for: whether the law has advanced then is not
    known.
    """

    elsewhere = True

    def __init__(self, board: DeviceController, recorded: dict[int, Values]) -> None:
        self.reads = board.reads
        self.drives = board.drives
        self.period_ns = board.period_ns
        self.compared = 0
        self.differs = ""
        self._board = board
        self._recorded = recorded
        self._over = False

    def start(self) -> bool:
        return self._board.start()

    def update(self, state: bool, t_ns: int, values: Values) -> tuple[bool, Values]:
        recorded = self._recorded.get(t_ns)
        if self._over or recorded is None:
            self._over = True
            return state, ()
        state, commands = self._board.update(state, t_ns, values)
        self.compared += 1
        if commands != recorded:
            self._over = True
            self.differs = f"{', '.join(map(repr, commands))} instead of {', '.join(map(repr, recorded))}"
            self.differs += f" at t = {t_ns * 1e-9:.9g} s"
        return state, commands

    def close(self) -> None:
        self._board.close()


def compared(run: Run, scene: Scene, name: str, tick: int) -> tuple[str, str]:
    """Kind and text of the event about the steps of `run` before `tick`; empty if the board is not present."""
    board: Any = controllers.restored(design.described(scene)[name])
    board.run = "waits"
    commands = run.commands[name]
    sent = commands.status == AS_SENT
    times = (commands.answered[sent] * run.frame_ns).tolist()
    asked = _Compared(board, dict(zip(times, map(tuple, commands.values[sent].tolist()))))
    try:
        board.start()
        recorded = Recorded(run.commands, run.events, measured=run.measurements)
        simulate(scene, {name: asked}, tick * run.frame_ns, recorded, audited=False)
    except (ControllerFailed, DeviceError):
        return "", ""
    finally:
        board.close()
    if asked.differs:
        return "warning", f"the board of {name} gives other commands than the recording: {asked.differs}"
    return "log", f"the board of {name} gives {counted(asked.compared, 'recorded command')} again"
