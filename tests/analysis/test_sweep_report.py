"""Sweeps as reports: text, JSON, figure and the command."""

import json

import numpy as np
import pytest
from swept_matrices import beside, over, turning

import rig
from rig.analysis import figures
from rig.cli import app
from rig.view.palette import put


def test_where_nothing_slides_the_report_says_why_and_not_none():
    found = rig.sweep(rig.load("belt", {"drive.speed": 0.0}), "load.force", np.linspace(1.0, 4.0, 4))
    assert found.critical == ()
    assert "no critical value where the rig slides steadily" in found.text()
    assert "no steady sliding from 1 N to 4 N: the surface at contact does not move" in found.text()
    assert found.to_json()["gaps"][0]["why"] == "the surface at contact does not move"


def test_a_report_is_plain_and_a_reader_finds_the_value():
    found = rig.sweep("belt", "drive.speed", np.linspace(0.05, 0.4, 8))
    told = json.loads(json.dumps(found.to_json()))
    assert told["critical"][0]["value"] == found.critical[0].value
    assert len(told["branches"]) == 1
    assert "0.207944154168 m/s: flutter at 3.55881 Hz, stable above" in found.text()


def test_a_sweep_of_the_dither_averages_the_friction_and_says_so():
    amplitudes = [0.03, 0.05, 0.1]
    found = rig.sweep("belt_dither", "dither.amplitude", amplitudes)
    ours = [rig.modes(rig.load("belt_dither", {"dither.amplitude": a})).dithered.modes[0].growth for a in amplitudes]
    assert found.largest == pytest.approx(ours, rel=1e-9)
    assert found.largest[0] > found.largest[2]
    assert "friction averaged over the dither" in found.text()


@pytest.mark.parametrize(("on", "told"), [(False, "without the dither"), (True, "friction averaged over the dither")])
def test_a_sweep_of_another_key_tells_whether_the_dither_counts(on, told):
    scene = rig.load("belt_dither", {"dither.enable": on})
    found = rig.sweep(scene, "load.force", [15.0, 20.0])
    modes = rig.modes(scene)
    expected = modes.dithered if on else modes.sliding
    assert found.largest[1] == pytest.approx(expected.modes[0].growth, rel=1e-9)
    assert told in found.text()
    assert found.to_json()["friction"] == told


def lines(found):
    """Style and points [n, 2] of every curve in the plot of growth."""
    figure = figures.sweep_figure(found)
    return [(line.get_linestyle(), line.get_xydata()) for line in figure.axes[0].lines if len(line.get_xydata()) > 2]


def test_no_curve_of_the_figure_joins_the_sides_of_a_jump():
    found = over(lambda p: beside(turning(2.0 - 3.0 * (p > 0.44), 9.0), turning(-5.0, 30.0)))
    [jump] = found.critical
    for _, points in lines(found):
        sides = points[:, 0] > jump.value
        joined = np.isfinite(points[:-1]).all(axis=1) & np.isfinite(points[1:]).all(axis=1)
        assert not (joined & (sides[:-1] != sides[1:])).any()


def test_growing_branches_are_dashed_and_decaying_ones_solid():
    drawn = lines(over(lambda p: beside(turning(p - 0.44, 9.0), turning(-5.0, 30.0))))
    solid = np.concatenate([points for style, points in drawn if style == "-"])
    dashed = np.concatenate([points for style, points in drawn if style == "--"])
    assert np.nanmax(solid[:, 1]) == pytest.approx(-0.04)
    assert np.nanmax(dashed[:, 1]) == pytest.approx(0.56)
    assert np.nanmin(dashed[:, 1]) == pytest.approx(-0.04)  # the line over the sign change is dashed, not missing


def test_the_figure_is_drawn(tmp_path):
    from matplotlib.image import imread

    put(rig.sweep("pin", "friction.mu", np.linspace(0.0, 1.5, 7)).plot(), tmp_path / "jams.png")
    runners = rig.load("belt", {"drive.speed": 0.0})
    put(rig.sweep(runners, "load.force", np.linspace(1.0, 4.0, 4)).plot(), tmp_path / "nothing.png")
    found = rig.sweep("north", "friction.mu", np.linspace(0.1, 0.5, 9))
    put(found.plot(), tmp_path / "locus.png")
    pixels = imread(tmp_path / "locus.png")
    assert pixels.shape[:2] == (825, 1600)
    assert len(np.unique(pixels.reshape(-1, pixels.shape[2]), axis=0)) > 500


def command(capsys, *arguments):
    try:
        app.run([str(a) for a in arguments])
    except SystemExit as left:
        said = capsys.readouterr()
        return left.code or 0, said.out, said.err
    raise AssertionError


def test_the_command_sweeps_and_draws(capsys, tmp_path):
    sweep = ("modes", "belt", "--sweep", "drive.speed=50 mm/s:0.4 m/s:8")
    code, out, _ = command(capsys, *sweep, "--figure", tmp_path / "a.png")
    assert code == 0
    assert "207.944154168 mm/s: flutter" in out
    assert (tmp_path / "a.png").stat().st_size > 10_000
    code, out, _ = command(capsys, *sweep, "--json")
    assert json.loads(out)["critical"][0]["kind"] == "flutter"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--sweep", "drive.sped=0:1 N:1"), ["did you mean drive.speed?", "count = 1: must be a whole number from 2"]),
        (("--sweep", "body=0:1:5"), ["is not a numeric parameter of this scene"]),
    ],
)
def test_nonsense_is_refused_in_words(capsys, arguments, told):
    code, _, err = command(capsys, "modes", "belt", *arguments)
    assert code == 2
    assert all(one in err for one in told)


@pytest.mark.slow
def test_nothing_critical_is_told_where_nothing_slides():
    """Between two values of this sweep the contact would have to pull; a fine sweep tells the same values."""
    found = rig.sweep(rig.load("disc_slider", {"load.force": 110.0}), "drive.speed", [780.2, 1040.1])
    (first, *_) = found.gaps
    assert (first.start, first.end) == (pytest.approx(911.974, abs=1e-3), pytest.approx(917.596, abs=1e-3))
    assert "would have to pull" in first.why
    assert not [one.value for one in found.critical for gap in found.gaps if gap.start < one.value < gap.end]
    told = np.array([one.value for one in found.critical])
    for value in (911.862394, 917.979715, 918.267465):
        assert np.abs(told - value).min() < 1e-6
