"""Commands that ask for another matrix, in a paced run.

The resistance of a shunt, or the frequency of dither, is a coefficient: no state can be commanded in its place, and a
new value is a new rig (`rig.bench.variant`), for which no frame has time. So it is built in another thread, one at a
time, and a command takes effect once its rig is there. A controller that sends new values faster than rigs can be
built gets the newest that is built; what took effect, and when, is recorded as of any other command.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from rig.bench.journal import Journal
from rig.bench.stand import Stand
from rig.bench.variant import Build, Wanted
from rig.errors import RigError


class Refit:
    """Builds what commands to the actuators of `stand` ask for; a value that has no rig is told, and not taken."""

    def __init__(self, stand: Stand, journal: Journal) -> None:
        self._stand, self._journal = stand, journal
        self._faulty: dict[str, float] = {}
        self._build: Build | None = None
        self._drive, self._value = "", 0.0

    @property
    def done(self) -> bool:
        """Whether something was built that `possible` has not been asked for since."""
        return self._build is not None and self._build.done

    @property
    def builds(self) -> bool:
        """Whether something is being built, or was built and not asked for."""
        return self._build is not None

    def possible(self, drives: Sequence[str], values: Sequence[float]) -> tuple[float, ...]:
        """Values as they can be in force at this tick: where another rig is needed, of the newest one that is there."""
        rebuilds = self._stand.rebuilds
        return tuple([self._newest(d, v) if rebuilds(d, v) else v for d, v in zip(drives, values)])

    def _newest(self, drive: str, value: float) -> float:
        stand, build, now = self._stand, self._build, float(self._stand.values[drive])
        taken = None
        if build is not None and build.done and self._drive == drive:
            self._build = None
            try:
                if stand.keep(build.result()):
                    taken, now = build.result(), self._value
            except RigError as fault:
                self._faulty[drive] = self._value
                self._journal.repeated("refused", f"{drive} = {self._value:g} is commanded, and cannot be: {fault}")
        if self._build is None and value != now and self._faulty.get(drive) != value:
            self._drive, self._value = drive, value
            self._build = Build(partial(stand.variant, Wanted({drive: value}), taken), apart=True)
        return now
