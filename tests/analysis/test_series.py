"""Components of a series in place of any value, and the whole box of a design examined."""

import itertools
import math

import pytest

import rig as lab
from rig.analysis.robust import design
from rig.analysis.robust.series import SERIES, decade, near
from rig.analysis.robust.stated import prepared
from rig.errors import UsageError

DAMPING = {"body.damping": "8 N*s/m:20 N*s/m"}
BELT = {"friction.mu_static": "+-10 %", "drive.speed": "+-10 %"}


def test_the_series_of_the_standard():
    assert {name: len(decade(name)) for name in SERIES} == SERIES
    assert decade("E6") == [1.0, 1.5, 2.2, 3.3, 4.7, 6.8]
    assert decade("E12") == [1.0, 1.2, 1.5, 1.8, 2.2, 2.7, 3.3, 3.9, 4.7, 5.6, 6.8, 8.2]
    assert decade("E96")[:5] == [1.0, 1.02, 1.05, 1.07, 1.1]
    assert 9.2 in decade("E192")
    assert set(decade("E48")) <= set(decade("E96")) <= set(decade("E192"))


@pytest.mark.parametrize(
    ("value", "series", "expected"),
    [
        (16.494, "E96", [15.8, 16.2, 16.5, 16.9]),
        (0.01240309, "E96", [0.0121, 0.0124, 0.0127, 0.013]),
        (1.0, "E6", [0.47, 0.68, 1.0, 1.5]),
        (9.9e-9, "E12", [6.8e-9, 8.2e-9, 1e-8, 1.2e-8]),
    ],
)
def test_values_beside_a_design(value, series, expected):
    assert near(value, series) == expected


def test_what_is_no_series_and_no_component_is_refused():
    scene = lab.load("belt")
    with pytest.raises(UsageError, match="E6, E12"):
        prepared(scene, DAMPING, BELT, "modes.growth", series="E7")
    with pytest.raises(UsageError, match="no free value is a component"):
        prepared(scene, DAMPING, BELT, "modes.growth", series="E96")


def test_series_and_proof_belong_to_a_design_against_something():
    with pytest.raises(UsageError, match="against what is not known"):
        lab.optimise("belt", DAMPING, "modes.growth", series="E96")
    with pytest.raises(UsageError, match="against what is not known"):
        lab.optimise("belt", DAMPING, "modes.growth", prove=True)


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(design, "AUDIT", 100)


@pytest.mark.parametrize(("damping", "verdict"), [(52.0, "proved"), (49.0, "refuted")])
def test_the_whole_box_of_a_belt_is_examined(tmp_path, monkeypatch, small, damping, verdict):
    monkeypatch.chdir(tmp_path)  # runs are recorded as well
    overrides = {"body.damping": damping}
    found = lab.optimise(
        "belt", None, "modes.growth", against=BELT, prove=True, overrides=overrides, out=tmp_path, workers=1
    )
    speed, scale = 0.054, 0.05
    slope = -(0.55 - 0.18) / scale * math.exp(-speed / scale)
    assert (-(damping + 20.0 * slope) / 10.0 < 0.0) == (verdict == "proved")  # the closed form of the worst rig
    assert found.certificate.verdict == verdict
    assert found.to_json()["certificate"]["verdict"] == verdict
    assert ("proved: no rig of the box grows" in found.text()) == (verdict == "proved")


def test_a_shunt_of_a_coarse_series_that_cannot_hold_is_said(tmp_path, small):
    over = {"shunt.resistance": "15 ohm:150 ohm", "shunt.inductance": "36 mH:37 mH"}
    scene = lab.load("brake_shunt", {"shunt.connected": True})
    with pytest.raises(UsageError, match=r"no value of shunt\.inductance between"):
        lab.optimise(
            scene,
            over,
            "modes.growth",
            against={"friction.mu": "+-1 %"},
            band="2 kHz:5 kHz",
            series="E6",
            out=tmp_path,
            workers=1,
        )


FALLING = """format = 1
based_on = "belt_shunt"
[friction]
law = "stribeck"
mu_static = ["0.5", "chosen"]
mu_dynamic = ["0.18", "chosen"]
mu_kinetic = "none"
speed_scale = ["0.05 m/s", "chosen"]
"""


@pytest.mark.slow
def test_where_no_values_of_a_series_hold_that_is_the_result(tmp_path, small):
    """Friction that falls: the best shunt of any values just decays, and each of E6 around it grows."""
    (tmp_path / "falling.toml").write_text(FALLING)
    scene = lab.load(tmp_path / "falling.toml")
    over = {"shunt.resistance": "300 ohm:10 kohm", "shunt.inductance": "20 H:200 H"}
    asked = {"against": {"friction.mu_static": "+-1 %"}, "series": "E6", "out": tmp_path, "workers": 1}
    found = lab.optimise(scene, over, "modes.growth", **asked)
    rounded = found.to_json()["series"]
    assert rounded["worst_before"] < 0.0 < rounded["worst"] == found.worst
    assert not rounded["holds"]
    assert "no values of series E6 near the design hold: of 16 combinations the best is this one" in found.text()
    for values in itertools.product(*(near(rounded["before"][key], "E6") for key in over)):
        other = scene.with_values({**dict(zip(over, values)), "friction.mu_static": 0.505})
        assert lab.modes(other).sliding.modes[0].growth >= found.worst - 1e-9


def test_a_series_is_not_for_a_tolerance():
    scene = lab.load("brake_shunt", {"shunt.connected": True})
    with pytest.raises(UsageError, match="state the tolerance with --against and minimise the growth"):
        prepared(
            scene, {"shunt.resistance": "15 ohm:150 ohm"}, {"friction.mu": "+-1 %"}, maximise="tolerance", series="E96"
        )


@pytest.mark.slow
def test_a_rounded_shunt_is_the_best_of_those_near_the_design(tmp_path, small):
    over = {"shunt.resistance": "15 ohm:150 ohm", "shunt.inductance": "20 mH:50 mH"}
    asked = {"against": {"friction.mu": "+-1 %"}, "band": "2 kHz:5 kHz", "out": tmp_path, "workers": 1}
    scene = lab.load("brake_shunt", {"shunt.connected": True})
    any_value = lab.optimise(scene, over, "modes.growth", **asked)
    sold = lab.optimise(scene, over, "modes.growth", series="E12", **asked)
    beside = [near(any_value.values[key], "E12") for key in over]
    for key, values in zip(over, beside):
        assert any(sold.values[key] == pytest.approx(value, rel=1e-12) for value in values)
    for values in itertools.product(*beside):
        if 15.0 <= values[0] <= 150.0 and 0.02 <= values[1] <= 0.05:
            other = lab.load("brake_shunt", {"shunt.connected": True} | dict(zip(over, values)))
            assert lab.optimise(other, None, "modes.growth", **asked).worst >= sold.worst - 1e-6
    rounded = sold.to_json()["series"]
    assert rounded["worst"] >= rounded["worst_before"]
    assert rounded["holds"] == (rounded["worst"] <= 0.0)
    assert "series E12" in sold.text()
