"""Clamps of drives and magnets inside the plant: a third kind of mode, with events of its own."""

import math

import numpy as np
import pytest

from rig.model import friction_law
from rig.model.assembly import Assembly

PEND = {"m": 5.0, "c": 2500.0, "d": 2.0, "F0": 20.0, "v0": 0.06}
LAG = 0.01


def belt_feedback(gain, low, high):
    """v_b' = (min(max(v0 + K x', low), high) - v_b) / lag under a mass with Coulomb friction (Kroeger et al. 4.7)."""
    a = Assembly("belt feedback")
    a.coordinate("x", PEND["m"], PEND["d"], PEND["c"])
    a.signal("speed", {}, PEND["v0"], "drive")
    a.signal("belt", {"belt": -1.0 / LAG}, PEND["v0"], "drive")
    a.limit("drive", {"speed": 1.0, "x'": gain}, low, high, "belt", 1.0 / LAG)
    a.patch("contact", {"x": 1.0}, {"belt": 1.0}, friction_law.coulomb(0.4, 0.25))
    a.normal("load", "contact", {"one": PEND["F0"]})
    a.start |= {"x'": PEND["v0"]}
    return a.system()


def by_scipy(chain, gain, low, high, duration):
    """Modes (side of the slip, clamp); state x, v, v_b."""
    m, c, d, N, v0 = (PEND[k] for k in ("m", "c", "d", "F0", "v0"))
    static, kinetic = 0.4 * N, 0.25 * N

    def asked(y):
        return v0 + gain * y[1]

    def drive(clamp, y):
        return ((asked(y), low, high)[clamp] - y[2]) / LAG

    def need(clamp, y):
        return m * drive(clamp, y) + d * y[1] + c * y[0]

    def rate(mode, t, y):
        side, clamp = mode
        faster = drive(clamp, y)
        if side == 0:
            return [y[1], faster, faster]
        return [y[1], (side * kinetic - d * y[1] - c * y[0]) / m, faster]

    def guards(mode):
        side, clamp = mode
        bounds = [
            [lambda t, y: asked(y) - low, lambda t, y: high - asked(y)],
            [lambda t, y: low - asked(y)],
            [lambda t, y: asked(y) - high],
        ][clamp]
        if side:
            return [lambda t, y: side * (y[2] - y[1]), *bounds]
        return [lambda t, y: static - need(clamp, y), lambda t, y: static + need(clamp, y), *bounds]

    def follow(mode, guard, t, y):
        side, clamp = mode
        contact = 1 if side else 2
        if guard < contact:
            side = 0 if side else (1, -1)[guard]
            y = [y[0], y[2], y[2]] if side == 0 else y
        else:
            clamp = (1, 2)[guard - contact] if clamp == 0 else 0
        return held(side, clamp, y), y

    def held(side, clamp, y):
        """Stick only within the cone: a clamp that begins or ends changes what it needs."""
        if side == 0 and abs(need(clamp, y)) > static:
            side = int(math.copysign(1, need(clamp, y)))
        return side, clamp

    start = [0.0, v0, v0]
    return chain(rate, guards, follow, held(0, 2 if asked(start) > high else 0, start), start, duration)


@pytest.mark.parametrize(("gain", "high"), [(5.33, 0.25), (2.0, 0.15)])
def test_belt_feedback_through_a_limited_drive(run, chain, gain, high):
    """A stuck mass carries away the belt that it commands, until the drive clamps; both ends of the range are met."""
    expected = by_scipy(chain, gain, 0.0, high, 3.0)
    assert len(expected) > 9
    for step in (0.1, 1.0, 5.0):
        found = run(belt_feedback(gain, 0.0, high), step, 3.0)
        assert {"drive clamps high", "drive unclamps"} <= set(found.what)
        assert len(found.times) == len(expected)
        assert found.times == pytest.approx(expected, abs=1e-10)


def test_a_clamp_holds_where_its_input_is_beyond(run):
    """The derivative of the clamped state is that of the limit, in every mode set, to rounding."""
    outputs = [{"speed": 1.0, "x'": 5.33}, {"belt": 1.0}]
    found = run(belt_feedback(5.33, 0.0, 0.25), 0.1, 1.0, outputs=outputs)
    asked, belt = found.outputs.T
    assert 0.0 <= belt.min() < 0.2 < belt.max() <= 0.25
    clamped = asked > 0.25 + 1e-9
    pairs = clamped[1:] & clamped[:-1]
    assert pairs.sum() > 100
    expected = 0.25 + (belt[:-1] - 0.25) * math.exp(-1e-4 / LAG)
    assert belt[1:][pairs] == pytest.approx(expected[pairs], rel=1e-12)


def test_a_ramp_into_a_clamp_stops_at_it_between_ticks(run):
    """A command that runs through the limit is clamped at the instant it does, at any step."""
    for step in (0.1, 7.0):
        a = Assembly("ramp")
        a.coordinate("x", 1.0, 0.5, 100.0)
        a.signal("command", {"one": 0.1}, 0.0, "drive")
        a.signal("actual", {"actual": -1.0 / LAG}, 0.0, "drive")
        a.limit("drive", {"command": 1.0}, -1.0, 0.0333, "actual", 1.0 / LAG)
        a.patch("contact", {"x": 1.0}, {"actual": 1.0}, friction_law.coulomb(0.4, 0.25))
        a.normal("load", "contact", {"one": 1.0})
        found = run(a.system(), step, 0.63)
        clamps = [t for t, what in zip(found.times, found.what) if what == "drive clamps high"]
        assert clamps == pytest.approx([0.333], abs=1e-13)
        assert found.states[-1, -1] == pytest.approx(0.0333, rel=1e-9)
        assert np.all(found.states[:, -1] <= 0.0333 * (1.0 + 1e-12))
