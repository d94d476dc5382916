"""What the matrix leaves behind: JSON, JUnit, a picture; the command's exit code."""

import json
from xml.etree import ElementTree

import pytest

from rig.qualify import torture
from rig.qualify.torture import report
from rig.qualify.torture.cells import Cell
from rig.qualify.torture.results import CellResult

CELLS = [
    Cell("one", "exact", 1e-3, True, CellResult("green"), 0.1, {"events": 3}, 0.96),
    Cell("one", "rk4", 1e-3, False, CellResult("red", "missed event", "1 of 39"), 0.1, {}),
    Cell("two", "exact", 1e-3, True, CellResult("red", "energy", "too much"), 0.1, {}),
    Cell("two", "exact", 1e-4, True, CellResult("amber", "cost", "too long"), 2.0, {}),
]


def test_report(tmp_path):
    report.keep(CELLS, tmp_path, True)
    told = json.loads((tmp_path / "matrix.json").read_text())
    assert told["quick"] is True
    assert [cell["colour"] for cell in told["cells"]] == ["green", "red", "red", "amber"]
    assert told["cells"][1]["reason"] == "missed event"
    assert told["cells"][0]["counts"] == {"events": 3}
    assert [cell["speed"] for cell in told["cells"]] == [0.96, None, None, None]  # slower than the clock, and green
    suite = ElementTree.parse(tmp_path / "junit.xml").getroot()
    assert suite.attrib["tests"] == "4"
    assert suite.attrib["failures"] == "2"  # of the default: one red, one amber
    assert suite.attrib["skipped"] == "1"
    assert [one.attrib["classname"] for one in suite if one.find("failure") is not None] == ["two", "two"]
    assert (tmp_path / "matrix.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "matrix.svg").stat().st_size > 1000


@pytest.mark.parametrize(("last", "code"), [(1, 0), (4, 1)])
def test_exit_code_is_that_of_the_default(tmp_path, monkeypatch, capsys, last, code):
    from rig.cli.app import program

    monkeypatch.setattr(torture, "matrix", lambda names, quick, report, progress: CELLS[:last] + CELLS[1:2])
    with pytest.raises(SystemExit) as ended:
        program(["tool", "torture", "--case", "one", "--out", str(tmp_path)])
    assert ended.value.code == code
    printed = capsys.readouterr().out
    assert "missed event" in printed
    assert "0.96" in printed
