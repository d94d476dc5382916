"""What an effect costs and changes: paired runs with and without it."""

import pytest

import rig
from rig.analysis.cycles.motion_measures import problem
from rig.errors import SceneError
from rig.qualify.cost.effects import bare, changed, effects
from rig.scenes.variants import dropped, opened, without


@pytest.fixture(scope="module")
def shunted():
    return {one.name: one for one in effects(rig.load("belt_shunt"), rounds=1)}


def test_a_shunt_adds_two_states_and_its_absence_is_seen(shunted):
    shunt = shunted["shunt"]
    assert shunt.states == 2
    assert shunt.errors["period"] > 0.1
    assert shunt.errors["amplitude displacement"] > 0.1
    assert shunt.tick.low <= shunt.tick.value <= shunt.tick.high
    assert shunt.whole > 0.0


def test_what_the_plant_cannot_do_without_is_told_with_the_reason(shunted):
    assert "needs a stack" in shunted["piezo"].fault
    with pytest.raises(SceneError, match="needs a stack"):
        without(rig.load("belt_shunt"), ["piezo"])


def test_a_limit_that_is_not_met_changes_no_bit():
    scene = rig.load("pendulum")
    assert set(dropped(scene)) >= {"load lag", "load limits"}
    [limits] = [one for one in effects(scene, rounds=1) if one.name == "load limits"]
    assert limits.states == 0
    assert set(limits.errors.values()) == {0.0}


def test_no_change_is_larger_than_the_whole(shunted):
    sizes = [one.size for paired in shunted.values() for one in paired.changes if one.measure != "growth rate"]
    assert sizes
    assert max(sizes) <= 1.0
    assert {one.unit for one in shunted["shunt"].changes} >= {"s", "m", "J"}


def test_what_starts_open_is_measured_closed_as_well():
    scene = rig.load("belt_shunt", {"shunt.connected": "false"})
    assert opened(scene).keys() == {"shunt.connected"}
    shunt = {one.name: one for one in effects(scene, rounds=1)}["shunt"]
    assert shunt.closed.worst.size > 0.1
    assert shunt.closed.states == 2
    assert shunt.change().startswith("starts open, is closed by the protocol; measured closed: ")
    assert opened(bare(scene)) == {
        "shunt.connected": "nothing in the scene closes it (rig live tune shunt.connected=1 does)"
    }


def test_what_the_protocol_closes_for_the_longest_time_is_measured_closed_at_once():
    scene = rig.load("belt_dither")
    assert opened(scene) == {"dither.enable": "is closed by the protocol"}
    [dither] = [one for one in effects(scene, rounds=1) if one.name == "dither"]
    assert dither.closed is None
    assert dither.worst.size > 0.5
    assert dither.change().startswith("starts open, is closed by the protocol, measured closed; ")
    assert opened(rig.load("brake_shunt_listener"))["shunt.connected"].startswith("is closed by controller ")


def test_a_plant_that_leaves_its_limits_or_stops_is_told_so():
    scene = bare(rig.load("belt", {"limits.displacement": "1 mm"}))
    whole = problem(scene)
    assert "displacement exceeds its limit of 0.001 m" in whole.leaves
    assert "with it displacement exceeds" in changed(whole, problem(bare(rig.load("belt"))))[1]


@pytest.mark.slow
def test_a_sector_is_watched_until_it_has_come_by():
    """At 4.5 rpm a turn takes 13.3 s; up to the sandblasted eighth the lever sticks and slips in a cycle of its own."""
    base = bare(rig.load("lever_sector"))
    whole, less = problem(base), problem(without(base, dropped(base)["sector"]))
    assert (whole.kind, less.kind) == ("vibration", "cycle")
    assert whole.seconds > 3.0 * 60.0 / 4.5
    assert whole.window * whole.step > 60.0 / 4.5
    found = {one.measure: one for one in changed(whole, less)[0]}
    assert found["rms displacement"].size > 0.9
    assert found["stick share contact"].whole == 0.0
    assert found["stick share contact"].less > 0.1
