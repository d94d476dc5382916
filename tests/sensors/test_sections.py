"""Instruments as they are declared in a scene."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from rig.sensors import KINDS


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
