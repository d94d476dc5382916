"""What `rig explain` says: effects on or absent, states each adds, the origin of each value."""

from rig import scenes
from rig.scenes.explain import explain


def test_effects_own_all_states_say_what_they_are_and_every_value_has_its_origin(shipped):
    for scene in shipped:
        told = explain(scene)
        states = [state for effect in told.effects for state in effect.states]
        assert sorted(states) == sorted(set(scene.assemble().system().names) - {"one"}), scene.name
        assert [effect.name for effect in told.effects if not effect.about] == [], scene.name
        origins = {value.key: value.origin for value in told.values}
        assert {key: origins.get(key) for key in scene.origins} == scene.origins, scene.name


def test_defaults_carry_the_origin_of_their_documentation_and_steps_the_unit_of_what_they_move():
    told = {value.key: value for value in explain(scenes.load("pendulum")).values}
    keys = ("sensors.vibrometer.slew", "sensors.strain_gauge.span", "clock.tolerance")
    assert [told[key].origin.origin for key in keys] == ["calibrated", "public", "chosen"]
    assert [told[key].unit for key in ("protocol[5].to", "protocol[2].to", "load.lag")] == ["rad/s", "N", "s"]
