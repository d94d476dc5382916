"""Nominal and worst rigs in time: growth beside the eigenvalue, and the least knock that does not come back."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from robust_scenes import BELT, SHUNT, STACK

import rig as lab
from rig.analysis import robust
from rig.analysis.robust import design, in_time, knocked
from rig.analysis.robust.envelope import envelope, of_rates, slope
from rig.analysis.robust.growth import MODES
from rig.bench.again.verify import verify


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    """Recordings go to a folder of the test; audits have 100 rigs, and the box is not examined."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(design, "AUDIT", 100)
    monkeypatch.setattr(robust, "proved", lambda *asked: None)


def proved(scene, over, measure=MODES, **more):
    return lab.optimise(scene, over, measure, workers=1, prove=True, **more)


def growing(belt_damping, mu_static, mu_dynamic, speed):
    """The growth rate of the belt with a damper: m 5 kg, F0 20 N, speed scale 0.05 m/s."""
    slope = -(mu_static - mu_dynamic) / 0.05 * math.exp(-speed / 0.05)
    return -(belt_damping + 20.0 * slope) / 10.0


@pytest.mark.parametrize("damping", [2.0, 45.0])
def test_the_belt_grows_and_decays_in_time_as_the_closed_form(damping, monkeypatch):
    monkeypatch.setattr(in_time, "least_knocks", lambda growth, cases, *_: [knocked.Least(0.0, 0.0, "")] * len(cases))
    found = proved("belt", None, against=BELT, overrides={"body.damping": damping})
    nominal, worst = found.timed
    assert (nominal.rig, worst.rig) == ("nominal", "worst")
    assert nominal.growth == pytest.approx(growing(damping, 0.5, 0.18, 0.06), rel=1e-3)
    assert worst.growth == pytest.approx(growing(damping, 0.55, 0.162, 0.054), rel=1e-3)
    assert nominal.agrees
    assert worst.agrees
    assert "stick from" in worst.remark  # it grows until the belt takes it along
    assert verify(Path(worst.recording)).identical


def test_a_flutter_pair_whose_other_mode_has_the_same_frequency_grows_as_its_eigenvalue(monkeypatch):
    """The filter needs seconds until the other mode has gone: the knock is small enough for that."""
    monkeypatch.setattr(in_time, "least_knocks", lambda growth, cases, *_: [knocked.Least(0.0, 0.0, "")] * len(cases))
    nominal, worst = proved("two_dof", None, against={"friction.mu": "+-20 %"}).timed
    assert (nominal.expected, worst.expected) == pytest.approx((0.17997, 0.410617), abs=1e-5)
    assert (nominal.growth, worst.growth) == pytest.approx((nominal.expected, worst.expected), rel=1e-3)
    assert "open from" in worst.remark


@pytest.mark.slow
def test_the_least_knock_by_bisection_is_that_of_the_unstable_cycle(monkeypatch):
    """At 0.2 m/s the belt with 8 N s/m slides or sticks and slips (rig branches --threshold: 0.8547 N s)."""
    given = {"against": {"drive.speed": "+-2 %"}, "overrides": {"body.damping": 8.0, "drive.speed": 0.2}}
    by_branch = proved("belt", None, **given).timed
    monkeypatch.setattr(knocked, "by_branches", lambda *_: (math.nan, "left out"))
    by_runs = proved("belt", None, **given).timed
    for exact, halved in zip(by_branch, by_runs):
        assert exact.least.how == "unstable cycle along drive.speed"
        assert "bisection of whole runs; beyond it it does not come to rest" in halved.least.how
        assert abs(halved.least.low) <= abs(exact.least.size) * (1.0 + 1e-4)
        assert abs(halved.least.high) >= abs(exact.least.size) * (1.0 - 1e-4)
        assert halved.least.size == pytest.approx(exact.least.size, rel=1e-3)
    assert by_branch[0].least.size == pytest.approx(0.8547, rel=1e-3)


