"""diffrax on the processor, compiled: Tsit5 with an event located by Newton's method, one compiled call per slip."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import numpy as np

from rig.qualify.cost.peers.oscillator import SAMPLES, Array, Oscillator

NAME, PACKAGE = "diffrax", "diffrax"
_LONGEST = 400  # most samples in a slip


def ladder() -> Iterator[tuple[str, float]]:
    """Yield the settings (method, rtol)."""
    return (("Tsit5", 10.0**-p) for p in range(4, 13))


def prepare(o: Oscillator, setting: tuple[str, float]) -> Callable[[], list[float]]:
    """Return a function that runs once."""
    import jax.numpy as jnp

    compiled = _compiled(o)
    rtol = setting[1]

    def slip(t: float, x: float, v: float, samples: Array) -> tuple[float, float] | None:
        ended, y, _, met = compiled(t, jnp.array([x, v]), rtol)
        return (float(ended), float(np.asarray(y)[0])) if bool(met) else None

    return lambda: o.run(slip)


@cache
def _compiled(o: Oscillator) -> Any:
    """A slip, compiled once for all tolerances."""
    import diffrax
    import jax
    import jax.numpy as jnp
    import optimistix

    jax.config.update("jax_enable_x64", True)

    def rate(t, y, args):  # type: ignore[no-untyped-def]
        mu = o.kinetic + (
            (o.static - o.kinetic) * jnp.exp(jnp.minimum((y[1] - o.speed) / o.scale, 1.0)) if o.scale else 0.0
        )
        return jnp.stack([y[1], (mu * o.load - o.stiffness * y[0] - o.damping * y[1]) / o.mass])

    def sticks(t, y, args, **_):  # type: ignore[no-untyped-def]
        return o.speed - y[1]

    event = diffrax.Event(sticks, optimistix.Newton(1e-12, 1e-12), direction=False)
    term, solver = diffrax.ODETerm(rate), diffrax.Tsit5()

    @jax.jit
    def slip_of(t, y, rtol):  # type: ignore[no-untyped-def]
        end = t + _LONGEST * SAMPLES
        first = jnp.floor(t / SAMPLES) + 1.0
        grid = jnp.minimum((first + jnp.arange(_LONGEST)) * SAMPLES, end)
        keep = diffrax.SaveAt(subs=[diffrax.SubSaveAt(ts=grid), diffrax.SubSaveAt(t1=True)])
        steps = diffrax.PIDController(rtol=rtol, atol=1e-3 * rtol)
        s = diffrax.diffeqsolve(term, solver, t, end, None, y, saveat=keep, stepsize_controller=steps, event=event,
                                max_steps=100_000)  # fmt: skip
        return s.ts[1][0], s.ys[1][0], s.ys[0], s.event_mask

    return slip_of
