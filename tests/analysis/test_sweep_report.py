"""Sweeps as reports: text, JSON, figure and the command."""

import json

import numpy as np
import pytest

import rig
from rig.errors import SceneError
from rig.scenes.axis import Axis


def test_where_nothing_slides_the_report_says_why_and_not_none():
    found = rig.sweep(rig.load("belt", {"drive.speed": 0.0}), "load.force", np.linspace(1.0, 4.0, 4))
    assert found.critical == ()
    assert "no critical value where the rig slides steadily" in found.text()
    assert "no steady sliding from 1 N to 4 N: the surface at contact does not move" in found.text()
    assert found.to_json()["gaps"][0]["why"] == "the surface at contact does not move"


@pytest.mark.parametrize(("on", "told"), [(False, "without the dither"), (True, "friction averaged over the dither")])
def test_a_sweep_of_another_key_tells_whether_the_dither_counts(on, told):
    scene = rig.load("belt_dither", {"dither.enable": on})
    found = rig.sweep(scene, "load.force", [15.0, 20.0])
    modes = rig.modes(scene)
    expected = modes.dithered if on else modes.sliding
    assert found.largest[1] == pytest.approx(expected.modes[0].growth, rel=1e-9)
    assert told in found.text()
    assert found.to_json()["friction"] == told


def test_the_command_sweeps_and_draws(rig, tmp_path):
    sweep = ("modes", "belt", "--sweep", "drive.speed=50 mm/s:0.4 m/s:8")
    code, out, _ = rig(*sweep, "--figure", tmp_path / "a.png")
    assert (code, "207.944154168 mm/s: flutter" in out) == (0, True)
    assert (tmp_path / "a.png").stat().st_size > 10_000
    code, out, _ = rig(*sweep, "--json")
    assert json.loads(out)["critical"][0]["kind"] == "flutter"
    code, _, err = rig("modes", "belt", "--sweep", "drive.sped=0:1 N:1")
    assert (code, "did you mean drive.speed?" in err, "count = 1: must be" in err) == (2, True, True)


@pytest.fixture(scope="module")
def belt():
    return rig.load("belt")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("drive.sped=0:1:3", "did you mean drive.speed?"),
        ("friction.law=0:1:3", 'friction.law: is "stribeck" here, not a number; -p friction.law=... changes it'),
        ("drive.speed=0:1", "expected KEY=FROM:TO:COUNT"),
        ("drive.speed=0:fast:3", "to is 'fast m/s'; expected a number and a unit in m/s"),
        ("load.force=-10 N:10 N:5", "load.force = -10 N (and 1 more values): load.force = -10.0: must be at least 0 N"),
    ],
)
def test_what_is_wrong_is_told(belt, text, told):
    with pytest.raises(SceneError) as raised:
        Axis.parse(text, belt)
    assert told in str(raised.value)


@pytest.mark.parametrize(
    ("name", "axis", "first"),
    [
        ("two_dof", (0.1, 0.6, 11), (1.4621, 1.7111)),
        ("brake", (0.0, 0.7, 8), (2079.4, 2182.8)),
    ],
)
def test_a_sweep_names_the_pair_of_modes_that_meets_and_its_figure_shows_it_large(name, axis, first):
    found = rig.sweep(name, "friction.mu", np.linspace(*axis))
    [critical] = found.critical
    assert found.pair(critical) == pytest.approx(first, rel=1e-4)
    both = " and ".join(f"{hertz:.5g}" for hertz in first)
    assert f"the modes of {both} Hz meet (frequencies at {axis[0]:g})" in found.text()
    figure = found.plot()
    assert any(f"the modes of {both} Hz meet" in text.get_text() for text in figure.texts)
    frequency, locus = figure.axes[1], figure.axes[2]
    for axes in (frequency, locus):
        low, high = axes.get_ylim()
        assert low < first[0] < first[1] < high
        assert high - low < 1.4 * (first[1] - first[0])
    legend = [text.get_text() for text in frequency.get_legend().get_texts()]
    assert {"decays", "grows"} < {*legend}
    assert len(legend) == 4


def test_a_mode_that_grows_by_itself_meets_none():
    found = rig.sweep("disc_slider", "drive.speed", [1.0, 2.0, 3.0, 4.0])
    assert [found.pair(critical) for critical in found.critical] == [()] * len(found.critical) != []
