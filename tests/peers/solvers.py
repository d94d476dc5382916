"""The solvers of the comparison. Each is prepared with a problem and a setting, and gives the times of mode changes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from oscillator import SAMPLES, Array, Oscillator

from rig.analysis.cycles.motion_measures import Setting
from rig.motion.motion import Motion
from rig.scenes.scene import Scene

Run = Callable[[], list[float]]
"""A function that runs once and returns the times [s] of mode changes."""
Rung = tuple[str, float]
"""A method with its relative tolerance."""
STEP_NS = 1_000_000
_LONGEST = 400  # most samples in a slip of diffrax


def by_rig(scene: Scene, setting: Setting, seconds: float) -> Run:
    """friction-rig itself: the plant of the scene with one state every millisecond."""
    system = scene.assemble().system()
    ticks = round(seconds * 1e9 / STEP_NS)
    clock = setting.applied(scene).clock
    motion = Motion(
        replace(system),
        STEP_NS,
        setting.method,
        tolerance=clock.tolerance,
        substeps=clock.substeps(STEP_NS),
        with_energy=False,
        longest=ticks,
    )

    def run() -> list[float]:
        motion.x[:] = system.start
        first = motion.tick
        motion.advance(ticks)
        from_tick, events, places = motion.met()
        return ((events[:, 0] + (from_tick - first) + places) * (STEP_NS * 1e-9)).tolist()  # type: ignore[no-any-return]

    return run


def by_scipy(o: Oscillator, setting: Rung) -> Run:
    """scipy.integrate.solve_ivp with a terminal event."""
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
        s = solve_ivp(
            rate, (t, o.seconds), [x, v], method=method, rtol=rtol, atol=1e-3 * rtol, events=sticks, t_eval=samples
        )
        return (float(s.t_events[0][0]), float(s.y_events[0][0][0])) if len(s.t_events[0]) else None

    return lambda: o.run(slip)


def by_sundials(o: Oscillator, setting: Rung) -> Run:
    """SUNDIALS CVODE by scikit-sundae, with root finding."""
    from sksundae.cvode import CVODE

    method, rtol = setting
    a, speed = o.acceleration(), o.speed

    def rate(t: float, y: Array, yp: Array) -> None:
        x, v = y
        yp[0], yp[1] = v, a(x, v)

    def sticks(t: float, y: Array, events: Array) -> None:
        events[0] = speed - y[1]

    sticks.terminal, sticks.direction = [True], [-1]  # type: ignore[attr-defined]
    solver: Any = CVODE(
        rate, method=method, rtol=rtol, atol=1e-3 * rtol, eventsfn=sticks, num_events=1, max_num_steps=100_000
    )

    def slip(t: float, x: float, v: float, samples: Array) -> tuple[float, float] | None:
        later, x, v = o.begun(x, v)
        samples = samples[np.searchsorted(samples, t + later, side="right") :]
        s = solver.solve(np.concatenate([[t + later], samples]), np.array([x, v]))
        met = s.t_events is not None and s.t_events[-1] == s.t[-1]  # events of all calls so far are kept
        return (float(s.t[-1]), float(s.y[-1][0])) if met else None

    return lambda: o.run(slip)


def by_diffrax(o: Oscillator, setting: Rung) -> Run:
    """Diffrax on the processor, compiled, with an event located by Newton's method: one compiled call per slip."""
    import jax.numpy as jnp

    compiled, (_, rtol) = _compiled(o), setting

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
        s = diffrax.diffeqsolve(
            term, solver, t, end, None, y, saveat=keep, stepsize_controller=steps, event=event, max_steps=100_000
        )
        return s.ts[1][0], s.ys[1][0], s.ys[0], s.event_mask

    return slip_of


def by_heyoka(o: Oscillator, setting: Rung) -> Run:
    """Heyoka: Taylor series, compiled at the first run, with a terminal event."""
    import heyoka as hy

    x, v = hy.make_vars("x", "v")
    mu = o.kinetic + ((o.static - o.kinetic) * hy.exp((v - o.speed) / o.scale) if o.scale else 0.0)
    rate = (mu * o.load - o.stiffness * x - o.damping * v) / o.mass
    sticks = hy.t_event(o.speed - v, direction=hy.event_direction.negative)
    solver = hy.taylor_adaptive([(x, v), (v, rate)], [0.0, 0.0], tol=setting[1], t_events=[sticks])

    def slip(t: float, x: float, v: float, samples: Array) -> tuple[float, float] | None:
        later, *state = o.begun(x, v)
        solver.state[:] = state
        solver.time = t + later
        samples = samples[np.searchsorted(samples, solver.time, side="right") :]
        outcome = solver.propagate_grid(np.concatenate([[solver.time], samples]))[0]
        met = int(outcome) == -1  # the first terminal event
        return (float(solver.time), float(solver.state[0])) if met else None

    return lambda: o.run(slip)


def by_pathsim(o: Oscillator, setting: Rung) -> Run:
    """PathSim: an ODE block, a zero crossing and a scope that samples. It integrates stick as well."""
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
        world = Simulation(
            [body, scope],
            [Connection(body, scope)],
            [event],
            dt=SAMPLES,
            dt_max=1e-2,
            Solver=RKDP54,
            tolerance_lte_rel=rtol,
            tolerance_lte_abs=1e-3 * rtol,
            log=False,
        )
        world.run(o.seconds)
        return times

    return run


class Peer(NamedTuple):
    """A solver of others in the Python package `package`."""

    name: str
    package: str
    prepare: Callable[[Oscillator, Rung], Run]
    ladder: tuple[Rung, ...]


def _ladder(methods: Iterable[str], most: int) -> tuple[Rung, ...]:
    """Methods, each at tolerances down to 10 to the power -most."""
    return tuple((method, 10.0**-p) for method in methods for p in range(4, most + 1))


PEERS = (
    Peer("scipy", "scipy", by_scipy, _ladder(("RK45", "DOP853", "LSODA"), 11)),
    Peer("SUNDIALS", "sksundae", by_sundials, _ladder(("Adams", "BDF"), 12)),
    Peer("diffrax", "diffrax", by_diffrax, _ladder(("Tsit5",), 12)),
    Peer("heyoka", "heyoka", by_heyoka, _ladder(("Taylor",), 13)),
    Peer("PathSim", "pathsim", by_pathsim, _ladder(("RKDP54",), 9)),
)
