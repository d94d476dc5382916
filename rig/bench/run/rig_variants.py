"""The variants of the rig of a run: builds them, and keeps those that are not used yet.

Variants of a rig: with other parameters, or with a command state for an actuator that had none.

A command acts by writing a state. An actuator that no part of the scene drives has no such state: its value is a
coefficient, and a new value needs a new matrix. So when a controller first drives this actuator, the rig is built again
with a command state. Building takes tens of milliseconds, which a paced run does not have between two frames. It builds
in another thread and changes to the variant at one tick, which is recorded.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, NamedTuple, TypeVar

from pydantic import ValidationError

from rig.errors import SceneError
from rig.machine.scheduling import anywhere, stand_back
from rig.model.assembly import Assembly
from rig.motion.motion import Motion
from rig.motion.ready import Ready
from rig.scenes.faults import lines
from rig.scenes.scene import Scene

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


class RigVariants:
    """Variants of the rig of `scene`, which `motion` carries with the outputs `outputs`."""

    def __init__(self, scene: Scene, motion: Motion, outputs: Sequence[str]) -> None:
        self.scene = scene
        """The scene of the present rig."""
        self._motion, self._outputs = motion, outputs
        self.kept: list[RigVariant] = []
        """Variants that are built and not used yet."""

    def build(self, wanted: Wanted, after: RigVariant | None = None) -> RigVariant:
        """Build the variant `wanted` of the present rig or, with `after`, of a variant that is not used yet.

        Another thread may build it during the run. Raises SceneError with all faulty values by their keys, or for a rig
        with which this run cannot continue.
        """
        before = self.scene if after is None else after.scene
        for known in self.kept:
            if known.before is before and known.wanted == wanted:
                return known
        scene = replace(
            before,
            parameters=with_values(before.parameters, wanted.parameters) if wanted.parameters else before.parameters,
            driven=before.driven.union(wanted.driven),
        )
        assembly = scene.assemble()
        rows = {name: output.row for name, output in assembly.outputs.items()}
        try:
            ready = self._motion.ready(assembly.system(), [rows.get(name, {}) for name in self._outputs])
        except ValueError as error:
            raise SceneError(", ".join([*wanted.parameters, *wanted.driven]), [str(error)]) from None
        return RigVariant(before, wanted, scene, assembly, ready)

    def build_all(self, wanted: Iterable[Wanted]) -> list[RigVariant]:
        """Build these variants one after the other, each from the previous one. Raises as `build`."""
        found: list[RigVariant] = []
        for one in wanted:
            found.append(self.build(one, found[-1] if found else None))
        return found

    def has(self, wanted: Iterable[Wanted]) -> bool:
        """Whether all these variants are already built."""
        at = self.scene
        for one in wanted:
            known = next((k for k in self.kept if k.before is at and k.wanted == one), None)
            if known is None:
                return False
            at = known.scene
        return True

    def keep(self, variant: RigVariant) -> None:
        """Keep a variant, so that `build` returns it without building."""
        self.kept.append(variant)

    def forget(self) -> None:
        """Drop the kept variants: they were made from a rig that is no longer the present one."""
        self.kept.clear()

    def use(self, variant: RigVariant) -> None:
        """Make this variant the present rig; kept variants of the former rig cannot be used any more."""
        assert variant.before is self.scene
        self.scene = variant.scene
        self.kept = [one for one in self.kept if one.before is not variant.before]
