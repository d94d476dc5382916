"""Eigenvalues of the plate under its slider: the equilibrium as it is told, and how a sweep tells flutter."""

from __future__ import annotations

import pytest

import rig
from rig.analysis import map as maps
from rig.errors import UsageError
from rig.qualify.cost import cost
from rig.qualify.effects_measured import signals
from rig.scenes.explain import explain


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
    assert "pressure of 40 points: " in found.text()
    assert len(found.sliding.modes) == 43


def test_a_slider_that_travels_back_is_one_that_travels_on_from_the_other_end() -> None:
    """The plate is alike from both ends: growth rates and frequencies are the same, forces and places mirrored."""
    on = rig.modes(rig.load("plate", {"slider.position": 0.004})).sliding
    back = rig.modes(rig.load("plate", {"slider.position": 0.0437 - 0.004, "drive.speed": -0.01})).sliding
    largest = [max(found.modes, key=lambda mode: mode.growth) for found in (on, back)]
    assert largest[0].growth > 100.0
    assert largest[1].growth == pytest.approx(largest[0].growth, rel=1e-2)
    assert largest[1].frequency == pytest.approx(largest[0].frequency, rel=1e-5)
    for name in ("friction_force", "pressure_centre_x", "pitch_displacement"):  # rows lie between other places there
        assert back.equilibrium[name] == pytest.approx(-on.equilibrium[name], rel=1e-3)


def test_flutter_by_position() -> None:
    """Sliding is stable at the end and in the middle of the plate, and flutters between them; a run is not refused."""
    swept = rig.sweep("plate", "slider.position", [0.0, 0.004, 0.02])
    assert [growth > 0.0 for growth in swept.largest] == [False, True, False]
    assert swept.exists.all()
    there = rig.modes(rig.load("plate", {"slider.position": "4 mm"}))
    assert {one.level for one in there.findings} <= {"info", "warning"}


@pytest.mark.parametrize(
    "study",
    [
        rig.limit_cycle,
        lambda scene: maps.job(scene, "drive.speed=0.001:0.01:3"),
        lambda scene: cost(scene, None),
    ],
)
def test_studies_of_single_motions_are_refused(study) -> None:
    with pytest.raises(UsageError, match=r"plate: .* film of points: after the first opening motion is chaotic"):
        study(rig.load("plate"))


def test_points_that_would_have_to_pull_are_told() -> None:
    found = rig.modes(rig.load("plate", {"friction.mu": 1.0}))
    assert found.sliding.pulls == 8
    assert "8 points would have to pull" in found.text()


def test_a_map_of_a_rig_without_a_contact_that_slides_is_refused() -> None:
    with pytest.raises(UsageError, match=r"plate_free: the rig has no contact that can slide"):
        maps.job(rig.load("plate_free"), "plate.young=2e11:2.3e11:3")


def test_what_the_plate_is_made_of_fits_on_a_page() -> None:
    told = {effect.name: effect.states_text for effect in explain(rig.load("plate")).effects}
    assert told["structure"] == "q1 .. q40, z, theta, psi, q1' .. q40', z', theta', psi'"
    assert "P:1 .. P:40" in told["film"]
    assert [one.name for one in signals(rig.load("plate"))][-1] == "pressure of 40 points"


def test_a_free_plate_has_the_lines_of_the_paper() -> None:
    """Twist and two bendings; 5.7, 8.0 and 10.8 kHz in the paper."""
    found = sorted(mode.frequency for mode in rig.modes("plate_free").sliding.modes if mode.frequency)
    assert found[:3] == pytest.approx([5701.3, 8032.2, 10838.9], rel=3e-3)