def test_where_every_knock_comes_back_the_report_says_so_and_what_is_kept_is_not_run_again(monkeypatch):
    """Static and dynamic friction are equal: nothing feeds a vibration. A limit of the scene ends large ones."""
    monkeypatch.setattr(knocked, "SIZES", (0.0625, 32.0))
    monkeypatch.setattr(knocked, "EXACT", 0.5)
    against = {"against": {"drive.speed": "+-2 %"}}
    even = {"body.damping": 20.0, "friction.mu_static": 0.18}
    limited = proved("belt", None, **against, overrides=even)
    assert "beyond it a limit of the scene ends the run (displacement" in limited.timed[0].least.how
    given = {**against, "overrides": {**even, "limits.displacement": "10 m"}}
    whole_run = knocked.away
    sizes = []

    def interrupted(case, size):
        sizes.append(size)
        if len(sizes) == 3:
            raise KeyboardInterrupt
        return whole_run(case, size)

    monkeypatch.setattr(knocked, "away", interrupted)
    with pytest.raises(KeyboardInterrupt):
        proved("belt", None, **given)
    monkeypatch.setattr(in_time, "in_time", None)
    found = proved("belt", None, **given)
    text = found.text()
    assert text.count("none: it comes back from every knock up to") == 2
    table = found.to_json()["in_time"]
    assert [row["in time"] for row in table] == ["scene, nominal rig", "scene, worst rig"]
    assert table[0]["least knock"] is None
    assert table[0]["growth in time"] == pytest.approx(-2.0, rel=1e-3)
    assert len(sizes) == 9  # four searches of two sizes, one of them interrupted
    json.dumps(found.to_json(), allow_nan=False)
    monkeypatch.setattr(knocked, "away", None)
    assert proved("belt", None, **given).text() == text


def test_an_envelope_has_the_slope_of_its_mode():
    """A light mode beside a slower one, which is filtered; a heavy one over many orders of magnitude."""
    t = np.arange(0.0, 1.0, 1e-4)
    light = complex(-6.0, 2.0 * math.pi * 500.0)
    other = complex(-5.0, 2.0 * math.pi * 100.0)
    v = (np.exp(light * t) + np.exp(other * t)).real
    mode = of_rates(np.array([light, light.conjugate(), other, other.conjugate()]), light.real, 500.0)
    times, amplitudes = envelope(v, 1e-4, mode)
    growth, uneven = slope(times, amplitudes, mode.alone, 0.9)
    assert growth == pytest.approx(-6.0, rel=1e-3)
    assert uneven < 1e-2
    heavy = complex(-21.8, 2.0 * math.pi)
    t = np.arange(0.0, 6.0, 1e-3)
    times, amplitudes = envelope(np.exp(heavy * t).real, 1e-3, of_rates(np.array([heavy]), heavy.real, 1.0))
    assert slope(times, amplitudes, 0.0, 4.0)[0] == pytest.approx(-21.8, rel=1e-3)


@pytest.mark.slow
def test_the_worst_brake_of_the_nominal_optimum_grows_in_time_and_that_of_the_robust_design_decays():
    found = proved("brake_shunt", SHUNT, against=STACK, band="2 kHz:5 kHz", overrides={"shunt.connected": True})
    runs = {(run.design, run.rig): run for run in found.timed}
    grows = runs["nominal optimum", "worst"]
    assert grows.growth == pytest.approx(26.98, rel=0.01)
    assert grows.agrees
    assert "open from" in grows.remark
    decays = runs["robust", "worst"]
    assert decays.growth == pytest.approx(-5.95, rel=0.01)
    assert decays.growth == pytest.approx(found.worst, rel=1e-3)
    assert all(run.agrees for run in found.timed)
    assert "none: it comes back from every knock" in decays.least.how
    assert grows.least.size == 0.0
    assert len(found.plot().axes) == 4
