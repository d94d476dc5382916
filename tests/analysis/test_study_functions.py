"""Measures of a study that are functions of a run: what belongs to them, what they return, how they end."""

import numpy as np
import pytest
from full_disk import largest_file

import rig as lab
from rig.analysis.studies import prepared, study
from rig.analysis.studies.functions import function_of
from rig.analysis.studies.measures import evaluate
from rig.errors import OutputError, SceneError, UsageError


@pytest.fixture(scope="module")
def belt():
    return lab.load("belt")


@pytest.fixture
def file(tmp_path):
    """Writes the text of a file of measures."""

    def write(text):
        (tmp_path / "mine.py").write_text(text)
        return tmp_path / "mine.py"

    return write


def work_of(belt, *measures, over=(10.0,), duration=0.01):
    return prepared(belt, {"load.force": [*over]}, [*measures], duration=duration)


def test_a_function_without_a_file_is_computed_in_this_process_only(belt, tmp_path):
    work = work_of(belt, lambda run: 1.0)
    assert study(work, tmp_path).values.tolist() == [[1.0]]
    with pytest.raises(UsageError, match="worker processes cannot load it"):
        study(work, tmp_path, workers=2)


@pytest.mark.parametrize("given", [None, np.ones(2)])
def test_what_is_no_number_is_told_as_the_function_returned_it(belt, tmp_path, given):
    found = study(work_of(belt, lambda run: given), tmp_path)
    assert np.isnan(found.values).all()
    assert found.reasons[0].startswith("<lambda> returned ")
    assert found.reasons[0].endswith(": expected a number, or number and unit")


def test_values_of_a_function_in_several_units_are_converted_to_the_first(belt, tmp_path):
    told = {10.0: (10.0, "N"), 20.0: (2e4, "mN"), 30.0: (1.0, "m")}
    found = study(work_of(belt, lambda run: told[run.signals["normal_force"][0]], over=told), tmp_path)
    assert found.units == ("N",)
    assert found.values[:2, 0].tolist() == pytest.approx([10.0, 20.0])
    assert found.reasons[2] == "<lambda> has the unit m here, N at other points"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            "import rig\ndef value(run):\n    return 1.0\n"
            "rig.study('belt', {'load.force': [1.0]}, [value], duration=1)\n",
            "starts a study when it is loaded",
        ),
        ("import sys\nsys.exit(3)", r"mine.py: SystemExit: 3"),
        ("x =", r"mine.py: SyntaxError: "),
        ("def other(run):\n    return 1.0\n", "defines no function value"),
    ],
)
def test_a_file_that_defines_no_measure_is_told(belt, file, text, told):
    with pytest.raises((UsageError, SceneError), match=told):
        work_of(belt, f"{file(text)}:value")


def test_a_function_of_a_file_may_use_its_neighbours_which_are_part_of_it_and_its_faults_are_told(belt, file, tmp_path):
    (tmp_path / "deep").mkdir()
    digests = set()
    for factor in (1.0, 2.0):
        (tmp_path / "deep" / "beside.py").write_text(f"FACTOR = {factor}\n")
        mine = file("from deep import beside\ndef times(run):\n    return beside.FACTOR * run.time[-1], 's'\n")
        digests.add(work_of(belt, f"{mine}:times").work.digest)
    assert len(digests) == 2
    run = lab.simulate(belt, 0.5)
    assert function_of(f"{mine}:times").value(run)[1:] == ("s", "")
    mine = file("import json\ndef parsed(run):\n    return json.loads('nothing')\n")
    _, _, reason = function_of(f"{mine}:parsed").value(run)
    assert reason.startswith("parsed: JSONDecodeError: ")
    assert reason.endswith(" (line 3)")


def test_a_function_that_changes_arrays_in_place_changes_no_other_measure(belt, file):
    mine = file("def centred(run):\n    v = run.signals['displacement']\n    v -= v.mean()\n    return v.max()\n")
    named = [f"{mine}:centred", "run.highest.displacement"]
    one, other = (evaluate(belt, work_of(belt, *names).measures, 0.5)["values"] for names in (named, named[::-1]))
    assert one.tolist() == other[::-1].tolist()
    assert one[0] < one[1]


def test_files_that_do_not_fit_on_the_disk_are_told_and_the_next_call_makes_them(belt, tmp_path):
    asked = {"duration": 2.0, "keep": "run.highest.displacement > 0 mm", "out": tmp_path, "workers": 1}
    over, told = ({"load.force": [10.0]}, ["run.highest.displacement"]), "cannot be written: File too large"
    with (
        largest_file(20_000),
        pytest.raises(OutputError, match=rf"000000\.mcap {told}\. .* kept in .*; the same command"),
    ):
        lab.study(belt, *over, **asked)
    assert not [*next(tmp_path.iterdir()).joinpath("runs").iterdir()]
    found = lab.study(belt, *over, **asked)
    assert lab.open(found.recordings[0]).time[-1] == 2.0
    with largest_file(4096), pytest.raises(OutputError, match=rf"new.found\.nc {told}$"):
        found.save(tmp_path / "new" / "found.nc")
    assert not [*(tmp_path / "new").iterdir()]
