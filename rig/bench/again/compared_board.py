"""Asks a board that is present for the steps of a recording again, and compares its commands with the recorded ones."""

from __future__ import annotations

from collections.abc import Mapping

from rig.bench.run.command_queue import AS_SENT
from rig.bench.run.simulate import Recorded, simulate
from rig.controllers.blocks.base import Values
from rig.controllers.device import DeviceController
from rig.errors import ControllerFailed, DeviceError
from rig.printable import counted
from rig.record.run import Run
from rig.scenes.scene import Scene


class _Compared(DeviceController):
    """The controller on the board, with the `recorded` commands by the time of their step [ns].

    It compares up to the first step that the recording has no command for: whether the law has advanced then is not
    known.
    """

    recorded: Mapping[int, Values]
    compared = 0
    """Number of equal commands."""
    differs = ""
    """What the first other ones are."""

    def update(self, state: bool, t_ns: int, values: Values) -> tuple[bool, Values]:
        """See `DeviceController.update`."""
        recorded = self.recorded.get(t_ns)
        if recorded is None:
            self.recorded = {}
            return state, ()
        state, commands = super().update(state, t_ns, values)
        self.compared += 1
        if commands != recorded:
            self.recorded = {}
            self.differs = f"{', '.join(map(repr, commands))} instead of {', '.join(map(repr, recorded))}"
            self.differs += f" at t = {t_ns * 1e-9:.9g} s"
        return state, commands


def compared(run: Run, scene: Scene, name: str, tick: int) -> tuple[str, str]:
    """Kind and text of the event about the steps of `run` before `tick`; empty if the board is not present."""
    commands = run.commands[name]
    sent = commands.status == AS_SENT
    times = (commands.answered[sent] * run.frame_ns).tolist()
    asked = _Compared(scene.controllers[name], {})
    asked.run = "waits"
    asked.recorded = dict(zip(times, map(tuple, commands.values[sent].tolist())))
    recorded = Recorded(run.commands, run.events, measured=run.measurements)
    try:
        simulate(scene, {name: asked}, tick * run.frame_ns, recorded, audited=False)
    except (ControllerFailed, DeviceError):
        return "", ""
    if asked.differs:
        return "warning", f"the board of {name} gives other commands than the recording: {asked.differs}"
    return "log", f"the board of {name} gives {counted(asked.compared, 'recorded command')} again"
