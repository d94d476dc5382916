"""Instruments as they are declared in a scene."""

from __future__ import annotations

from dataclasses import replace

import pytest
from pydantic import ValidationError

from rig import scenes
from rig.quantities import unit_of
from rig.scenes.explain import explain
from rig.sensors import KINDS


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_units_are_stated_and_every_default_has_an_origin(kind):
    cls = KINDS[kind]
    assert unit_of(cls, "rate") == "Hz"
    assert unit_of(cls, "span") != ""
    scene = scenes.load("belt")
    explained = explain(replace(scene, sensors={"it": cls(kind=kind)})).values
    origins = {value.key: value.origin for value in explained if value.key.startswith("sensors.it.")}
    unknown = {key for key, origin in origins.items() if origin.origin == "default"}
    assert unknown <= {"sensors.it.radius"}
    assert any(origin.origin == "calibrated" for origin in origins.values())


@pytest.mark.parametrize(
    ("kind", "numbers"),
    [
        ("laser_vibrometer", {"dropout_shortest": 1e-3, "dropout_longest": 1e-4}),
        ("normal_force", {"quality": 0.5}),
        ("accelerometer", {"rate": 200e3}),
        ("disc_speed", {"radius": 0.0}),
        ("disc_speed", {"gain_error": -1.0}),
        ("displacement_laser", {"processing": 11}),
    ],
)
def test_impossible_numbers_are_refused(kind, numbers):
    with pytest.raises(ValidationError):
        KINDS[kind](**numbers)
