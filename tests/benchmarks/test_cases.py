"""`make bench`: its summary says how far each case is from its limit, the nearest first."""

import json

import pytest

from benchmarks import cases
from benchmarks.__main__ import main
from benchmarks.cases import Case, Group
from rig.errors import BusError


def fails(_):
    raise BusError("no answer within 0.5 s")


GROUPS = {
    "kernel": Group(
        "kernel", lambda asked: {"rtf": 3e4, "rows": [{"law": "c", "rtf": 2.0}]}, (Case("rtf", "fast", 1e4, "x"),)
    ),
    "twin": Group("twin", lambda asked: {"ratio": 1.0}, (Case("ratio", "beside C", 1.1, "of C", at_most=True),)),
    "loop": Group(
        "loop",
        lambda asked: {"run": {"verdict": "VALID"}, "seconds": asked.seconds},
        (Case("run.verdict", "VALID", 0.0, "verdict", at_most=True), Case("absent", "no browser", 1.0, "s")),
    ),
}


@pytest.fixture
def groups(monkeypatch):
    """The groups of these tests instead of those of the command, whose options stay."""
    monkeypatch.setattr(cases, "GROUPS", GROUPS)
    monkeypatch.setattr("benchmarks.__main__.GROUPS", GROUPS)


def test_the_summary_begins_with_the_case_nearest_to_its_limit(groups, capsys, tmp_path):
    assert main(["--json", str(tmp_path / "kept.json")]) == 0
    head, _, _, *rows = capsys.readouterr().out.partition("\n\nkernel:")[0].splitlines()
    assert head.startswith("4 cases: 0 MISSED, 3 ok, 1 not measured")
    assert [row.split()[:2] for row in rows[:2]] == [["ok", "1.10"], ["ok", "3.00"]]
    assert json.loads((tmp_path / "kept.json").read_text())["loop"]["seconds"] == 60.0


@pytest.mark.parametrize(("measure", "word"), [(lambda _: {"ratio": 1.2}, "0.92"), (fails, "no answer within 0.5 s")])
def test_a_missed_limit_fails(groups, monkeypatch, capsys, measure, word):
    monkeypatch.setitem(GROUPS, "twin", GROUPS["twin"]._replace(measure=measure))
    assert main([]) == 1
    told = capsys.readouterr().out
    assert "1 MISSED" in told.partition("\n")[0]
    assert told.splitlines()[3].split()[0] == "MISSED"
    assert word in told
