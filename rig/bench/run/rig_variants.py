"""Variants of the rig of a run: with other parameters, or with a command state for an actuator that had none.

A command acts by writing a state. An actuator that no part of the scene drives has no such state: its value is a
coefficient, and a new value needs a new matrix. So when a controller first drives this actuator, the rig is built again
with a command state. `rig.bench.run.builds` says when: building takes longer than a frame of a paced run.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from rig.bench.run.before import refuse_stiff_film
from rig.errors import RigError, SceneError
from rig.model.assembly import Assembly
from rig.motion.motion import Motion
from rig.motion.ready import Ready
from rig.quantities import Section
from rig.scenes.scene import Scene
from rig.scenes.sections import with_values


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


class RigVariants:
    """Variants of the rig of `scene`, which `motion` carries with the outputs `outputs`."""

    def __init__(self, scene: Scene, motion: Motion, outputs: Sequence[str]) -> None:
        self.scene = scene
        """The scene of the present rig."""
        self._begun = scene.parameters
        self._motion = motion
        self._outputs = outputs
        self.kept: list[RigVariant] = []
        """Variants that are built and not used yet."""

    def build(self, wanted: Wanted, after: RigVariant | None = None) -> RigVariant:
        """Build the variant `wanted` of the present rig or, with `after`, of a variant that is not used yet.

        Another thread may build it during the run. Raises SceneError with all faulty values by their keys, or for a rig
        with which this run cannot continue.
        """
        before = self.scene if after is None else after.scene
        if (known := self._known(before, wanted)) is not None:
            return known
        parameters = self._changed(before, wanted.parameters) if wanted.parameters else before.parameters
        scene = replace(before, parameters=parameters, driven=before.driven.union(wanted.driven))
        assembly = scene.assemble()
        system = assembly.system()
        refuse_stiff_film(scene, system)
        rows = {name: output.row for name, output in assembly.outputs.items()}
        try:
            ready = self._motion.ready(system, [rows.get(name, {}) for name in self._outputs])
        except ValueError as error:
            raise SceneError(", ".join([*wanted.parameters, *wanted.driven]), [str(error)]) from None
        return RigVariant(before, wanted, scene, assembly, ready)

    def _changed(self, before: Scene, values: Mapping[str, Any]) -> Section:
        """The parameters of `before` with these values. Raises SceneError for those that a run cannot change to."""
        changed: Section = with_values(before.parameters, values)
        try:
            return changed.continuing(self._begun)
        except ValueError as error:
            raise SceneError(", ".join(values), [str(error)]) from None

    def build_all(self, needed: Sequence[Wanted], later: Iterable[Wanted] = ()) -> list[RigVariant]:
        """Build these variants one after the other, each from the previous one. Raises as `build`.

        `later`: variants that are probably needed next; the first one that cannot be built ends them.
        """
        made: list[RigVariant] = []
        try:
            for wanted in (*needed, *later):
                made.append(self.build(wanted, made[-1] if made else None))
        except RigError:
            if len(made) < len(needed):
                raise
        return made

    def has(self, wanted: Iterable[Wanted]) -> bool:
        """Whether all these variants, each made from the previous one, are already built."""
        at = self.scene
        for each in wanted:
            if (known := self._known(at, each)) is None:
                return False
            at = known.scene
        return True

    def _known(self, before: Scene, wanted: Wanted) -> RigVariant | None:
        return next((known for known in self.kept if known.before is before and known.wanted == wanted), None)

    def keep(self, variants: Iterable[RigVariant]) -> None:
        """Keep those variants that the present rig can become, so that `build` returns them without building."""
        possible = [self.scene, *(known.scene for known in self.kept)]
        for variant in variants:
            if any(variant.before is scene for scene in possible) and all(variant is not known for known in self.kept):
                self.kept.append(variant)
                possible.append(variant.scene)

    def use(self, variant: RigVariant) -> None:
        """Make this variant the present rig; drop kept variants that it cannot become."""
        assert variant.before is self.scene
        self.scene = variant.scene
        kept = self.kept
        self.kept = []
        self.keep(kept)
