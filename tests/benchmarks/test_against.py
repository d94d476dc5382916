"""`make bench AGAINST=COMMIT`: both versions take the same cases in turns and come to the same bits."""

import platformdirs
import pytest

from benchmarks import against, cases
from benchmarks.__main__ import summary
from benchmarks.one_version import CASES
from rig.errors import UsageError

pytestmark = pytest.mark.skipif(not (against.ROOT / ".git").exists(), reason="needs the history of a checkout")


@pytest.fixture(autouse=True)
def apart(tmp_path, monkeypatch):
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda _: tmp_path)


def test_a_version_is_compared_with_itself(monkeypatch):
    monkeypatch.setattr(against, "CASES", {"exact, bare": CASES["exact, bare"]})
    [comparison] = against.compared(against.ROOT, rounds=3).values()
    assert comparison["same_bits"]
    assert 0.0 < comparison["speed"] < float("inf")


def test_kernels_have_a_floor_and_whole_runs_have_none():
    group = cases.versions("HEAD")
    comparisons = {name: {"speed": 0.94} for name in CASES} | {
        "run belt": {"skipped": "the other version cannot run it"}
    }
    missed, lines = summary({"against": group}, {"against": comparisons})
    kernels = [name for name, case in CASES.items() if case.method]
    assert missed == len(kernels) == sum("MISSED" in line for line in lines[2:])
    assert f"{len(CASES) - missed - 1} ok, 1 not measured" in lines[0]


def test_another_version_is_unpacked_once():
    place = against.unpacked("HEAD")
    assert (place / "rig" / "__init__.py").is_file()
    assert against.unpacked("HEAD") == place
    assert [path.name for path in place.parent.iterdir()] == [place.name]


def test_an_unknown_commit_is_refused():
    with pytest.raises(UsageError, match="--against: fatal"):
        against.unpacked("no-such-commit")
