"""Parts of other packages, by entry points; and parts that are only put into the folder."""

import json
import sys

import pytest

import rig as lab
from rig import controllers, effects, plants, sensors
from rig.errors import Untrusted
from rig.parts import Room
from rig.scenes.scene import Scene

GROUPS = {"plant": "plants", "effect": "effects", "sensor": "sensors", "controller": "controllers"}


@pytest.fixture
def installed(folder, tmp_path_factory, monkeypatch):
    """A distribution `toys` with the four parts, on the path."""
    site = tmp_path_factory.mktemp("site")
    package, info = site / "toys", site / "toys-1.0.dist-info"
    package.mkdir()
    info.mkdir()
    (package / "__init__.py").write_text("")
    lines = []
    for kind, group in GROUPS.items():
        (package / f"{kind}.py").write_text((folder / f"example_{kind}.py").read_text())
        lines += [f"[friction_rig.{group}]", f"toy_{kind} = toys.{kind}"]
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: toys\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
    text = (folder / "scene.toml").read_text()
    for kind in GROUPS:
        text = text.replace(f"./example_{kind}.py", f"toy_{kind}")
    (folder / "scene.toml").write_text(text)
    monkeypatch.syspath_prepend(str(site))
    rooms = (plants.PLANTS, effects.EFFECTS, sensors.KINDS, controllers.KINDS)
    for room in rooms:
        vars(room).pop("installed", None)
    yield folder / "scene.toml"
    for room in rooms:
        vars(room).pop("installed", None)
        for kind in GROUPS:
            vars(room)["_made"].pop(f"toy_{kind}", None)
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
    for room in (plants.PLANTS, effects.EFFECTS, sensors.KINDS, controllers.KINDS):
        monkeypatch.setitem(vars(room), "installed", {})
    with pytest.raises(Untrusted):
        Scene.from_json(text)
    from rig.parts import trust_scene

    trust_scene(text)
    assert Scene.from_json(text).assemble().title == "block on a soft table"


def test_they_are_listed_and_known(rig, installed):
    code, out, _ = rig("list")
    assert code == 0
    assert "toy_sensor" in out
    assert "toys 1.0" in out
    installed.write_text(installed.read_text().replace("toy_plant", "toy_plnt"))
    assert "did you mean toy_plant?" in rig("explain", installed)[2]


def test_a_module_in_the_folder_is_a_part(tmp_path, monkeypatch):
    package = tmp_path / "room_of_parts"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "one.py").write_text("value = 1\n")
    (package / "helpers").mkdir()
    monkeypatch.syspath_prepend(str(tmp_path))
    room = Room("nothing", "room_of_parts", [str(package)], lambda module, name: module.value)
    assert list(room) == ["one"]
    assert room["one"] == 1
    assert "two" not in room
    with pytest.raises(KeyError):
        room["two"]


def test_nothing_is_imported_to_know_the_names():
    import subprocess

    code = (
        "import sys; from rig.plants import PLANTS; from rig.sensors import KINDS; import rig.controllers as c\n"
        "assert 'belt' in PLANTS and 'microphone' in KINDS and 'dither' in c.KINDS\n"
        "print([m for m in sys.modules if m in ('rig.plants.belt', 'rig.sensors.microphone', 'rig.controllers.dither')"
        " or m == 'importlib.metadata'])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"
