"""Eigenvalues of the plate under its slider: the equilibrium as it is told, and how a sweep tells flutter."""

from __future__ import annotations

import pytest

import rig


def test_equilibrium_tells_the_film() -> None:
    """The pressure centre stands mu h off the middle, 4.08 mm, which is what friction tilts the slider by."""
    found = rig.modes("plate")
    at = found.sliding.equilibrium
    assert found.sliding.exists
    assert at["normal_force"] == pytest.approx(108.79, rel=1e-9)
    assert at["friction_force"] == pytest.approx(0.3 * 108.79, rel=1e-9)
    assert at["pressure_centre_x"] == pytest.approx(0.3 * 0.0136, rel=1e-6)
    assert at["pressure_centre_y"] == pytest.approx(0.0, abs=1e-9)
    assert at["contact_fraction"] == 1.0
    pressures = [v for name, v in at.items() if name.startswith("pressure_") and name[-1].isdigit()]
    assert len(pressures) == 40
    assert sum(pressures) / 40 == pytest.approx(1e5, rel=1e-4)
    assert "pressure [Pa] of 40 points" in found.text()
    assert len(found.sliding.modes) == 43


def test_flutter_by_position() -> None:
    """Sliding is stable at the end and in the middle of the plate, and flutters between them; a run is not refused."""
    swept = rig.sweep("plate", "slider.position", [0.0, 0.004, 0.02])
    assert [growth > 0.0 for growth in swept.largest] == [False, True, False]
    assert swept.exists.all()
    there = rig.modes(rig.load("plate", {"slider.position": "4 mm"}))
    assert {one.level for one in there.findings} <= {"info", "warning"}
