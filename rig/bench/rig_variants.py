"""The variants of the rig of a run: builds them, and keeps those that are not used yet."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from rig.bench.rig_variant import RigVariant, Wanted, with_values
from rig.errors import SceneError
from rig.motion.motion import Motion
from rig.scenes.scene import Scene


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
