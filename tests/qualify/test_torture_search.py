"""Random search over a box: it holds where the physics is sound, and what breaks a case becomes a smaller one."""

import pytest

from rig.errors import UsageError
from rig.qualify.torture import cells as room
from rig.qualify.torture import search as hunt
from rig.qualify.torture.case import load, read
from rig.qualify.torture.results import CellResult


def test_default_holds_in_the_box(tmp_path):
    assert hunt.search(load("belt_at_rest"), examples=4, folder=tmp_path) is None


def test_what_breaks_is_shrunk_and_kept(tmp_path, monkeypatch):
    """A stand-in for a defect: the default is called red where damping is above 2.5."""
    case = load("belt_stick_slip")

    def defect(changed, quick, methods):
        bad = changed.set["body.damping"] > 2.5
        verdict = CellResult("red", "energy", "too much") if bad else CellResult("green")
        yield room.Cell(changed.name, "exact", 1e-3, True, verdict, 0.0, {})

    monkeypatch.setattr(hunt, "cells", defect)
    found = hunt.search(case, examples=30, folder=tmp_path)
    assert found is not None
    path, cell = found
    assert cell.result.reason == "energy"
    kept = read(path)
    assert 2.5 < kept.set["body.damping"] < 2.51  # the simplest that breaks it
    assert kept.set["drive.speed"] == case.box["drive.speed"][0]
    assert kept.duration == case.duration
    assert "found by random search" in kept.title


def test_a_case_without_a_box_is_told():
    with pytest.raises(UsageError, match="has no box"):
        hunt.search(load("pause"))
