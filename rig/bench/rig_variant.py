"""The same rig otherwise: with other parameters, or with a command state for an actuator that did not need one before.

A command acts by writing a state. An actuator that a scene leaves alone has none: its value is a coefficient, and a new
value is a new matrix. So the rig is built anew once, with that state, when somebody first drives the actuator. Building
takes tens of milliseconds, which a paced run does not have between two frames: it builds in another thread and goes on
with what was built at one tick, which the recording tells.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeVar

from pydantic import ValidationError

from rig.errors import SceneError
from rig.model.assembly import Assembly
from rig.motion.ready import Ready
from rig.placement import anywhere
from rig.scenes.faults import lines
from rig.scenes.scene import Scene
from rig.scheduling import stand_back

T = TypeVar("T")


class Wanted(NamedTuple):
    """What a rig is to have: other values of parameters, and actuators with a command state."""

    parameters: Mapping[str, Any] = {}
    driven: Sequence[str] = ()

    def __bool__(self) -> bool:
        return bool(self.parameters or self.driven)


@dataclass(frozen=True)
class Variant:
    """A rig that was made from `before`, ready to go on with (`rig.bench.runner.Stand.take`)."""

    before: Scene
    wanted: Wanted
    scene: Scene
    assembly: Assembly
    ready: Ready


def with_values(section: Any, changes: Mapping[str, Any]) -> Any:
    """A section with values of dotted keys changed, checked as a whole. Raises SceneError with every fault."""
    raw = section.model_dump()
    for key, value in changes.items():
        at = raw
        *path, last = key.split(".")
        for part in path:
            at = at.get(part) if isinstance(at, dict) else None
        if not isinstance(at, dict) or last not in at:
            raise SceneError(key, ["is no parameter of this rig"])
        at[last] = value
    try:
        return type(section).model_validate(raw)
    except ValidationError as error:
        raise SceneError(", ".join(changes), [line for _, line in lines(error, type(section), raw)]) from None


class Build(Generic[T]):
    """What is being built by `make`: at once, or `apart`, in a thread that never competes with the plant."""

    def __init__(self, make: Callable[[], T], apart: bool) -> None:
        self._make, self._done = make, threading.Event()
        self._made: T | None = None
        self._fault: Exception | None = None
        if apart:
            threading.Thread(target=self._run, args=(True,), name="variant", daemon=True).start()
        else:
            self._run(False)

    @property
    def done(self) -> bool:
        """Whether it is built, or cannot be."""
        return self._done.is_set()

    def result(self) -> T:
        """What was built. Raises what kept it from that."""
        if self._made is None:
            raise self._fault or RuntimeError("it is still being built")
        return self._made

    def _run(self, apart: bool) -> None:
        try:
            if apart:
                anywhere()
                stand_back(0)  # no lower: it holds the interpreter's lock now and then, which the plant waits for
            self._made = self._make()
        except Exception as fault:
            self._fault = fault
        self._done.set()
