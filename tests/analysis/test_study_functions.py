"""Measures of a study that are functions of a run: what belongs to them, what they return, how they end."""

import numpy as np
import pytest

import rig as lab
from rig.analysis.studies import functions, prepared, study
from rig.analysis.studies.measures import evaluate
from rig.errors import SceneError, UsageError


@pytest.fixture(scope="module")
def belt():
    return lab.load("belt")


def test_a_function_without_a_file_is_computed_in_this_process_only(belt, tmp_path):
    work = prepared(belt, {"load.force": [10.0]}, [lambda run: 1.0], duration=0.01)
    assert work.unportable
    assert study(work, tmp_path).values.tolist() == [[1.0]]
    with pytest.raises(UsageError, match="worker processes cannot load it"):
        study(work, tmp_path, workers=2)


def test_functions_of_the_same_code_that_use_other_things_do_not_share_results(belt, tmp_path):
    """Names, closures: neither is in the code or the constants of a function."""

    def times(factor):
        return lambda run: factor * run.signals["velocity"].max()

    found = [
        study(prepared(belt, {"load.force": [10.0]}, [one], duration=0.05), tmp_path).values.item()
        for one in (times(1.0), times(2.0), lambda run: run.signals["velocity"].min())
    ]
    assert found[1] == 2.0 * found[0]
    assert found[2] < found[0]


@pytest.mark.parametrize("given", [None, "fast", "12", np.ones(2), 1j, (1.0, 5), (1.0, "m", "x")])
def test_what_is_no_number_is_told_as_the_function_returned_it(belt, tmp_path, given):
    found = study(prepared(belt, {"load.force": [10.0]}, [lambda run: given], duration=0.01), tmp_path)
    assert np.isnan(found.values).all()
    assert found.reasons[0].startswith("<lambda> returned ")
    assert found.reasons[0].endswith(": expected a number, or number and unit")


def test_values_of_a_function_in_several_units_are_converted_to_the_first(belt, tmp_path):
    told = {10.0: (10.0, "N"), 20.0: (2e4, "mN"), 30.0: (1.0, "m")}
    work = prepared(belt, {"load.force": [10.0, 20.0, 30.0]}, [lambda run: told[run.signals["normal_force"][0]]],
                    duration=0.01)  # fmt: skip
    found = study(work, tmp_path)
    assert found.units == ("N",)
    assert found.values[:2, 0].tolist() == pytest.approx([10.0, 20.0])
    assert found.reasons[2] == "<lambda> has the unit m here, N at other points"


def test_a_file_that_starts_a_study_when_it_is_loaded_is_told(belt, tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(
        "import rig\ndef one(run):\n    return 1.0\nrig.study('belt', {'load.force': [1.0]}, [one], duration=1)\n"
    )
    with pytest.raises((UsageError, SceneError), match="starts a study when it is loaded"):
        prepared(belt, {"load.force": [10.0]}, [f"{file}:one"])


def test_a_function_of_a_file_may_use_its_neighbours_and_its_faults_are_told(belt, tmp_path):
    (tmp_path / "beside.py").write_text("FACTOR = 2.0\n")
    file = tmp_path / "mine.py"
    file.write_text("from beside import FACTOR\ndef twice(run):\n    return FACTOR * run.time[-1], 's'\n")
    found = functions.function_of(f"{file}:twice")
    assert found.value(lab.simulate(belt, 0.5)) == (1.0, "s", "")
    with pytest.raises(UsageError, match="defines no function thrice"):
        functions.function_of(f"{file}:thrice")
    file.write_text("import json\ndef parsed(run):\n    return json.loads('nothing')\n")
    _, _, reason = functions.function_of(f"{file}:parsed").value(lab.simulate(belt, 0.01))
    assert reason.startswith("parsed: JSONDecodeError: ")
    assert reason.endswith(" (line 3)")


def test_a_module_beside_a_function_is_part_of_it(belt, tmp_path):
    beside, file = tmp_path / "deep" / "beside.py", tmp_path / "mine.py"
    beside.parent.mkdir()
    file.write_text("from deep import beside\ndef value(run):\n    return beside.FACTOR\n")
    digests = set()
    for factor in (1.0, 2.0):
        beside.write_text(f"FACTOR = {factor}\n")
        digests.add(prepared(belt, {"load.force": [10.0]}, [f"{file}:value"], duration=0.01).work.digest)
    assert len(digests) == 2


def test_a_function_that_changes_arrays_in_place_changes_no_other_measure(belt, tmp_path):
    file = tmp_path / "mine.py"
    file.write_text("def centred(run):\n    v = run.signals['displacement']\n    v -= v.mean()\n    return v.max()\n")
    named = "run.highest.displacement"
    one, other = (evaluate(belt, prepared(belt, {"load.force": [10.0]}, names, duration=0.5).measures, 0.5)["values"]
                  for names in ([f"{file}:centred", named], [named, f"{file}:centred"]))  # fmt: skip
    assert one.tolist() == other[::-1].tolist()
    assert one[0] < one[1]


@pytest.mark.parametrize("text", ["import sys\nsys.exit(3)", "raise SystemExit", "x ="])
def test_a_file_that_ends_when_it_is_loaded_is_told(tmp_path, text):
    file = tmp_path / "mine.py"
    file.write_text(text)
    with pytest.raises(UsageError, match=r"mine.py: (SystemExit|SyntaxError): "):
        functions.function_of(f"{file}:value")


def test_a_file_may_begin_with_a_mark_and_print(tmp_path, capsys):
    file = tmp_path / "mine.py"
    file.write_bytes(b"\xef\xbb\xbfprint('loaded')\ndef value(run):\n    return 1.0\n")
    functions.function_of(f"{file}:value")
    assert capsys.readouterr() == ("", "loaded\n")  # standard output may be a report in JSON


@pytest.mark.parametrize("name", ["seed", "reason", "sample"])
def test_a_function_named_like_a_column_is_refused(belt, tmp_path, name):
    file = tmp_path / "mine.py"
    file.write_text(f"def {name}(run):\n    return 1.0\n")
    with pytest.raises(UsageError, match=f"measure {name}: a column of the results has this name"):
        prepared(belt, {"load.force": lab.uniform(1.0, 2.0)}, [f"{file}:{name}"], duration=0.01)


def test_a_function_that_ends_its_process_is_a_row_with_one_worker_too(belt, tmp_path):
    file = tmp_path / "mine.py"
    file.write_text("import os\ndef gone(run):\n    os._exit(0)\n")
    found = study(prepared(belt, {"load.force": [10.0]}, [f"{file}:gone"], duration=0.01), tmp_path, workers=1)
    assert found.reasons[0].startswith("ended its worker twice: ")
