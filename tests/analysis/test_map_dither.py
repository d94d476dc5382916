"""The boundary of dither against event-exact simulations by independent code: the mass on a belt with two degrees of
freedom, mu = 0.5 and 0.8, frequencies 5, 10 and 20 times that of the rig (10 rad/s)."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

import rig
from rig.analysis import map as maps
from rig.analysis.map.row import units
from rig.errors import SceneError

REFERENCE = json.loads((Path(__file__).parents[1] / "reference" / "two_dof.json").read_text())["dither_boundary"]
SPEED, RATE = 0.3, 10.0


def frequencies(low, high, count):
    """An axis over the ratio of frequencies."""
    low, high = (ratio * RATE / (2.0 * math.pi) for ratio in (low, high))
    return f"dither.frequency={low!r}:{high!r}:{count}"


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    folder = tmp_path_factory.mktemp("maps")
    return rig.map("two_dof_dither", frequencies(5, 20, 4), "dither.amplitude=5 N:80 N:8", out=folder, workers=1)


@pytest.mark.parametrize(("column", "ratio"), [(0, 5), (1, 10), (3, 20)])
def test_the_simulated_boundary_is_that_of_the_reference(found, column, ratio):
    reference = REFERENCE["sim"][f"mu0.5_V0.3_r{ratio}"]["a_over_V"]
    assert found.simulated[column].mean() / (SPEED * RATE * ratio) == pytest.approx(reference, abs=0.005)


def test_the_leading_order_is_a_straight_line_at_the_reference(found):
    amplitudes = found.leading / (SPEED * 2.0 * math.pi * np.array(found.job.x.values))
    assert amplitudes == pytest.approx(np.full(4, REFERENCE["avg"]["mu0.5_V0.3"]["a_over_V"]), rel=1e-6)


def test_averaged_and_simulated_agree_from_ratio_ten_on_within_five_percent(found):
    assert np.abs(found.deviation[1:]).max() < 0.05
    assert np.abs(found.simulated.mean(axis=1) / found.leading - 1.0)[1:].max() < 0.05


def test_the_gap_to_the_leading_order_closes_with_the_square_of_the_frequency(found):
    gaps = 1.0 - found.simulated.mean(axis=1) / found.leading
    assert gaps[0] > gaps[1] > gaps[3] > 0.0
    assert gaps[0] / gaps[1] == pytest.approx(4.0, rel=0.15)


def test_more_friction_needs_more_dither():
    scene = rig.load("two_dof_dither", {"friction.mu": 0.8})
    job = maps.job(scene, frequencies(10, 20, 2), "dither.amplitude=5 N:80 N:8")
    low, high = units(job).compute(0)["simulated"] / (SPEED * RATE * 10.0)
    assert 0.5 * (low + high) == pytest.approx(REFERENCE["sim"]["mu0.8_V0.3_r10"]["a_over_V"], abs=0.005)


def test_a_rig_that_slides_anyway_needs_no_dither_and_one_that_is_too_weak_throughout_has_no_boundary():
    scene = rig.load("two_dof_dither", {"friction.mu": 0.3})
    job = maps.job(scene, frequencies(10, 20, 2), "dither.amplitude=5 N:80 N:4")
    assert all(np.all(found == 0.0) for found in units(job).compute(0).values())
    job = maps.job(rig.load("two_dof_dither"), frequencies(10, 20, 2), "dither.amplitude=5 N:20 N:4")
    found = units(job).compute(0)
    assert np.isinf(found["averaged"])
    assert found["simulated"].tolist() == [20.0, math.inf]


def test_it_is_told_and_written(found):
    assert "leading order" in found.text()
    lines = found.csv().splitlines()
    assert lines[0] == "dither.frequency [Hz],leading [N],averaged [N],simulated_lost [N],simulated_kept [N],deviation"
    assert len(lines) == 5
    json.dumps(found.to_json())


def test_a_scene_without_dither_has_no_boundary():
    with pytest.raises(SceneError, match="is not a numeric parameter of this scene"):
        maps.job(rig.load("two_dof"), frequencies(10, 20, 2), "dither.amplitude=5 N:20 N:4")
