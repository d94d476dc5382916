"""Variants of a rig: with other parameters, or with a command state for an actuator that had none.

A command acts by writing a state. An actuator that no part of the scene drives has no such state: its value is a
coefficient, and a new value needs a new matrix. So when a controller first drives this actuator, the rig is built again
with a command state. Building takes tens of milliseconds, which a paced run does not have between two frames. It builds
in another thread and changes to the variant at one tick, which is recorded.
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
    """The requested properties of a variant: values of parameters, and actuators that need a command state."""

    parameters: Mapping[str, Any] = {}
    driven: Sequence[str] = ()

    def __bool__(self) -> bool:
        return bool(self.parameters or self.driven)


@dataclass(frozen=True)
class RigVariant:
    """A rig that was made from `before`, ready for the plant runner to continue with."""

    before: Scene
    wanted: Wanted
    scene: Scene
    assembly: Assembly
    ready: Ready


def with_values(section: Any, changes: Mapping[str, Any]) -> Any:
    """A copy of a section with changed values of dotted keys, validated. Raises SceneError with all faults."""
    raw = section.model_dump()
    for key, value in changes.items():
        at = raw
        *path, last = key.split(".")
        for part in path:
            at = at.get(part) if isinstance(at, dict) else None
        if not isinstance(at, dict) or last not in at:
            raise SceneError(key, ["is not a parameter of this rig"])
        at[last] = value
    try:
        return type(section).model_validate(raw)
    except ValidationError as error:
        raise SceneError(", ".join(changes), [line for _, line in lines(error, type(section), raw)]) from None


class Build(Generic[T]):
    """The result of `make()`, computed at once or, with `apart`, in a thread without real-time scheduling."""

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
        """Whether `make` has returned or raised."""
        return self._done.is_set()

    def result(self) -> T:
        """What `make` returned. Raises what it raised."""
        if self._made is None:
            raise self._fault or RuntimeError("it is still being built")
        return self._made

    def _run(self, apart: bool) -> None:
        try:
            if apart:
                anywhere()
                stand_back(0)  # not a lower priority: at times it holds the interpreter lock, for which the plant waits
            self._made = self._make()
        except Exception as fault:
            self._fault = fault
        self._done.set()
