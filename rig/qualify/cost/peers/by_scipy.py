"""scipy.integrate.solve_ivp: RK45, DOP853, LSODA and Radau with a terminal event."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from rig.qualify.cost.peers.oscillator import Array, Oscillator

NAME, PACKAGE = "scipy", "scipy"
METHODS = ("RK45", "DOP853", "LSODA")


def ladder() -> Iterator[tuple[str, float]]:
    """Yield the settings (method, rtol)."""
    return ((method, 10.0**-p) for method in METHODS for p in range(4, 12))


def prepare(o: Oscillator, setting: tuple[str, float]) -> Callable[[], list[float]]:
    """Return a function that runs once."""
    from scipy.integrate import solve_ivp

    method, rtol = setting

    a, speed = o.acceleration(), o.speed

    def rate(t: float, y: Array) -> list[float]:
        x, v = y
        return [v, a(x, v)]

    def sticks(t: float, y: Array) -> float:
        return speed - y[1]  # type: ignore[no-any-return]

    sticks.terminal, sticks.direction = True, -1  # type: ignore[attr-defined]

    def slip(t: float, x: float, v: float, samples: Array) -> tuple[float, float] | None:
        s = solve_ivp(rate, (t, o.seconds), [x, v], method=method, rtol=rtol, atol=1e-3 * rtol, events=sticks,
                      t_eval=samples)  # fmt: skip
        return (float(s.t_events[0][0]), float(s.y_events[0][0][0])) if len(s.t_events[0]) else None

    return lambda: o.run(slip)
