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
def test_every_kind_has_defaults_and_round_trips(kind):
    sensor = KINDS[kind](kind=kind)
    assert sensor.kind == kind
    assert KINDS[kind].model_validate(sensor.model_dump()) == sensor
    late = KINDS[kind](delay="1.25 ms", rate="10 kHz")
    assert (late.delay, late.period_ns) == (1_250_000, 100_000)
    assert KINDS[kind].model_validate_json(late.model_dump_json()) == late


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


def test_every_fault_of_a_section_is_reported():
    with pytest.raises(ValidationError) as error:
        KINDS["laser_vibrometer"](rate="300 kHz", span="1 N", noise=-1.0, bandwith=3.0, delay=-1e-3, dropout="freeze")
    where = {e["loc"][0] for e in error.value.errors()}
    assert where == {"rate", "span", "noise", "bandwith", "delay", "dropout"}


@pytest.mark.parametrize(("kind", "numbers"), [
    ("laser_vibrometer", {"dropout_shortest": 1e-3, "dropout_longest": 1e-4}), ("normal_force", {"quality": 0.5}),
    ("accelerometer", {"rate": 200e3}), ("disc_speed", {"radius": 0.0}), ("disc_speed", {"gain_error": -1.0}),
    ("displacement_laser", {"processing": 11}),
])  # fmt: skip
def test_impossible_numbers_are_refused(kind, numbers):
    with pytest.raises(ValidationError):
        KINDS[kind](**numbers)


@pytest.mark.parametrize(("kind", "field", "text", "value"), [
    ("laser_vibrometer", "noise", "0.1 um/s/Hz^0.5", 1e-7), ("laser_vibrometer", "slew", "160 g_0", 1569.064),
    ("strain_gauge", "strain_per_newton", "20 um/m/N", 20e-6), ("strain_gauge", "noise", "2e-9 1/Hz^0.5", 2e-9),
    ("accelerometer", "warming", "2 delta_degC", 2.0), ("disc_speed", "span", "60 rpm", 6.283185307),
])  # fmt: skip
def test_units_as_users_write_them(kind, field, text, value):
    assert getattr(KINDS[kind](**{field: text}), field) == pytest.approx(value, rel=1e-6)
