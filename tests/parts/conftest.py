"""Parts from files: those of the documentation, copied into a folder of the test."""

import shutil
import sys
from pathlib import Path

import pytest

from rig.parts import code

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(autouse=True)
def _strange(monkeypatch):
    """This process trusts no part, and has loaded none; so it is again after the test."""

    def forget():
        for name in [name for name in sys.modules if name.startswith("rig_part_")]:
            del sys.modules[name]

    monkeypatch.setenv("RIG_TRUSTED", "")
    monkeypatch.setattr(code, "MODULES", {})
    forget()
    yield
    forget()


@pytest.fixture
def folder(tmp_path):
    """A folder with a plant, an effect, a law, a sensor, a controller and `scene.toml`, which names all but the law."""
    for kind in ("plant", "effect", "law", "sensor", "controller"):
        shutil.copy(DOCS / f"example_{kind}.py", tmp_path)
    shutil.copy(DOCS / "example_parts.toml", tmp_path / "scene.toml")
    return tmp_path


@pytest.fixture
def strangers():
    """Makes this process trust no part any more, as another one that opens its recordings."""

    def forget():
        import os

        os.environ["RIG_TRUSTED"] = ""
        for name in [name for name in sys.modules if name.startswith("rig_part_")]:
            del sys.modules[name]

    return forget
