"""The search for the smallest value of a measure: it finds it, or says why there is none."""

import json

import pytest

import rig as lab
from rig.analysis.studies.search import prepared, search
from rig.errors import UsageError

RANGES = {"load.force": "10 N:30 N"}


def distance(run):
    """From 20 N, of the load of the scene."""
    return (json.loads(run.scene)["parameters"]["load"]["force"] - 20.0) ** 2, "N^2"


@pytest.fixture(scope="module")
def belt():
    return lab.load("belt")


@pytest.fixture(scope="module")
def found(belt, tmp_path_factory):
    folder = tmp_path_factory.mktemp("searches")
    return lab.optimise(belt, RANGES, distance, evaluations=45, duration=0.002, folder=folder, workers=1)


def test_the_smallest_value_is_found(found):
    assert found.parameters["load.force"] == pytest.approx(20.0, abs=0.2)
    assert found.value == found.values.min() < 0.04
    assert (found.unit, len(found.values)) == ("N^2", 45)
    assert "smallest distance" in found.text()
    head, *lines = found.csv().splitlines()
    assert head == f"load.force [N],{found.measure} [N^2],reason"
    assert len(lines) == 45


def test_a_search_without_any_value_is_told(belt, tmp_path):
    work = prepared(belt, {"drive.speed": "1 m/s:2 m/s"}, "cycle.amplitude", evaluations=15)
    found = search(work, tmp_path, 1)
    assert found.best is None
    assert "no point has a value of cycle.amplitude" in found.text()
    assert len(found.values) == 15
    assert "points have no value: no limit cycle" in found.text()


@pytest.mark.parametrize(
    ("over", "more", "told"),
    [
        ({"load.force": "30 N:10 N"}, {}, "the range must rise, from 30 N upwards"),
        ({"load.forse": "10 N:30 N"}, {}, "load.forse: is not a numeric parameter of this scene; did you mean"),
        (RANGES, {"evaluations": 3}, "evaluations = 3: must be at least 15 for 1 parameter"),
    ],
)
def test_what_is_wrong_is_named(belt, over, more, told):
    with pytest.raises(UsageError, match=told):
        prepared(belt, over, **{"measure": "cycle.amplitude", **more})


def test_the_command_writes_table_and_figure(rig, tmp_path):
    asked = ("optimise", "belt", "--over", "load.force=10 N:30 N", "--out", tmp_path, "--workers", 1)
    code, _, err = rig(*asked)
    assert (code, "state one measure" in err) == (2, True)
    code, out, _ = rig(*asked, "--maximise", "cycle.amplitude", "--evaluations", 15)
    assert (code, "largest cycle.amplitude" in out) == (0, True)
    folder = next(tmp_path.iterdir())
    assert {"search.csv", "search.png"} <= {path.name for path in folder.iterdir()}
