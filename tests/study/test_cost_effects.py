"""What an effect costs and changes: paired runs with and without it."""

import pytest

import rig
from rig.errors import SceneError
from rig.scenes.variants import dropped, without
from rig.study.cost.effects import bare, effects


@pytest.fixture(scope="module")
def shunted():
    return {one.name: one for one in effects(rig.load("belt_shunt"), rounds=3)}


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
    [limits] = [one for one in effects(scene, rounds=3) if one.name == "load limits"]
    assert limits.states == 0
    assert set(limits.errors.values()) == {0.0}


def test_sensors_of_what_is_gone_are_gone():
    scene = rig.load("brake_shunt_sound")
    left = without(bare(scene), ["shunt"])
    assert not left.protocol
    assert set(left.sensors) <= set(scene.sensors)
    assert all(section.reads in left.assemble().outputs for section in left.sensors.values())
