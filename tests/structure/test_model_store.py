"""Models on disk: read as they were written or not at all; a folder that cannot be written is no fault."""

import os

import pytest

from rig.structure.model_store import stored_or_built


@pytest.fixture
def store(tmp_path, monkeypatch):
    monkeypatch.setenv("RIG_MODELS", str(tmp_path / "models"))
    return tmp_path / "models"


@pytest.fixture
def built():
    """Number of models that `model` has built so far."""
    return []


@pytest.fixture
def model(built):
    """A model of so many bytes, by its key."""

    def build(key, size=10):
        def make():
            built.append(key)
            return b"m" * size

        def read(content):
            if content != b"m" * size:
                raise ValueError("is damaged")
            return content

        return stored_or_built(key, make, bytes, read)

    return build


def test_a_folder_that_cannot_be_written_is_told_once(store, model, built, caplog):
    store.write_text("a file in its place")
    assert model("a") == model("a") == b"m" * 10
    assert built == ["a", "a"]
    assert caplog.text.count("RIG_MODELS") == 1


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="this system has other permissions")
@pytest.mark.parametrize("what", ["folder", "file"])
def test_what_another_user_can_have_written_is_ignored_with_a_warning(store, model, built, caplog, what):
    model("a")
    at = store if what == "folder" else store / "a"
    at.chmod(0o777)
    assert model("a") == b"m" * 10
    assert built == ["a", "a"]
    assert caplog.text.count(f"{at} can be written by other users (mode 777): it is ignored") == 1
