"""Results that leave controllers out say so themselves: as text, as HTML and as JSON, once and in one way."""

from dataclasses import replace

import pytest

import rig
from rig.results import html_of

SPEEDS, LOADS = "drive.speed=0.1 m/s:0.2 m/s:2", "load.force=18 N:22 N:2"
RANGE = "drive.speed=0.2 m/s:0.8 m/s"


def regions(scene, folder):
    from rig.analysis.linear.regions import regions
    from rig.scenes.axis import Axis

    return regions(scene, Axis.parse(SPEEDS, scene), Axis.parse(LOADS, scene))


ALONE = {
    "modes": lambda scene, folder: rig.modes(scene),
    "sweep": lambda scene, folder: rig.sweep(scene, "drive.speed", (0.1, 0.2)),
    "cycle": lambda scene, folder: rig.limit_cycle(scene),
    "no cycle": lambda scene, folder: rig.limit_cycle(scene, longest=0.01),
    "map": lambda scene, folder: rig.map(scene, SPEEDS, runs=("near",), folder=folder, workers=1, longest=0.5),
    "regions": regions,
    "curves": lambda scene, folder: rig.branches(scene, RANGE, start=["hopf"], points=20, second=LOADS, folder=folder),
    "study": lambda scene, folder: rig.study(
        scene, {"load.force": [18.0, 22.0]}, ["modes.growth", "run.rms"], duration=0.05, folder=folder, workers=1
    ),
    "search": lambda scene, folder: rig.optimise(
        scene, {"load.force": (18.0, 22.0)}, "modes.growth", evaluations=15, folder=folder, workers=1
    ),
}


def said(result, text):
    """How often the text, the HTML and the JSON of a result contain a text."""
    return result.text().count(text), html_of(result.text()).count(text), str(result.to_json()).count(text)


@pytest.mark.parametrize(
    "analysis", [pytest.param(name, marks=[pytest.mark.slow] * (name == "curves")) for name in ALONE]
)
def test_an_analysis_of_the_plant_alone_names_the_controllers(analysis, tmp_path):
    scene = rig.load("belt_normal_force", {"load.force": "20 N"})
    result = ALONE[analysis](scene, tmp_path / "with")
    assert said(result, "plant alone: without controller nf") == (1, 1, 1)
    bare = replace(scene, controllers={})
    assert said(ALONE[analysis](bare, tmp_path / "bare"), "plant alone") == (0, 0, 0)


def test_measures_of_whole_runs_leave_nothing_out(tmp_path):
    scene, loads = rig.load("belt_normal_force"), {"load.force": [18.0, 22.0]}
    result = rig.study(scene, loads, ["run.rms"], duration=0.05, folder=tmp_path, workers=1)
    assert said(result, "plant alone") == (0, 0, 0)


def test_a_closed_loop_names_the_controllers_that_stay_open():
    one = rig.load("belt_normal_force")
    both = replace(one, controllers={**one.controllers, "other": one.controllers["nf"]})
    sweeps = [rig.sweep(scene, "drive.speed", (0.1, 0.2), "nf") for scene in (one, both)]
    loops = [rig.loop(scene, "nf") for scene in (one, both)]
    for alone, beside in (sweeps, loops):
        assert said(alone, "left open") == (0, 0, 0)
        assert said(beside, "left open: other") == (1, 1, 1)
