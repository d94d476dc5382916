"""The rigs that the protocol and operators wait for in a paced run: built in another thread, in the order of arrival.

A rig is built from the rig as it is. If anybody changes that one meanwhile, the build is of no use and begins again. So
only who has waited longest builds, and the others wait for their turn. Commands of controllers (`rig.bench.rebuild`),
which ask for new rigs again and again, wait until nobody else does. Otherwise these would starve each other. The
protocol still takes a rig that is at hand at its tick: the steps of an experiment are exact where they can be.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from rig.bench.rig_variant import Build, Variant, Wanted
from rig.errors import RigError

if TYPE_CHECKING:
    from rig.bench.runner import PlantRunner


class Builds:
    """Builds rigs for those who wait, one after the other; `stand` keeps them."""

    def __init__(self, runner: PlantRunner) -> None:
        self.apart = False
        """Whether rigs are built in another thread; otherwise nobody waits."""
        self._runner = runner
        self._order: dict[object, None] = {}
        """Who waits, in the order of arrival."""
        self._build: Build[list[Variant]] | None = None
        """For the first of them."""

    @property
    def awaited(self) -> bool:
        """Whether somebody waits: nobody else should change the rig."""
        return bool(self._order)

    def join(self, who: object) -> None:
        """`who` waits from now on, behind those who wait already."""
        self._order.setdefault(who)

    def leave(self, who: object) -> None:
        """`who` waits no longer."""
        if self._is_first(who):
            self._build = None
        self._order.pop(who, None)

    def ready(self, who: object, wanted: Callable[[], Sequence[Wanted]], later: Iterable[Wanted] = ()) -> bool:
        """Whether the rigs are at hand that `who` needs one after the other; who has to wait asks again.

        `later`: what is likely to be needed after them, and built with them. Raises RigError if a rig cannot be, and
        whatever `wanted` raises; then `who` waits no longer.
        """
        new = who not in self._order
        self.join(who)
        try:
            ready = self._ready(wanted, later) if self._is_first(who) else new and self._runner.has(wanted())
        except Exception:
            self.leave(who)
            raise
        if ready:
            self.leave(who)
        return ready

    def _is_first(self, who: object) -> bool:
        return who is next(iter(self._order), None)

    def _ready(self, wanted: Callable[[], Sequence[Wanted]], later: Iterable[Wanted]) -> bool:
        while self._build is None or self._build.done:
            build, self._build = self._build, None
            for variant in build.result() if build is not None else ():
                self._runner.keep(variant)
            if self._runner.has(needed := wanted()):
                return True
            self._build = Build(partial(self._made, needed, tuple(later)), self.apart)
        return False

    def _made(self, needed: Sequence[Wanted], later: Iterable[Wanted]) -> list[Variant]:
        found = self._runner.variants(needed)
        try:
            for one in later:
                found.append(self._runner.variant(one, found[-1] if found else None))
        except RigError:  # it is told when it is needed
            pass
        return found
