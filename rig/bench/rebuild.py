"""Commands of controllers that need another matrix, in a paced run.

The resistance of a shunt or the frequency of dither is a coefficient of a matrix, not a state: a new value needs a new
rig (`rig.bench.rig_variant`), and no frame has time to build it. Rigs are built in another thread, one at a time, and a
command takes effect when its rig is ready. Building holds the interpreter lock at times and makes some frames late, so
at most one build begins in `PAUSE_S`. If a controller sends new values faster, the newest value with a rig takes
effect; value and tick are recorded like those of any other command. While the protocol or an operator waits for a rig,
none is built or used here, because their rig would not fit any more.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Sequence
from functools import partial

from rig.bench.background_builds import Builds
from rig.bench.journal import Journal
from rig.bench.rig_variant import Build, RigVariant, Wanted
from rig.bench.runner import PlantRunner
from rig.errors import RigError

PAUSE_S = 0.5
"""Least time between the starts of two builds. # chosen: each makes one or two frames of 1 ms late, on two cores"""


class Rebuild:
    """Builds the rigs for commands to actuators of `runner`; a value without a valid rig is reported and ignored."""

    def __init__(self, runner: PlantRunner, journal: Journal, builds: Builds) -> None:
        self._runner, self._journal, self._builds = runner, journal, builds
        self._faulty: dict[str, float] = {}
        self._build: Build[RigVariant] | None = None
        self._drive, self._value = "", 0.0
        self._due = 0.0
        """Earliest time of the next build [s on the monotonic clock]."""

    @property
    def done(self) -> bool:
        """Whether `possible` may return something else than in its last call."""
        if self._builds.awaited:
            return False
        return self._build.done if self._build is not None else time.monotonic() >= self._due

    @property
    def building(self) -> bool:
        """Whether a rig is being built."""
        return self._build is not None and not self._build.done

    def possible(self, drives: Sequence[str], values: Sequence[float]) -> tuple[float, ...]:
        """The values that can be in force at this tick: if another rig is needed, the value of the newest one built."""
        needed = [self._runner.rebuilds(drive, value) for drive, value in zip(drives, values)]
        if self._build is not None and self._build.done and self._drive not in itertools.compress(drives, needed):
            self._build = None  # no longer needed
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
                    runner.variants.keep(taken)
            except RigError as fault:
                self._faulty[drive] = self._value
                self._journal.repeated("refused", f"{drive} = {self._value:g} is commanded, and cannot be: {fault}")
        wanted = value != now and self._faulty.get(drive) != value
        if wanted and self._build is None and time.monotonic() >= self._due:
            self._due = time.monotonic() + PAUSE_S
            self._drive, self._value = drive, value
            self._build = Build(partial(runner.variants.build, Wanted({drive: value}), taken), apart=True)
        return now
