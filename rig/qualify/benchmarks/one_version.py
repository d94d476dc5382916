"""The time that one version of the project needs for each of `CASES`, run as a file by rig.qualify.benchmarks.against.

PYTHONPATH begins with the checkout of that version. Therefore this file uses nothing that an older version to be
compared does not have, under its name of today or of version 0.1. A line with the name of a case comes in; processor
time [s] of one round and a digest of its result go out.
"""

from __future__ import annotations

import hashlib
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from inspect import signature
from typing import Any

CASES: dict[str, tuple[str, str, int, int, dict[str, Any]]] = {
    "exact, bare": ("belt_c", "exact", 5000, 300, {"with_energy": False}),
    "exact": ("belt_c", "exact", 5000, 100, {}),
    "exact, stiff shunt, bare": ("belt_shunt", "exact", 1000, 300, {"with_energy": False}),
    "exact, stiff shunt": ("belt_shunt", "exact", 1000, 150, {}),
    "exact, many states, bare": ("brake", "exact", 1000, 40, {"with_energy": False}),
    "exact, many states": ("brake", "exact", 1000, 20, {}),
    "dopri5, bare": ("pendulum", "dopri5", 1000, 300, {"with_energy": False, "tolerance": 1e-6}),
    "dopri5": ("pendulum", "dopri5", 1000, 100, {"tolerance": 1e-6}),
    "dopri5, products, bare": ("disc_slider", "dopri5", 300, 10, {"with_energy": False}),
    "dopri5, products": ("disc_slider", "dopri5", 300, 6, {}),
    "dopri5, dither": ("belt_dither", "dopri5", 300, 60, {}),
    "rk4, bare": ("pendulum", "rk4", 1000, 100, {"with_energy": False, "substeps": 10}),
    "rk4": ("pendulum", "rk4", 1000, 60, {"substeps": 10}),
    "rk4, constant friction, bare": ("belt_c", "rk4", 1000, 100, {"with_energy": False, "substeps": 10}),
    "run pendulum": ("pendulum", "", 1000, 6, {}),
    "run belt": ("belt", "", 1000, 10, {}),
    "run brake_3400": ("brake_3400", "", 100, 2, {}),
    "run disc_slider": ("disc_slider", "", 100, 1, {}),
    "run points": ("points", "", 10, 1, {}),
    "run tread": ("tread", "", 100, 6, {}),
    "run pin": ("pin", "", 500, 20, {}),
}
"""Scene, method ("": the whole run, plant and sensors), ticks or frames of a call, calls in a round, options."""


def first(*names: str) -> Any:
    """Return the first of "module:class" that this version has: its name of today, or the one of version 0.1."""
    for module, _, wanted in (name.partition(":") for name in names):
        with suppress(ModuleNotFoundError):
            return getattr(import_module(module), wanted)
    raise ModuleNotFoundError(" or ".join(names))


def kernel(name: str, method: str, ticks: int, options: dict[str, Any]) -> Callable[[], Any]:
    """Return a function that advances a motion and returns it."""
    from rig.scenes import load

    made, scene = first("rig.motion.motion:Motion", "rig.solve.motion:Motion"), load(name)
    if "with_energy" not in signature(made).parameters:  # version 0.1
        options = {"booking" if key == "with_energy" else key: value for key, value in options.items()}
    motion = made(scene.assemble().system(), scene.step_ns, method, cap=100_000, **options)
    motion.advance(ticks)

    def call() -> Any:
        motion.advance(ticks)
        return motion

    return call


def whole(name: str, frames: int) -> Callable[[], Any]:
    """Return a function that advances a plant runner by `frames` frames and returns its motion."""
    from rig.scenes import load

    runner = first("rig.bench.run.runner:PlantRunner", "rig.bench.runner:PlantRunner", "rig.bench.stand:Stand")(
        load(name), truthful=True
    )

    def call() -> Any:
        end = runner.tick + frames
        while runner.tick < end:
            runner.frames(end - runner.tick)
        return runner.motion

    return call


def main() -> None:
    """Answer each line until the input ends."""
    ready: dict[str, Callable[[], Any]] = {}
    for line in sys.stdin:
        scene, method, count, calls, options = CASES[line.strip()]
        if line not in ready:
            ready[line] = kernel(scene, method, count, options) if method else whole(scene, count)
            ready[line]()
        begin = time.process_time()
        for _ in range(calls):
            motion = ready[line]()
        spent = time.process_time() - begin
        at = hashlib.sha256(motion.x.tobytes()).hexdigest()[:12]
        sys.stdout.write(f"{spent!r} {at}.{motion.counts()['events']}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
