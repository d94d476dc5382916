"""The golden recordings: small, in the table, and the same when they are simulated again."""

from pathlib import Path

import pytest

from rig.bench.verify import verify
from rig.record import reader

FOLDER = Path(__file__).parents[2] / "recordings"
GOLDEN = sorted((FOLDER / "golden").glob("*.mcap"))


def test_there_is_one():
    assert GOLDEN


@pytest.mark.parametrize("path", GOLDEN, ids=lambda path: path.stem)
def test_it_is_small_and_in_the_table(path):
    assert path.stat().st_size < 1_000_000
    assert f"`{path.name}`" in (FOLDER / "README.md").read_text()


@pytest.mark.parametrize("path", GOLDEN, ids=lambda path: path.stem)
def test_it_comes_out_the_same(path):
    found = verify(path)
    assert found.passed, found.text()
    assert found.compared > 50_000


def test_a_changed_number_is_found(monkeypatch):
    run = reader.open(GOLDEN[0])
    run.signals["velocity"][1000] += 1e-5
    monkeypatch.setattr(reader, "open", lambda path: run)
    found = verify(GOLDEN[0])
    assert not found.passed
    assert "velocity parts at t = " in found.text()
