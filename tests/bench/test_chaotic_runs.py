"""A recording of a rig that becomes chaotic, made by another processor: samples, then statistics.

The other processor is a run whose slider is heavier by 1e-14: that is what rounding does. (That the slider is heavier,
its recording does not tell.)
"""

import dataclasses

import numpy as np
import pytest

import rig
from rig.bench.again.verify import verify
from rig.record.provenance import provenance
from rig.record.save_run import save
from rig.record.statistics import first_opening

OPENS = {"plate.damping_ratio": "0", "friction.mu": "0.5"}


@pytest.fixture(scope="module")
def run():
    """Without damping and with more friction a point opens after 0.33 s, in the shipped scene after 0.56 s."""
    return _simulated()


def _simulated(**changes):
    found = rig.simulate(rig.load("plate", OPENS | changes), 0.45)
    found.provenance = provenance(1)
    return found


def _elsewhere(run, scene):
    return dataclasses.replace(run, scene=scene.scene, provenance=run.provenance | {"processor": "another"})


@pytest.fixture(scope="module")
def rounded(run):
    """The same by a processor that rounds otherwise."""
    other = _simulated(**{"slider.density": f"{8050 * (1 + 1e-14)!r} kg/m^3"})
    assert other.signals["slider_velocity"].tobytes() != run.signals["slider_velocity"].tobytes()
    return _elsewhere(other, run)


def test_the_first_opening_is_found_after_all_points_were_closed(run):
    opened = first_opening(run)
    assert opened == pytest.approx(0.3325, rel=0.02)
    at = int(np.argmax(run.time >= opened))
    assert run.signals["contact_fraction"][0] == 0.0  # it starts open
    assert (run.signals["contact_fraction"][1:at] == 1.0).all()
    assert run.signals["contact_fraction"][at] <= 1.0


def test_one_bit_after_the_opening_is_the_only_fault_on_the_same_processor(run, tmp_path):
    bent = run.signals["slider_velocity"].copy()
    bent[-1] = np.nextafter(bent[-1], 1.0)
    save(dataclasses.replace(run, signals=run.signals | {"slider_velocity": bent}), tmp_path / "bent.mcap")
    (fault,) = verify(tmp_path / "bent.mcap").faults
    assert "slider_velocity differs at t = 0.45 s" in fault


def test_another_processor_is_compared_up_to_the_first_opening_and_then_by_statistics(rounded, tmp_path):
    save(rounded, tmp_path / "there.mcap")
    found = verify(tmp_path / "there.mcap")
    assert found.passed, found.text()
    assert not found.identical
    assert found.elsewhere == ("processor",)
    assert found.deviation < 1e-9
    assert found.opened == pytest.approx(first_opening(rounded))
    text = found.text()
    assert "statistics, recorded and here" in text
    for name in ("rms slider_acceleration", "least contact_fraction", "band meas/accelerometer"):
        assert name in text


def test_other_statistics_do_not_hold(rounded, tmp_path):
    opened = rounded.time >= first_opening(rounded)
    louder = np.where(opened, 2.0, 1.0) * rounded.signals["slider_acceleration"]
    signals = rounded.signals | {"slider_acceleration": louder}
    save(dataclasses.replace(rounded, signals=signals), tmp_path / "louder.mcap")
    found = verify(tmp_path / "louder.mcap")
    assert any("does not agree: rms slider_acceleration" in told for told in found.faults), found.text()
