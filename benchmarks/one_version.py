"""The time that one version of the project needs for each of `CASES`, run as a file by benchmarks.against.

PYTHONPATH begins with the checkout of that version. Therefore this file uses nothing that an older version to be
compared does not have, under its name of today or of version 0.1. A line with the name of a case comes in; processor
time [s] of one round and a digest of its result go out.
"""

from __future__ import annotations

import hashlib
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from importlib import import_module
from inspect import signature
from types import MappingProxyType
from typing import Any, NamedTuple


class Case(NamedTuple):
    """`calls` in a round, each over `length` ticks of a motion, or without a `method` frames of a whole run."""

    scene: str
    method: str
    length: int
    calls: int
    options: Mapping[str, Any] = MappingProxyType({})


CASES = {
    "exact, bare": Case("belt_c", "exact", 5000, 300, {"with_energy": False}),
    "exact": Case("belt_c", "exact", 5000, 100),
    "exact, stiff shunt, bare": Case("belt_shunt", "exact", 1000, 300, {"with_energy": False}),
    "exact, stiff shunt": Case("belt_shunt", "exact", 1000, 150),
    "exact, many states, bare": Case("brake", "exact", 1000, 40, {"with_energy": False}),
    "exact, many states": Case("brake", "exact", 1000, 20),
    "dopri5, bare": Case("pendulum", "dopri5", 1000, 300, {"with_energy": False, "tolerance": 1e-6}),
    "dopri5": Case("pendulum", "dopri5", 1000, 100, {"tolerance": 1e-6}),
    "dopri5, products, bare": Case("disc_slider", "dopri5", 300, 10, {"with_energy": False, "tolerance": 1e-7}),
    "dopri5, products": Case("disc_slider", "dopri5", 300, 6, {"tolerance": 1e-7}),
    "dopri5, dither": Case("belt_dither", "dopri5", 300, 60),
    "rk4, bare": Case("pendulum", "rk4", 1000, 100, {"with_energy": False, "substeps": 10}),
    "rk4": Case("pendulum", "rk4", 1000, 60, {"substeps": 10}),
    "rk4, constant friction, bare": Case("belt_c", "rk4", 1000, 100, {"with_energy": False, "substeps": 10}),
    "film, 96 points": Case("plate_96", "kick", 4000, 1, {"substeps": 5}),
    "run pendulum": Case("pendulum", "", 1000, 6),
    "run belt": Case("belt", "", 1000, 10),
    "run brake_3400": Case("brake_3400", "", 100, 2),
    "run disc_slider": Case("disc_slider", "", 100, 1),
    "run plate": Case("plate", "", 10, 1),
    "run tread": Case("tread", "", 100, 6),
    "run pin": Case("pin", "", 500, 20),
}


def first(*names: str) -> Any:
    """Return the first of "module:class" that this version has: its name of today, or the one of version 0.1."""
    for module, _, wanted in (name.partition(":") for name in names):
        with suppress(ModuleNotFoundError):
            return getattr(import_module(module), wanted)
    raise ModuleNotFoundError(" or ".join(names))


def kernel(case: Case) -> Callable[[], Any]:
    """Return a function that advances a motion and returns it."""
    from rig.scenes import load

    made, scene, options = first("rig.motion.motion:Motion", "rig.solve.motion:Motion"), load(case.scene), case.options
    if "with_energy" not in signature(made).parameters:  # version 0.1
        options = {"booking" if key == "with_energy" else key: value for key, value in options.items()}
    motion = made(scene.assemble().system(), scene.step_ns, case.method, cap=100_000, **options)
    motion.advance(case.length)

    def call() -> Any:
        motion.advance(case.length)
        return motion

    return call


def whole(case: Case) -> Callable[[], Any]:
    """Return a function that advances a plant runner by frames and returns its motion."""
    from rig.scenes import load

    made = first("rig.bench.run.runner:PlantRunner", "rig.bench.runner:PlantRunner", "rig.bench.stand:Stand")
    runner = made(load(case.scene), truthful=True)

    def call() -> Any:
        end = runner.tick + case.length
        while runner.tick < end:
            runner.frames(end - runner.tick)
        return runner.motion

    return call


def main() -> None:
    """Answer each line until the input ends."""
    ready: dict[str, Callable[[], Any]] = {}
    for line in sys.stdin:
        case = CASES[line.strip()]
        if line not in ready:
            ready[line] = kernel(case) if case.method else whole(case)
            ready[line]()
        begin = time.process_time()
        for _ in range(case.calls):
            motion = ready[line]()
        spent = time.process_time() - begin
        at = hashlib.sha256(motion.x.tobytes()).hexdigest()[:12]
        sys.stdout.write(f"{spent!r} {at}.{motion.counts()['events']}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
