"""Parts of other packages, by entry points; and parts that are only put into the folder."""

import json
import sys

import pytest

import rig as lab
from rig import controllers, effects, laws, plants, sensors
from rig.errors import Untrusted
from rig.parts import trust_scene
from rig.scenes.scene import Scene

ROOMS = (plants.PLANTS, effects.EFFECTS, laws.LAWS, sensors.KINDS, controllers.KINDS)
GROUPS = {"plant": "plants", "effect": "effects", "law": "laws", "sensor": "sensors", "controller": "controllers"}


def forget():
    """What this process knows of installed parts."""
    for room in ROOMS:
        vars(room).pop("installed", None)
        for kind in GROUPS:
            vars(room)["_made"].pop(f"toy_{kind}", None)


@pytest.fixture
def installed(folder, tmp_path_factory, monkeypatch):
    """A distribution `toys` with five parts, on the path."""
    site = tmp_path_factory.mktemp("site")
    package, info = site / "toys", site / "toys-1.0.dist-info"
    package.mkdir()
    info.mkdir()
    (package / "__init__.py").write_text("")
    lines = ["[friction_rig.plants]", "belt = toys.plant"]
    for kind, group in GROUPS.items():
        (package / f"{kind}.py").write_text((folder / f"example_{kind}.py").read_text())
        lines += [f"[friction_rig.{group}]", f"toy_{kind} = toys.{kind}"]
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: toys\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
    text = (folder / "scene.toml").read_text()
    for kind in GROUPS:
        text = text.replace(f"./example_{kind}.py", f"toy_{kind}")
    law = 'law = "toy_law"\nmu_slow = 0.3\nrise = 0.2\npeak = "0.02 m/s"\n\n'
    text = f"{text[: text.index('law = ')]}{law}{text[text.index('[buffer]') :]}"
    (folder / "scene.toml").write_text(text)
    monkeypatch.syspath_prepend(str(site))
    forget()
    yield folder / "scene.toml"
    forget()
    for name in [name for name in sys.modules if name.partition(".")[0] == "toys"]:
        del sys.modules[name]


def test_a_scene_names_parts_of_another_package(installed):
    scene = lab.load(installed)
    assert scene.plant == "toy_plant"
    assert type(scene.parameters).__module__ == "toys.plant"
    assert "buffer" in scene.assemble().names
    parts = json.loads(scene.to_json())["parts"]
    assert {one["name"] for one in parts} == {f"toy_{kind}" for kind in GROUPS}
    assert Scene.from_json(scene.to_json()) == scene  # what is installed needs no word of trust


def test_where_they_are_not_installed_the_recording_has_them(installed, monkeypatch):
    text = lab.load(installed).to_json()
    for room in ROOMS:
        monkeypatch.setitem(vars(room), "installed", {})
    with pytest.raises(Untrusted):
        Scene.from_json(text)
    trust_scene(text)
    assert Scene.from_json(text).assemble().title == "block on a soft table"


def test_they_are_listed_and_known(rig, installed):
    code, out, _ = rig("list")
    assert code == 0
    assert "toy_sensor" in out
    assert "installed: toy_plant (plants) of toys 1.0\n" in out
    assert "installed: belt (plants) of toys 1.0, hidden by the shipped part of this name\n" in out
    assert lab.load("belt").plant == "belt"
    assert not [name for name in sys.modules if name.partition(".")[0] == "toys"]
    installed.write_text(installed.read_text().replace("toy_plant", "toy_plnt"))
    assert "did you mean toy_plant?" in rig("explain", installed)[2]
