"""`make bench AGAINST=COMMIT`: both versions take the same cases in turns and come to the same bits."""

import platformdirs
import pytest

from benchmarks import against
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


def test_an_unknown_commit_is_refused():
    with pytest.raises(UsageError, match="--against: fatal"):
        against.unpacked("no-such-commit")
