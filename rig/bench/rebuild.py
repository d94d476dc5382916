"""Commands that ask for another matrix, in a paced run.

The resistance of a shunt, or the frequency of dither, is a coefficient: no state can be commanded in its place, and a
new value is a new rig (`rig.bench.rig_variant`), for which no frame has time. So it is built in another thread, one at
a time, and a command takes effect once its rig is there. Building holds the interpreter, piece by piece: it makes some
frames late, so that no more than one rig is begun in `PAUSE_S`. A controller that sends new values faster gets the
newest that is built; what took effect, and when, is recorded as of any other command. While the protocol or an operator
waits for a rig, none is begun or taken here: theirs would fit no more.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Sequence
from functools import partial

from rig.bench.background_builds import Builds
from rig.bench.journal import Journal
from rig.bench.rig_variant import Build, Variant, Wanted
from rig.bench.runner import PlantRunner
from rig.errors import RigError

PAUSE_S = 0.5
"""Least time between the begins of two builds. # chosen: each makes one or two frames of 1 ms late, on two cores"""


class Refit:
    """Builds what commands to the actuators of `stand` ask for; a value that has no rig is told, and not taken."""

    def __init__(self, runner: PlantRunner, journal: Journal, builds: Builds) -> None:
        self._runner, self._journal, self._builds = runner, journal, builds
        self._faulty: dict[str, float] = {}
        self._build: Build[Variant] | None = None
        self._drive, self._value = "", 0.0
        self._due = 0.0
        """When the next build may begin [s on the monotonic clock]."""

    @property
    def done(self) -> bool:
        """Whether `possible` may give something else than when it was asked last."""
        if self._builds.awaited:
            return False
        return self._build.done if self._build is not None else time.monotonic() >= self._due

    def possible(self, drives: Sequence[str], values: Sequence[float]) -> tuple[float, ...]:
        """Values as they can be in force at this tick: where another rig is needed, of the newest one that is there."""
        needed = [self._runner.rebuilds(drive, value) for drive, value in zip(drives, values)]
        if self._build is not None and self._build.done and self._drive not in itertools.compress(drives, needed):
            self._build = None  # nobody wants it any more
        return tuple([self._newest(d, v) if rebuilds else v for d, v, rebuilds in zip(drives, values, needed)])

    def _newest(self, drive: str, value: float) -> float:
        runner, build, now = self._runner, self._build, float(self._runner.values[drive])
        if self._builds.awaited:
            return now
        taken = None
        if build is not None and build.done and self._drive == drive:
            self._build = None
            try:
                if build.result().before is runner.scene:
                    taken, now = build.result(), self._value
                    runner.keep(taken)
            except RigError as fault:
                self._faulty[drive] = self._value
                self._journal.repeated("refused", f"{drive} = {self._value:g} is commanded, and cannot be: {fault}")
        wanted = value != now and self._faulty.get(drive) != value
        if wanted and self._build is None and time.monotonic() >= self._due:
            self._due = time.monotonic() + PAUSE_S
            self._drive, self._value = drive, value
            self._build = Build(partial(runner.variant, Wanted({drive: value}), taken), apart=True)
        return now
