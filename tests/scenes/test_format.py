"""The format of scene files: the one that exists is read for ever, newer ones are refused."""

import json
from pathlib import Path

import pytest

from rig import scenes
from rig.errors import SceneError

HERE = Path(__file__).parent


def test_a_file_of_the_first_format_loads():
    """A file as it was when formats came: it is never changed, and must load for ever."""
    scene = scenes.load(HERE / "format_1.toml")
    assert (scene.parameters.load.force, scene.parameters.friction.mu_static) == (20.0, 0.5)
    assert (scene.controllers["nf"].gain, scene.controllers["nf"].enable_at) == (200.0, 4.0)
    assert scene.duration_ns == 20_000_000_000


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("7", "format = 7: this version of friction-rig reads scene files of format 1; install a newer version"),
        *((bad, "this version of friction-rig reads scene files of format 1") for bad in ("0", "true", "[1]")),
    ],
)
def test_what_is_no_known_format_is_refused(tmp_path, given, told):
    path = tmp_path / "mine.toml"
    path.write_text(f'based_on = "belt"\nformat = {given}\nunknown = 3')
    with pytest.raises(SceneError) as caught:
        scenes.load(path)
    [fault] = caught.value.faults
    assert fault.endswith(f"{told} (mine.toml, line 2)")


def test_a_recorded_scene_of_a_newer_format_is_refused():
    text = json.dumps(json.loads(scenes.load("belt").to_json()) | {"format": 4})
    with pytest.raises(SceneError, match=r"newer version, whose scene files have format 3; this one reads format 1"):
        scenes.Scene.from_json(text)
