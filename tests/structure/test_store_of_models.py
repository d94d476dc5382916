"""What the store of reduced models keeps, and what it says when a model that it had is built again."""

import pytest

from rig.structure import model_store
from rig.structure.model_store import stored_or_built


@pytest.fixture
def store(tmp_path, monkeypatch):
    monkeypatch.setenv("RIG_MODELS", str(tmp_path / "models"))
    return tmp_path / "models"


def model(key, size=10):
    """A model of so many bytes from the store, or built."""

    def read(content):
        if content != b"m" * size:
            raise ValueError("is damaged")
        return content

    return stored_or_built(key, lambda: b"m" * size, bytes, read)


def test_two_gibibytes_are_kept_on_disk_and_64_mebibytes_in_memory():
    assert model_store.LIMIT == 2 * 1024**3
    assert model_store.MEMORY == 64 * 1024**2


def test_offered_models_of_a_size_beyond_the_memory_replace_the_oldest(monkeypatch):
    monkeypatch.setattr(model_store, "MEMORY", 25)
    monkeypatch.setattr(model_store, "OFFERED", type(model_store.OFFERED)())
    names = [model_store.offer(letter * 10) for letter in (b"a", b"b", b"c")]
    assert list(model_store.OFFERED) == names[1:]


def test_a_model_that_was_deleted_is_built_again_with_a_reason(store, monkeypatch, caplog):
    monkeypatch.setattr(model_store, "LIMIT", 15)
    model("a")
    model("b")
    assert caplog.text == ""
    model("a")
    assert "a reduced model that was stored is built again" in caplog.text
    assert f"{store / 'a'} was deleted, because" in caplog.text
    caplog.clear()
    model("a")
    assert caplog.text == ""


def test_a_damaged_model_is_built_again_with_a_reason(store, caplog):
    model("a")
    (store / "a").write_bytes(b"mm")
    model("a")
    assert f"{store / 'a'} cannot be read" in caplog.text
    assert (store / "a").read_bytes() == b"m" * 10


def test_the_marks_of_deleted_models_are_limited(store, monkeypatch):
    monkeypatch.setattr(model_store, "LIMIT", 15)
    monkeypatch.setattr(model_store, "MARKS", 3)
    for key in "abcdefgh":
        model(key)
    assert len(list(store.iterdir())) <= 3 + 2
