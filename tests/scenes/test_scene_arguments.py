"""A scene as the argument of functions in Python: its name, its file as text or path, or the scene that was loaded."""

from pathlib import Path

import pytest

import rig
from rig.errors import UsageError


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('based_on = "belt"\nload.force = "25 N"\n')
    return path


def test_a_name_a_file_a_path_and_a_scene_give_the_same(file):
    loaded = rig.load(file)
    wanted = rig.modes(loaded).text()
    assert wanted == rig.modes(file).text() == rig.modes(str(file)).text()
    assert wanted.splitlines()[1:] != rig.modes("belt").text().splitlines()[1:]
    assert rig.simulate(file, 0.01).scene == rig.simulate(loaded, 0.01).scene


@pytest.mark.parametrize("given", [3, {"plant": "belt"}])
@pytest.mark.parametrize("function", [rig.modes, rig.simulate])
def test_anything_else_is_no_scene(function, given):
    with pytest.raises(UsageError, match=r"is no scene; give a name, a file, or what rig\.load returns"):
        function(given)


def test_a_file_takes_controllers_of_files(file):
    controller = Path(__file__).parents[2] / "docs" / "example_controller.py"
    run = rig.simulate(file, 0.01, controllers={"mine": controller})
    assert "mine" in run.commands
