"""`make bench AGAINST=COMMIT`: both versions take the same cases in turns and come to the same bits."""

import platformdirs
import pytest

from rig.errors import UsageError
from rig.qualify.benchmarks import against
from rig.qualify.benchmarks.one_version import CASES

pytestmark = pytest.mark.skipif(not (against.ROOT / ".git").exists(), reason="needs the history of a checkout")


@pytest.fixture(autouse=True)
def apart(tmp_path, monkeypatch):
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda _: tmp_path)


def test_a_version_is_compared_with_itself(monkeypatch):
    monkeypatch.setattr(against, "CASES", {"exact, bare": CASES["exact, bare"]})
    monkeypatch.setattr(against, "unpacked", lambda _: against.ROOT)
    said = []
    found = against.compared("HEAD", said.append, rounds=3)
    assert found["exact, bare"]["same"]
    assert 0.0 < found["exact, bare"]["speed"] < float("inf")
    assert "the same bits" in said[0]
    monkeypatch.setitem(found["exact, bare"], "speed", 0.9)
    assert against.missed(found) == ["exact, bare"]


def test_another_version_is_unpacked_once():
    place = against.unpacked("HEAD")
    assert (place / "rig" / "__init__.py").is_file()
    assert against.unpacked("HEAD") == place
    assert [one.name for one in place.parent.iterdir()] == [place.name]


def test_an_unknown_commit_is_refused():
    with pytest.raises(UsageError, match="--against: fatal"):
        against.unpacked("no-such-commit")
