"""SUNDIALS CVODE by scikit-sundae: Adams and BDF with root finding."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from rig.qualify.cost.peers.oscillator import Array, Oscillator

NAME, PACKAGE = "SUNDIALS", "sksundae"


def ladder() -> Iterator[tuple[str, float]]:
    """Yield the settings (method, rtol)."""
    return ((method, 10.0**-p) for method in ("Adams", "BDF") for p in range(4, 13))


def prepare(o: Oscillator, setting: tuple[str, float]) -> Callable[[], list[float]]:
    """Return a function that runs once."""
    from sksundae.cvode import CVODE

    method, rtol = setting

    a, speed = o.acceleration(), o.speed

    def rate(t: float, y: Array, yp: Array) -> None:
        x, v = y
        yp[0], yp[1] = v, a(x, v)

    def sticks(t: float, y: Array, events: Array) -> None:
        events[0] = speed - y[1]

    sticks.terminal, sticks.direction = [True], [-1]  # type: ignore[attr-defined]
    solver: Any = CVODE(rate, method=method, rtol=rtol, atol=1e-3 * rtol, eventsfn=sticks, num_events=1,
                        max_num_steps=100_000)  # fmt: skip

    def slip(t: float, x: float, v: float, samples: Array) -> tuple[float, float] | None:
        later, x, v = o.begun(x, v)
        samples = samples[np.searchsorted(samples, t + later, side="right") :]
        s = solver.solve(np.concatenate([[t + later], samples]), np.array([x, v]))
        met = s.t_events is not None and s.t_events[-1] == s.t[-1]  # events of all calls so far are kept
        return (float(s.t[-1]), float(s.y[-1][0])) if met else None

    return lambda: o.run(slip)
