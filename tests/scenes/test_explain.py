"""What `rig explain` says: effects on or absent, states each adds, the origin of each value."""

import pytest

from rig import scenes
from rig.scenes.explain import explain


@pytest.mark.parametrize("name", scenes.names())
def test_the_effects_own_all_states(name):
    scene = scenes.load(name)
    told = [state for effect in explain(scene).effects for state in effect.states]
    assert sorted(told) == sorted(set(scene.assemble().system().names) - {"one"})


@pytest.mark.parametrize("name", scenes.names())
def test_every_value_of_the_file_is_shown_with_its_origin(name):
    scene = scenes.load(name)
    told = {value.key: value.origin for value in explain(scene).values}
    assert {key: told.get(key) for key in scene.origins} == scene.origins


def test_an_absent_effect_adds_nothing():
    effects = {effect.name: effect for effect in explain(scenes.load("belt")).effects}
    assert not effects["dither"].on
    assert effects["dither"].states == ()
    with_dither = {"dither.on": "belt", "dither.amplitude": "0.1 m/s", "dither.frequency": "150 Hz"}
    effects = {effect.name: effect for effect in explain(scenes.load("belt", with_dither)).effects}
    assert effects["dither"].states == ("dither.sin", "dither.cos")


def test_defaults_of_instruments_carry_the_origin_of_their_documentation():
    told = {value.key: value.origin for value in explain(scenes.load("pendulum")).values}
    assert told["sensors.vibrometer.slew"].origin == "calibrated"
    assert told["sensors.strain_gauge.span"].origin == "public"
    assert told["clock.tolerance"].origin == "chosen"


def test_units_of_the_protocol_are_those_of_what_it_moves():
    units = {value.key: value.unit for value in explain(scenes.load("pendulum")).values}
    assert units["protocol[5].to"] == "rad/s"
    assert units["protocol[2].to"] == "N"
    assert units["load.lag"] == "s"
