"""Regions of instability: what they say of the slider on a disc, and of a rig whose answer is known in closed form."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import rig
from rig.analysis.linear.regions import regions, sliding
from rig.scenes.axis import axes
from rig.view.palette import put

LIU = json.loads((Path(__file__).parents[1] / "reference" / "liu_disc.json").read_text())


def found(scene, x, y, changes=None):
    loaded = rig.load(scene, changes or {})
    return regions(loaded, *axes(loaded, {"--x": x, "--y": y}))


def test_band_of_falling_friction_grows_with_the_preload():
    """Case b, edges of the reference."""
    got = found("disc_slider", "drive.speed=0.5:6 rad/s:4", "load.force=50:200 N:4")
    for load, row in zip(got.y.values, got.edges):
        for one in (one for one in LIU["RI_edges"] if (one["case"], one["F0"]) == ("b", load)):
            assert [edge for edge, _ in row] == pytest.approx([one["edges"][0][0]], abs=1e-4)
    assert [unstable for row in got.edges for _, unstable in row] == [False] * 4
    assert np.all(np.diff([row[0][0] for row in got.edges]) > 0.0)
    assert "0.5 rad/s to 2.703" in got.text()
    assert got.exists.all()


def test_dither_leaves_a_thin_strip():
    """Just above the speed at which it reverses slip: at 100 N from 6.0 rad/s on, reference."""
    shake = {"dither.amplitude": 0.6 * 20.0 * LIU["omega_ref"]}
    got = found("disc_slider_dither", "drive.speed=1:8 rad/s:8", "load.force=100:101 N:2", shake)
    expected = [tuple(edge) for edge in LIU["RI_edges_dither"][0]["edges"][:2]]
    assert got.edges[0] == tuple((pytest.approx(edge, abs=2e-4), unstable) for edge, unstable in expected)


def test_edges_do_not_depend_on_the_direction_of_an_axis():
    """Values 20 rad/s apart, and between two of them a band of stable sliding 2 rad/s wide."""
    up = found("disc_slider_a", "drive.speed=905:985 rad/s:5", "load.force=20:50 N:2", {"limits.height": "none"})
    down = found("disc_slider_a", "drive.speed=985:905 rad/s:5", "load.force=20:50 N:2", {"limits.height": "none"})
    for row, turned in zip(up.edges, down.edges):
        assert [u for _, u in row] == [True, False, True, False, True]
        assert sorted(turned) == [(pytest.approx(edge, rel=1e-7), unstable) for edge, unstable in row]


def test_regions_agree_with_the_closed_form_of_a_falling_law(tmp_path):
    """Belt, characteristic B: growth = (slope N - d) / 2 m."""
    got = found("belt_b", "load.force=1:5 N:5", "body.damping=1:3 N*s/m:3")
    slope, mass = 0.8, 5.0  # of the scene
    expected = (slope * np.array(got.x.values) - np.array(got.y.values)[:, None]) / (2.0 * mass)
    assert got.growth == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert [row[0][0] for row in got.edges] == pytest.approx(np.array(got.y.values) / slope, rel=1e-6)
    put(got.plot(), tmp_path / "regions.png")
    assert (tmp_path / "regions.png").stat().st_size > 10_000
    lines = got.csv().splitlines()
    assert lines[0] == "load.force [N],body.damping [N*s/m],growth [1/s],frequency [Hz],exists"
    assert len(lines) == 16
    assert np.array(got.to_json()["growth"]).shape == (3, 5)


def test_an_edge_next_to_a_point_without_sliding_is_found():
    """Belt, characteristic A: slope(v) F0 = d. Nothing presses at 0 N, the belt stands still at 0 m/s."""
    slopes = [6.4 * math.exp(-v / 0.05) for v in (0.05, 0.175)]
    got = found("belt", "load.force=0:40 N:9", "drive.speed=0.05:0.175 m/s:2")
    assert list(got.edges) == [((pytest.approx(2.0 / slope, rel=1e-8), True),) for slope in slopes]
    assert np.isnan(got.growth[:, 0]).all()
    assert "no steady sliding at 2 of 18 points" in got.text()
    assert "nothing presses contact" in got.text()
    got = found("belt", "drive.speed=0:0.4 m/s:9", "load.force=0:20 N:2")
    limit = pytest.approx(0.05 * math.log(64.0), rel=1e-8)
    assert got.edges == ((), ((0.0, True), (limit, False)))
    assert "no steady sliding" in got.text()


def at_speed(speed):
    """Where the forces on the slider on a disc balance."""
    return sliding(rig.load("disc_slider", {"load.force": 110.0}), {"drive.speed": speed})


@pytest.mark.slow
def test_sliding_ends_where_the_height_passes_its_limit():
    got = found("disc_slider", "drive.speed=780.2:1040.1:2", "load.force=110:111:2")
    ends, begins = (
        brentq(lambda speed: at_speed(speed).x[1] - 0.01, *bracket, xtol=1e-9)
        for bracket in ((911.9, 911.97), (918, 919))
    )
    assert [edge for edge, _ in got.edges[0]][:3] == pytest.approx([911.862394, ends, begins], abs=1e-6)
    assert [unstable for _, unstable in got.edges[0]][:3] == [True, False, True]


def test_a_motion_that_rounding_lets_grow_is_no_band():
    """The charge of the open stack moves nothing, and nothing damps the two masses: their growth is none."""
    (row,) = found("brake_shunt", "friction.mu=0:1.5:7", "drive.speed=1:3:2").edges[:1]
    assert [unstable for _, unstable in row] == [True]
    [critical] = rig.sweep("brake_shunt", "friction.mu", [0.3, 1.5]).critical
    assert row[0][0] == pytest.approx(critical.value, rel=1e-6)
    undamped = {"spring_1.damping": 0.0, "spring_2.damping": 0.0}
    got = found("two_dof", "contact.stiffness=10:300:6", "friction.mu=0.1:0.6:2", undamped)
    assert not got.edges[0]
    assert got.growth[0].tolist() == [0.0] * 6
    assert "nowhere" in next(line for line in got.text().splitlines() if line.strip().startswith("0.1 "))
