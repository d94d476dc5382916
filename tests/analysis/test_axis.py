"""An axis of a sweep: read with units, and everything that can be wrong with it told at once."""

import math
from functools import reduce

import numpy as np
import pytest

import rig
from rig.analysis.axis import Axis, axes, fixed, sweepable
from rig.errors import SceneError
from rig.scenes import shipped


@pytest.fixture(scope="module")
def belt():
    return rig.load("belt")


def test_both_ends_may_have_units_of_their_own(belt):
    axis = Axis.parse("drive.speed=50 mm/s:0.4 m/s:8", belt)
    assert (axis.key, axis.unit, axis.shown) == ("drive.speed", "m/s", "mm/s")
    assert axis.values == pytest.approx(np.linspace(0.05, 0.4, 8), rel=1e-12)
    assert axis.shown_values == pytest.approx(np.linspace(50.0, 400.0, 8), rel=1e-12)
    assert axis.label == "drive.speed [mm/s]"
    assert axis.title == "belt speed [mm/s]"
    assert axis.text(0.05) == "50 mm/s"


def test_an_end_without_a_unit_takes_that_of_the_other():
    axis = Axis.parse("drive.speed=0:60 rpm:3", rig.load("pendulum"))
    assert axis.values == pytest.approx([0.0, math.pi, 2.0 * math.pi], rel=1e-12)


def test_numbers_are_si_and_an_axis_may_run_downwards(belt):
    assert Axis.parse("load.force=30:10:3", belt).values == (30.0, 20.0, 10.0)
    assert Axis.parse("friction.mu_static=0.3:0.5:3", belt).label == "friction.mu_static"


def test_the_scene_at_a_value(belt):
    axis = Axis.parse("load.force=10:30:3", belt)
    assert axis.at(belt, 10.0).parameters.load.force == 10.0
    assert belt.parameters.load.force == 20.0


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("drive.sped=0:1:3", "did you mean drive.speed?"),
        ("friction.law=0:1:3", 'friction.law: is "stribeck" here, not a number; -p friction.law=... changes it'),
        ("drive.speed=0:1", "expected KEY=FROM:TO:COUNT"),
        ("drive.speed", "expected KEY=FROM:TO:COUNT"),
        ("drive.speed=0:1:1", "count = 1: must be a whole number from 2"),
        ("drive.speed=0:1:2.5", "count = 2.5: must be a whole number from 2"),
        ("drive.speed=0 N:1 N:3", "from is '0 N'; expected a unit that converts to m/s"),
        ("drive.speed=0:fast:3", "to is 'fast m/s'; expected a number and a unit in m/s"),
        ("drive.speed=1:1:3", "the ends are the same"),
        ("load.force=-10 N:10 N:5", "load.force = -10 N (and 1 more values): load.force = -10.0: must be at least 0 N"),
    ],
)
def test_what_is_wrong_is_told(belt, text, told):
    with pytest.raises(SceneError) as raised:
        Axis.parse(text, belt)
    assert told in str(raised.value)


def test_a_figure_names_the_parameters_that_it_holds_constant(belt):
    speed, load = axes(belt, {"--x": "drive.speed=0.05 m/s:0.4 m/s:8", "--y": "load.force=10 N:20 N:2"})
    friction = "static coefficient of friction 0.5, dynamic coefficient of friction 0.18"
    assert fixed(belt, [speed]) == f"load 20 N, {friction}"
    assert fixed(belt, [speed, load]) == friction


def test_the_faults_of_all_axes_are_told_at_once(belt):
    with pytest.raises(SceneError) as raised:
        axes(belt, {"--x": "drive.sped=0:1:0", "--y": "load.force=0 m:1 N:3"})
    assert len(raised.value.faults) == 3
    assert axes(belt, {"--x": "drive.speed=0:1:3", "--y": None})[0].key == "drive.speed"
    with pytest.raises(SceneError, match="more than one axis"):
        axes(belt, {"--x": "drive.speed=0:1:3", "--y": "drive.speed=0:1:4"})


@pytest.mark.parametrize("name", shipped.names())
def test_a_figure_names_every_parameter_in_words(name):
    scene = rig.load(name)
    for key, unit in sweepable(scene.parameters):
        value = reduce(
            lambda part, field: part[field] if isinstance(part, dict) else getattr(part, field),
            key.split("."),
            scene.parameters,
        )
        if value is None:
            continue
        try:
            title = Axis.of(key, [value, value * 1.001 or 0.001], scene).title
        except SceneError:  # this value cannot be another one
            continue
        assert key not in title
        assert not set("._") & set(title.partition(" [")[0])
        assert unit == "1" or title.endswith(f" [{unit}]")


def test_a_parameter_of_a_controller_is_named_in_words():
    axis = Axis.parse("controllers.nf.gain=1:2:3", rig.load("belt_normal_force"), "nf")
    assert axis.title.startswith("nf gain")
