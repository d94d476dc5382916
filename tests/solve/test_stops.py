"""A run that cannot go on says when, in which mode and in which state; what it has done so far is kept."""

import numpy as np
import pytest

from rig.errors import Chatter, Diverged, Jammed
from rig.model import friction_law
from rig.model.assembly import Assembly
from rig.motion.motion import Motion


def growing(rate):
    """A free mass with negative damping."""
    a = Assembly("growing")
    a.coordinate("x", 1.0, -2.0 * rate, 100.0)
    a.patch("contact", {"x": 1.0}, {"one": 1e3}, friction_law.coulomb(0.1, 0.1))
    a.normal("load", "contact", {"one": 1.0})
    return a.system()


def go_on(motion):
    for _ in range(5000):
        motion.advance(1)


def test_growth_stops_at_the_limit_of_the_state():
    motion = Motion(growing(5.0), 1_000_000, "exact", limit=50.0)
    with pytest.raises(Diverged, match="left the limit of 50") as told:
        go_on(motion)
    assert told.value.time == pytest.approx(motion.tick * 1e-3 + 1e-3, abs=1e-3)
    assert told.value.mode == "contact slip+"
    assert max(abs(told.value.state["x"]), abs(told.value.state["x'"])) > 50.0
    assert np.all(np.isfinite(motion.x))


@pytest.mark.parametrize("method", ["exact", "dopri5", "rosenbrock", "rk4"])
def test_what_is_not_a_number_stops_the_run(rigs, method):
    system = rigs.p1() if method == "exact" else rigs.p2()
    motion = Motion(system, 1_000_000, method)
    motion.advance(1)
    motion.write(0, float("nan"))
    with pytest.raises((Diverged, Jammed)) as told:
        motion.advance(1)
    assert told.value.time == pytest.approx(1e-3, abs=1e-3)
    assert np.isnan(told.value.state["x"])


def test_too_many_events_are_named():
    """A load that is shaken open 500 times a second, where at most three events a block are allowed."""
    a = Assembly("shaken")
    a.coordinate("x", 1.0, 0.5, 100.0)
    a.signal("sin", {"cos": 3141.6}, 0.0, "test")
    a.signal("cos", {"sin": -3141.6}, 1.0, "test")
    a.patch("contact", {"x": 1.0}, {"one": 1.0}, friction_law.coulomb(0.3, 0.3))
    a.normal("load", "contact", {"one": 1.0, "sin": 2.0})
    motion = Motion(a.system(), 10_000_000, "exact", cap=3)
    with pytest.raises(Chatter, match=r"more than 3 events in one block; the last: load (opens|closes)") as told:
        motion.advance(1)
    assert 0.001 < told.value.time < 0.01
    assert "contact slip+" in told.value.mode


def test_a_contact_that_no_mode_fits_has_jammed():
    """Friction that grows faster with the acceleration than inertia does (Painleve): det(Me) < 0 in slip."""
    a = Assembly("tilted pin")
    a.coordinate("x", 1.0, 0.0, 0.0)
    a.coordinate("y", 1.0, 0.1, 100.0)
    a.patch("tip", {"x": 1.0}, {"one": 0.1}, friction_law.coulomb(0.6, 0.6))
    a.normal("load", "tip", {"one": 1.0}, inertia={"x": 2.0})
    a.start |= {"x'": 0.0}
    with pytest.raises(Jammed, match="jamming") as told:
        Motion(a.system(), 1_000_000, "exact").advance(10)
    assert told.value.time == pytest.approx(0.0, abs=1e-2)
    assert "x'" in told.value.state


def test_the_record_up_to_the_stop_is_kept(rigs):
    motion = Motion(growing(5.0), 1_000_000, "exact", limit=50.0)
    motion.advance(100)
    before = motion.x.copy()
    with pytest.raises(Diverged):
        motion.advance(5000)
    assert motion.tick == 100
    assert np.all(np.isfinite(motion.states[:100]))
    assert not np.array_equal(before, motion.x)


def test_what_dies_away_becomes_zero():
    """No denormal numbers: they would make a tick 60 to 175 times slower (NUM, case HC11)."""
    a = Assembly("at rest")
    a.coordinate("x", 1.0, 2000.0, 1000.0)
    a.coordinate("y", 1.0, 200.0, 10000.0)
    a.start |= {"y": 1.0}
    motion = Motion(a.system(), 1_000_000, "exact")
    for _ in range(400):
        motion.advance(20)
        assert not np.any((np.abs(motion.x) > 0.0) & (np.abs(motion.x) < 1e-300))
    assert motion.x[1] == motion.x[3] == 0.0
