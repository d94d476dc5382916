"""Actions from outside on an experiment: knocks, and controllers that are connected, admitted or dismissed."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from rig.bench.exchange import Exchange
from rig.bench.journal import OPERATOR, Journal
from rig.bench.rig_variant import Wanted
from rig.bench.runner import PlantRunner
from rig.errors import UsageError
from rig.quantities import finite
from rig.scenes.scene import Scene


class OutsideActions:
    """What an operator may do at the present tick of `runner`; `journal` records it, so that it can be repeated."""

    def __init__(self, scene: Scene, runner: PlantRunner, exchange: Exchange, journal: Journal) -> None:
        self.scene, self.runner, self.exchange, self.journal = scene, runner, exchange, journal

    def knock(self, impulse: float, by: str = OPERATOR, duration_ns: int = 0) -> None:
        """Strike the body at this tick with `impulse` [N s]; with a duration by a half sine of force."""
        try:
            finite(impulse, "N*s")
        except ValueError as fault:
            raise UsageError(f"the body cannot be knocked with an impulse of {impulse:g} N s: it {fault}") from None
        self.runner.knock(impulse, duration_ns)
        within = f" within {duration_ns / 1e9:g} s" if duration_ns else ""
        self.journal.note("knock", f"knock with {impulse:g} N s{within}", by=by, impulse=impulse)

    def switch(self, controller: str, on: bool, by: str = OPERATOR) -> None:
        """Connect or disconnect a controller at this tick."""
        if controller not in self.exchange.queues:
            known = ", ".join(self.exchange.queues) or "none"
            raise UsageError(f"no controller is called {controller:.80}; there are: {known}")
        self.exchange.connect(controller, on)
        word = "connected" if on else "disconnected"
        self.journal.note(word, f"{controller} is {word}", by=by, controller=controller)

    def admission(
        self, controller: str, drives: Sequence[str], period_ns: int, hears: bool = False, gone: Collection[str] = ()
    ) -> list[Wanted]:
        """The rigs that `admit` needs, one after the other. Raises UsageError if this controller cannot be admitted.

        `gone`: controllers that have left, whose actuators it takes.
        """
        if hears and period_ns != self.runner.frame_ns:
            frame = f"{self.runner.frame_ns / 1e6:g} ms"
            raise UsageError(f"{controller:.80} reads every sample, so its period must be one frame, {frame}")
        if controller in self.scene.controllers:
            raise UsageError(f"the scene already has a controller {controller}; give yours another name")
        self.exchange.check(controller, drives, period_ns, gone)
        lacking = self.runner.lacking(drives)
        found = [wanted for other in gone for wanted in self.given_back(other)]
        return [*found, *([Wanted({}, lacking)] if lacking else []), *self.given_back(controller)]

    def given_back(self, controller: str) -> list[Wanted]:
        """The rigs that are needed, one after the other, to disconnect a controller."""
        queue = self.exchange.queues.get(controller)
        back = self.exchange.given_back(queue) if queue is not None else {}
        return [Wanted({drive: value}) for drive, value in back.items() if self.runner.rebuilds(drive, value)]

    def admit(
        self,
        controller: str,
        drives: Sequence[str],
        period_ns: int,
        hears: bool = False,
        gone: Collection[str] = (),
        delay_ns: int = 0,
    ) -> None:
        """Admit a controller that is not in the scene; it drives actuators that no other controller drives.

        `gone`: controllers that have left, whose actuators it takes. `delay_ns`: additional delay of its loop. Raises
        UsageError, and then changes nothing.
        """
        for variant in self.runner.variants.build_all(self.admission(controller, drives, period_ns, hears, gone)):
            self.runner.variants.keep(variant)
        for other in gone:  # from here on nothing can be refused
            self.dismiss(other)
        self.runner.go_on(Wanted({}, self.runner.lacking(drives)))
        if controller in self.exchange.queues:
            self.exchange.dismiss(controller)
        self.exchange.admit(controller, drives, period_ns, delay_ns)
        text = f"{controller} is admitted and drives {', '.join(drives)}"
        data = {"controller": controller, "drives": list(drives), "period_ns": period_ns}
        data |= {"delay_ns": delay_ns} if delay_ns else {}
        self.journal.note("admitted", text, by=OPERATOR, **data)

    def dismiss(self, controller: str) -> None:
        """Remove a controller that was admitted and has left: its actuators return to the values of the protocol."""
        self.exchange.dismiss(controller)
        self.journal.note("dismissed", f"{controller} is dismissed", by=OPERATOR, controller=controller)
