"""A mass on a belt, set PEND of Kroeger et al. (2008), written by hand and independent of the rig's own solver.

m x'' + d x' + c x = F_N mu(|v_b - x'|) sgn(v_b - x'), Runge-Kutta at 50 us, stick and its ends found by bisection.
"""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from rig.compiled.kernel import kernel

PEND = SimpleNamespace(m=5.0, c=2500.0, d=2.0, F0=20.0, v0=0.06, mu_s=0.5, mu_d=0.18, v_s=0.05)


@kernel
def _rate(x, v, vb, side, command, force, lag):
    """Of (x, v, vb): slip on one side of the belt speed, or stick (side 0)."""
    dvb = (command - vb) / lag if lag > 0.0 else 0.0
    if side == 0:
        return vb, dvb, dvb
    slip = side * (vb - v)
    mu = 0.18 + 0.32 * math.exp(-slip / 0.05)
    return v, (side * mu * force - 2.0 * v - 2500.0 * x) / 5.0, dvb


@kernel
def _stepped(x, v, vb, side, command, force, lag, h):
    a1, b1, c1 = _rate(x, v, vb, side, command, force, lag)
    a2, b2, c2 = _rate(x + h / 2 * a1, v + h / 2 * b1, vb + h / 2 * c1, side, command, force, lag)
    a3, b3, c3 = _rate(x + h / 2 * a2, v + h / 2 * b2, vb + h / 2 * c2, side, command, force, lag)
    a4, b4, c4 = _rate(x + h * a3, v + h * b3, vb + h * c3, side, command, force, lag)
    return (
        x + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4),
        v + h / 6 * (b1 + 2 * b2 + 2 * b3 + b4),
        vb + h / 6 * (c1 + 2 * c2 + 2 * c3 + c4),
    )


@kernel
def _need(x, v, vb, command, lag):
    """Friction force required to stick."""
    return 5.0 * ((command - vb) / lag if lag > 0.0 else 0.0) + 2.0 * vb + 2500.0 * x


@kernel
def _guard(x, v, vb, side, command, force, lag):
    """Above zero while the mode holds."""
    if side == 0:
        return 0.5 * force - abs(_need(x, v, vb, command, lag))
    return side * (vb - v)


@kernel
def advance(x, v, vb, side, command, force, lag, time):
    """The belt after `time` [s] with commands held; side = -1, 1 slip, 0 stick. Also the acceleration at the end."""
    if lag <= 0.0:
        if command != v:  # a jump of the belt ends stick, and may turn the slip about
            side = 1 if command > v else -1
        vb = command
    if side == 0 and _guard(x, v, vb, 0, command, force, lag) < 0.0:
        side = 1 if _need(x, v, vb, command, lag) > 0.0 else -1
    left = time
    for _ in range(2000):
        if left <= 0.0:
            break
        h = min(left, 5e-5)
        nx, nv, nb = _stepped(x, v, vb, side, command, force, lag, h)
        if _guard(nx, nv, nb, side, command, force, lag) < 0.0:
            low, high = 0.0, h
            for _ in range(50):
                middle = 0.5 * (low + high)
                px, pv, pb = _stepped(x, v, vb, side, command, force, lag, middle)
                if _guard(px, pv, pb, side, command, force, lag) < 0.0:
                    high = middle
                else:
                    low = middle
            x, v, vb = _stepped(x, v, vb, side, command, force, lag, high)
            left -= high
            need = _need(x, v, vb, command, lag)
            if side != 0:
                v = vb
                side = 0 if abs(need) <= 0.5 * force else (1 if need > 0.0 else -1)
            else:
                side = 1 if need > 0.0 else -1
            continue
        x, v, vb = nx, nv, nb
        if side == 0:
            v = vb
        left -= h
    _, a, _ = _rate(x, v, vb, side, command, force, lag)
    return x, v, vb, side, a


@kernel
def shaken(x, v, side, speed, amplitude, frequency, start, time):
    """The belt shaken by a generator: its speed in steps of 20 us about `speed`."""
    n = round(time / 2e-5)
    vb, a = speed, 0.0
    for i in range(n):
        vb = speed + amplitude * math.sin(2.0 * math.pi * frequency * (start + (i + 0.5) * 2e-5))
        x, v, vb, side, a = advance(x, v, vb, side, vb, 20.0, 0.0, 2e-5)
    return x, v, vb, side, a


class Belt:
    """The belt with its sensors' truth: displacement, velocity, acceleration."""

    def __init__(self, lag=0.0):
        self.x, self.v, self.vb, self.side, self.a = 0.0, PEND.v0, PEND.v0, 0, 0.0
        self.lag = lag

    def advance(self, force, command, time=1e-3):
        self.x, self.v, self.vb, self.side, self.a = advance(
            self.x, self.v, self.vb, self.side, command, max(force, 0.0), self.lag, time
        )

    def shake(self, speed, amplitude, frequency, t, time=1e-3):
        """Advance from time t with the belt shaken about `speed`."""
        self.x, self.v, self.vb, self.side, self.a = shaken(
            self.x, self.v, self.side, speed, amplitude, frequency, t, time
        )


def closed_loop(controller, drive, seconds=20.0, delay=0, lag=0.0, sense=lambda belt: (belt.v,), belt=None):
    """Velocity at every ms of a run under a controller that commands "force" or "speed" (as `drive` says)."""
    belt = belt or Belt(lag)
    state = controller.start()
    queue = []
    frame = controller.period_ns
    force, speed = PEND.F0, PEND.v0
    out = np.empty(int(seconds * 1e9) // frame)
    commands = np.empty_like(out)
    for k in range(len(out)):
        out[k] = belt.v
        state, (u, *_) = controller.update(state, k * frame, sense(belt))
        queue.append(u)
        if len(queue) > delay:
            u = queue.pop(0)
            force, speed = (u, speed) if drive == "force" else (force, u)
        commands[k] = u
        belt.advance(force, speed, frame * 1e-9)
    return out, commands


def residual(v, seconds=4.0, dt=1e-3):
    """Half peak-to-peak over the last seconds."""
    last = v[-round(seconds / dt) :]
    return 0.5 * (last.max() - last.min())


def decay(v, on, dt=1e-3):
    """Slope of the logarithm of the positive maxima between 1e-6 and 0.018 m/s, once all are below."""
    k = np.arange(round(on / dt) + 1, len(v) - 1)
    k = k[(v[k] > v[k - 1]) & (v[k] >= v[k + 1]) & (v[k] > 1e-6)]
    loud = np.flatnonzero(v[k] >= 0.018)
    k = k[loud[-1] + 1 :] if len(loud) else k
    return np.polyfit(k * dt, np.log(v[k]), 1)[0]


@pytest.fixture
def twin():
    """The hand-written belt and what is measured on it."""
    return SimpleNamespace(Belt=Belt, closed_loop=closed_loop, residual=residual, decay=decay, PEND=PEND)
