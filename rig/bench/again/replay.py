"""Plays a recording back on the bus, with controllers as processes that receive it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace as changed
from pathlib import Path
from typing import Any

from rig import bus, controllers, design
from rig.bus.run_setup import Setup
from rig.controllers.blocks.base import Controller, is_elsewhere, retune
from rig.controllers.runtime.file import load_file
from rig.errors import BusError, LogError, UsageError
from rig.machine.process import Child, end
from rig.record import replay as recorded
from rig.record.recorded_setup import head, setup_of
from rig.record.replay_report import Replayed
from rig.scenes.scene import Scene
from rig.structure import model_store

JOIN_S = 30.0  # longest wait of a process for the replay [s]; as in a run
LEAVE_S = 3.0  # time in which the processes must leave after the replay [s]; as in a run
ENDING_S = 0.3  # longest wait for the exit code of a process that has left the bus


def replay(
    log: Path,
    into: Sequence[str] = (),
    pace: float | None = None,
    changes: Mapping[str, object] | None = None,
    report: Callable[[str], object] = lambda _: None,
) -> Replayed:
    """Replay `log` on the bus; start the controllers `into` and compare their commands with the recorded ones.

    `into`: names of controllers of the scene, or Python files; the commands of a file are compared with those of the
    recorded controller of the same name. `pace`: simulated time over wall time; None: as fast as the controllers
    answer. `changes`: values of these controllers, as "controllers.NAME.KEY".

    Raises UsageError for a name that is not in the recording and for a change that cannot be made, Untrusted for code
    that is not trusted, BusError if a controller does not join, leaves or does not answer.
    """
    setup = setup_of(head(log))
    names = {Path(given).stem if given.endswith(".py") else given: given for given in into}
    if len(names) < len(into):
        raise UsageError(f"--into {', '.join(into)}: two controllers have the same name")
    wanted = _by_controller(changes or {}, names)
    taking_part: dict[str, Controller] = {}
    described: dict[str, Any] = {}
    for name, given in names.items():
        if given.endswith(".py"):
            taking_part[name] = _of_file(given, name, setup)
            if name in wanted:
                retune(taking_part[name], wanted[name])  # refused before anything is started
        else:
            if name in wanted:
                described[name] = _described(setup, name, wanted[name])
            taking_part[name] = controllers.restored(described.get(name) or _recorded(setup, name))
            if is_elsewhere(taking_part[name]):
                raise UsageError(
                    f"--into {name}: it ran on a board, whose law advances with every step that it answers"
                )
    initial = {name: values for name, values in wanted.items() if name not in described}
    with bus.host(scene="replay") as session:
        report(f"run {session.run}")
        processes = _Processes(session.run, names)
        try:
            return recorded.replay(
                session,
                log,
                taking_part,
                pace,
                JOIN_S,
                lambda seconds: report(f"t {seconds:.1f} s"),
                processes=processes,
                described=described,
                initial=initial,
            )
        except BusError as fault:
            for child in processes.children.values():
                child.wait(ENDING_S)
            raise BusError("\n".join([str(fault), *processes.ended()])) from None
        finally:
            session.close()
            end(processes.children.values(), LEAVE_S)


def _recorded(setup: Setup, name: str) -> Any:
    """The recorded description of a controller."""
    if not setup.controllers.get(name):
        known = ", ".join(controller for controller, description in setup.controllers.items() if description) or "none"
        raise UsageError(
            f"the recording describes no controller {name}; it has: {known}. The name of a Python file must end in .py"
        )
    return setup.controllers[name]


def _of_file(path: str, name: str, setup: Setup) -> Controller:
    """The controller of a file. Raises UsageError if it cannot take the place of the recorded one of its name."""
    made = load_file(path)
    if missing := [sensor for sensor in made.reads if sensor not in setup.sensors]:
        raise UsageError(f"{path} reads {', '.join(missing)}; the recorded sensors are {', '.join(setup.sensors)}")
    if made.period_ns % setup.frame_ns:
        raise UsageError(f"{path} has a period of {made.period_ns} ns; the recording has frames of {setup.frame_ns} ns")
    if description := setup.controllers.get(name):
        drives = controllers.restored(description).drives
        if made.drives != drives:
            raise UsageError(
                f"{path} drives {', '.join(made.drives)}, the recorded {name} drives {', '.join(drives)}: "
                "their commands cannot be compared"
            )
    return made


def _by_controller(changes: Mapping[str, object], names: Mapping[str, str]) -> dict[str, dict[str, object]]:
    """Controller -> changes of its parameters. Raises UsageError for a key of anything else."""
    by_controller: dict[str, dict[str, object]] = {}
    for key, value in changes.items():
        room, _, rest = key.partition(".")
        name, _, inner = rest.partition(".")
        if room != "controllers" or name not in names or not inner:
            known = ", ".join(f"controllers.{controller}.KEY" for controller in names) or "none without --into"
            raise UsageError(
                f"-p {key}: the plant is recorded; a replay can change values of the controllers of --into: {known}"
            )
        by_controller.setdefault(name, {})[inner] = value
    return by_controller


def _described(setup: Setup, name: str, changes: Mapping[str, object]) -> dict[str, Any]:
    """The description of a recorded controller with other values, after a new design step."""
    if not setup.scene:
        raise LogError("the recording has lost its scene: values of its controllers cannot be changed")
    section: Any = retune(controllers.restored(_recorded(setup, name)), changes).section  # type: ignore[attr-defined]
    for model in setup.models:
        model_store.offer(model)
    scene = Scene.from_json(setup.scene)
    numbers = design.numbers(changed(scene, controllers={**scene.controllers, name: section}))[name]
    return controllers.described(section, numbers)


class _Processes:
    """The processes of the controllers `files`: name -> name in the scene or Python file."""

    def __init__(self, run: str, files: Mapping[str, str]) -> None:
        self._run = run
        self._files = files
        self.children: dict[str, Child] = {}

    def start(self, name: str) -> None:
        """See `Processes.start`."""
        if (before := self.children.pop(name, None)) is not None:
            end([before], 0.0)
        joining = ["--run", self._run, "--wait", str(JOIN_S)]
        arguments = ["rig.controllers.runtime.process", self._files[name], *joining]
        self.children[name] = Child(f"controller {name}", arguments)

    def ended(self) -> list[str]:
        """See `Processes.ended`."""
        return [child.ending for child in self.children.values() if child.code is not None]
