"""PathSim: an ODE block with RKDP54, a zero crossing and a scope that samples."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from rig.qualify.cost.peers.oscillator import SAMPLES, Array, Oscillator

NAME, PACKAGE = "PathSim", "pathsim"


def ladder() -> Iterator[tuple[str, float]]:
    """Yield the settings (method, rtol)."""
    return (("RKDP54", 10.0**-p) for p in range(4, 10))


def prepare(o: Oscillator, setting: tuple[str, float]) -> Callable[[], list[float]]:
    """Return a function that runs once. PathSim integrates stick as well: it cannot use a closed form."""
    from pathsim import Connection, Simulation
    from pathsim.blocks import ODE, Scope
    from pathsim.events import ZeroCrossing
    from pathsim.solvers import RKDP54

    rtol, a = setting[1], o.acceleration()

    def run() -> list[float]:
        times: list[float] = []
        stuck = [True]

        def rate(y: Array, u: Array, t: float) -> Array:
            return np.array([o.speed, 0.0] if stuck[0] else [y[1], a(y[0], y[1])])

        body = ODE(rate, np.array([o.x, o.speed]))
        scope = Scope(sampling_period=SAMPLES)

        def guard(t: float) -> float:
            x, v = body.engine.state
            return float(
                o.release - x if stuck[0] else o.speed - v + (1e-9 if v >= o.speed and t < times[-1] + 1e-6 else 0.0)
            )

        def change(t: float) -> None:
            times.append(t)
            x, _ = body.engine.state
            body.engine.state = np.array([o.release if stuck[0] else x, o.speed])
            stuck[0] = not stuck[0]

        event = ZeroCrossing(func_evt=guard, func_act=change, tolerance=1e-2 * rtol)
        world = Simulation([body, scope], [Connection(body, scope)], [event], dt=SAMPLES, dt_max=1e-2, Solver=RKDP54,
                           tolerance_lte_rel=rtol, tolerance_lte_abs=1e-3 * rtol, log=False)  # fmt: skip
        world.run(o.seconds)
        return times

    return run
