"""Builds the rigs for which the protocol and operators wait in a paced run, in another thread, in order of arrival.

A variant is built from the present rig. If the rig changes meanwhile, the variant is useless and must be built again.
Therefore only one request is built at a time, that of the longest waiting requester. Commands of controllers
(`rig.bench.rebuild`), which request new rigs again and again, wait until no other request waits; otherwise requests
would make each other start again for ever. A protocol step whose rig is already built takes it at its tick, so that the
times of an experiment are exact whenever possible.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from rig.bench.rig_variant import Build, RigVariant, Wanted
from rig.errors import RigError

if TYPE_CHECKING:
    from rig.bench.runner import PlantRunner


class Builds:
    """Builds rigs for requesters in order of arrival; `runner` keeps the rigs."""

    def __init__(self, runner: PlantRunner) -> None:
        self.apart = False
        """Whether rigs are built in another thread; otherwise they are built at once and nobody waits."""
        self._runner = runner
        self._order: dict[object, None] = {}
        """Requesters that wait, in order of arrival."""
        self._build: Build[list[RigVariant]] | None = None
        """The build for the first requester."""

    @property
    def awaited(self) -> bool:
        """Whether a requester waits. Then no other caller should change the rig."""
        return bool(self._order)

    def join(self, who: object) -> None:
        """Append requester `who` to the queue."""
        self._order.setdefault(who)

    def leave(self, who: object) -> None:
        """Remove requester `who` from the queue."""
        if self._is_first(who):
            self._build = None
        self._order.pop(who, None)

    def ready(self, who: object, wanted: Callable[[], Sequence[Wanted]], later: Iterable[Wanted] = ()) -> bool:
        """Whether the rigs that `who` needs, one after the other, are built. If not, `who` waits and asks again.

        `later`: rigs that are probably needed next and are built with them. Raises RigError if a rig cannot be built,
        and whatever `wanted` raises; then `who` no longer waits.
        """
        new = who not in self._order
        self.join(who)
        try:
            ready = self._ready(wanted, later) if self._is_first(who) else new and self._runner.variants.has(wanted())
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
                self._runner.variants.keep(variant)
            if self._runner.variants.has(needed := wanted()):
                return True
            self._build = Build(partial(self._made, needed, tuple(later)), self.apart)
        return False

    def _made(self, needed: Sequence[Wanted], later: Iterable[Wanted]) -> list[RigVariant]:
        found = self._runner.variants.build_all(needed)
        try:
            for one in later:
                found.append(self._runner.variants.build(one, found[-1] if found else None))
        except RigError:  # reported when the rig is needed
            pass
        return found
