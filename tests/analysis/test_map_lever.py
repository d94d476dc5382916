"""Maps of the lever rig against the critical speeds of independent code (LIU: Hopf by eigenvalues, fold by
continuation to 0.02 rpm; with a sector by both runs)."""

import math

import numpy as np
import pytest

import rig
from rig.analysis.map.chart import REGIONS
from rig.analysis.map.job import RUNS

RPM = math.pi / 30.0


def ends(found, row=0):
    """Of the vibration, on the run-up [rpm]."""
    return found.ends[RUNS.index("up"), row] / RPM


@pytest.fixture(scope="module")
def uniform(tmp_path_factory):
    folder = tmp_path_factory.mktemp("maps")
    return rig.map("lever", "drive.speed=0.5 rpm:6 rpm:12", folder=folder, workers=1, runs=("up", "down"))


def test_regions_of_the_uniform_disc(uniform):
    """At 20 N: sliding stable above 2.03444 rpm, stick-slip up to 5.585 rpm."""
    expected = ["III" if v < 2.03444 else "II" if v < 5.585 else "I" for v in uniform.job.x.shown_values]
    assert [REGIONS[r] for r in uniform.regions[0]] == expected
    assert uniform.onsets[0] / RPM == pytest.approx([2.03444], abs=1e-4)
    assert ends(uniform) == pytest.approx(5.585, abs=0.03)


@pytest.mark.parametrize(
    ("rpm", "period", "share", "amplitude"), [(1, 0.348375, 0.5635, 0.00924586), (3, 0.241809, 0.2684, 0.01264143)]
)
def test_cycles_along_the_run(uniform, rpm, period, share, amplitude):
    """Displacement of the pin: its lever arm of 0.1 m times the angle of the cylinder.

    The reference tells the share of stick over a stretch that is no whole number of cycles.
    """
    at = (RUNS.index("up"), 0, int(np.flatnonzero(np.isclose(uniform.job.x.shown_values, rpm))[0]))
    assert uniform.tables["period"][at] == pytest.approx(period, rel=1e-5)
    assert uniform.tables["share"][at] == pytest.approx(share, abs=3e-3)
    assert uniform.amplitude[at] / 0.1 == pytest.approx(amplitude, rel=1e-5)


@pytest.mark.slow
def test_coulomb_friction_has_no_region_without_sliding_and_its_fold_grows_with_the_load(tmp_path):
    found = rig.map(
        "lever_coulomb", "drive.speed=0.5 rpm:5 rpm:10", "load.force=10:30:3", folder=tmp_path, runs=("up", "near")
    )
    assert {REGIONS[r] for r in found.regions.ravel()} == {"I", "II"}
    for row, fold in enumerate((1.452, 2.946, 4.468)):
        assert ends(found, row) == pytest.approx(fold, abs=0.035)


@pytest.mark.slow
def test_a_sector_ends_stick_slip_earlier_and_leaves_the_loss_of_sliding(tmp_path):
    """45 degrees of another surface at 20 N: 3.37 rpm instead of 5.585 rpm, 2.08 rpm instead of 2.03 rpm."""
    found = rig.map("lever_sector", "drive.speed=1.5 rpm:4.5 rpm:7", folder=tmp_path, workers=1, runs=("up", "down"))
    assert [REGIONS[r] for r in found.regions[0]] == ["III", "III", "II", "II", "I", "I", "I"]
    assert ends(found) == pytest.approx(3.37, abs=0.1)
    assert found.onsets[0] / RPM == pytest.approx([2.03444], abs=1e-4)
