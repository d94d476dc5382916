"""Formats of scene files: older ones are read and rewritten, newer ones are refused. The renames here are made up."""

import json
from pathlib import Path

import pytest

import rig
from rig import scenes
from rig.errors import RigError, SceneError
from rig.scenes import migration
from rig.scenes.migration import Rename

HERE = Path(__file__).parent
STEPS = (
    (Rename("load.weight", "press"), Rename("sensors.*.bandwith", "bandwidth"), Rename("protocol.length", "time")),
    (Rename("load.press", "force"), Rename("cart", "body")),
)
NEW = """\
format = 3
# one of mine
based_on = "belt" # bandwith = 3
title = "load.weight"

[load]
force = ["30 N", "chosen"]   # why
[body]
mass = "6 kg"
[sensors.vibrometer]
bandwidth = "4 kHz"
[sensors]
laser.bandwidth = "none"

[[protocol]]
step = "hold"
time = "2 s"
[[protocol]]
step = "repeat"
times = 2
steps = [{ step = "hold", time = "1 s" }]
"""
OLD = NEW.removeprefix("format = 3\n")
for now, before in (
    ("force =", "weight ="),
    ("[body]", "[cart]"),
    ("bandwidth =", "bandwith ="),
    ("\ntime =", "\nlength ="),
):
    OLD = OLD.replace(now, before)
TOLD = [
    "load.weight is now called load.force",
    "cart is now called body",
    "sensors.vibrometer.bandwith is now called sensors.vibrometer.bandwidth",
    "sensors.laser.bandwith is now called sensors.laser.bandwidth",
    "protocol[1].length is now called protocol[1].time",
]


@pytest.fixture
def renamed(monkeypatch):
    """Two steps that rename keys, so that format 3 is the newest."""
    monkeypatch.setattr(migration, "STEPS", STEPS)


def test_a_file_of_the_first_format_loads():
    """A file as it was when formats came: it is never changed, and must load for ever."""
    scene = scenes.load(HERE / "format_1.toml")
    assert (scene.parameters.load.force, scene.parameters.friction.mu_static) == (20.0, 0.5)
    assert (scene.controllers["nf"].gain, scene.controllers["nf"].enable_at) == (200.0, 4.0)
    assert scene.duration_ns == 20_000_000_000


@pytest.mark.parametrize(("given", "told"), [
    ("7", "format = 7: this version of friction-rig reads scene files up to format 1; install a newer version"),
    *((bad, "a whole number; this version reads scene files up to format 1") for bad in ("0", "true", "[1]")),
])  # fmt: skip
def test_what_is_no_known_format_is_refused(tmp_path, given, told):
    path = tmp_path / "mine.toml"
    path.write_text(f'based_on = "belt"\nformat = {given}\nunknown = 3')
    with pytest.raises(SceneError) as caught:
        scenes.load(path)
    [fault] = caught.value.faults
    assert fault.endswith(f"{told} (mine.toml, line 2)")


def test_an_old_file_is_migrated_as_it_is_read_and_says_so(tmp_path, renamed):
    path = tmp_path / "mine.toml"
    path.write_text(OLD.replace('laser.bandwith = "none"', ""))
    (tmp_path / "new.toml").write_text(NEW.replace('laser.bandwidth = "none"', ""))
    scene, new = scenes.load(path), scenes.load(tmp_path / "new.toml")
    assert (scene.digest, scene.origins) == (new.digest, new.origins)
    assert new.notes == ()
    [note] = [one for one in scene.notes if one.startswith("mine.toml is in format 1: ")]
    assert note.endswith(f"(rig migrate {path} rewrites it)")
    assert all(told in note for told in (TOLD[0], TOLD[1], TOLD[2], TOLD[4]))
    assert str(scene.place("load.force")) == "mine.toml, line 6"


def test_a_file_is_rewritten_and_keeps_its_comments(renamed):
    assert migration.rewritten(OLD) == (NEW, TOLD)
    assert migration.rewritten(NEW) == (NEW, [])


def test_a_change_by_a_former_name_is_refused_with_its_successor(renamed):
    changes = {"load.weight": 3.0, "load.press": 2.0, "sensors.vibrometer.bandwith": 1e3, "cart.mass": 2.0}
    with pytest.raises(SceneError) as told:
        scenes.load("belt", changes)
    assert sorted(told.value.faults) == [
        "cart: is now called body (given in the call)",
        "load.press: is now called load.force (given in the call)",
        "load.weight: is now called load.force (given in the call)",
        "sensors.vibrometer.bandwith: is now called sensors.vibrometer.bandwidth (given in the call)",
    ]
    for axis in (lambda: rig.map("belt", "cart.mass=1:2:3"), lambda: rig.study("belt", {"cart.mass": [1.0, 2.0]}, [])):
        with pytest.raises(RigError, match=r"cart\.mass: is not a numeric .*; it is now called body\.mass"):
            axis()


def test_a_recorded_scene_of_an_older_format_comes_back(monkeypatch):
    scene = scenes.load("belt_normal_force")
    raw = json.loads(scene.to_json())
    raw["parameters"]["load"]["weight"] = raw["parameters"]["load"].pop("force")
    raw["origins"]["load.weight"] = raw["origins"].pop("load.force")
    raw["protocol"][0]["length"] = raw["protocol"][0].pop("time")
    text = json.dumps(raw)
    monkeypatch.setattr(migration, "STEPS", STEPS)
    again = scenes.Scene.from_json(text)
    assert again == scene
    assert json.loads(again.to_json())["format"] == 4


def test_a_recorded_scene_of_a_newer_format_is_refused(monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(migration, "STEPS", STEPS)
        text = scenes.load("belt").to_json()
    with pytest.raises(SceneError, match=r"newer version, whose scene files have format 3; this one reads format 1"):
        scenes.Scene.from_json(text)


def test_a_key_by_both_names_is_told_and_nothing_is_rewritten(tmp_path, renamed):
    """One of the two values would be lost, and the file would have a key twice."""
    path = tmp_path / "mine.toml"
    path.write_text('based_on = "belt"\n[load]\npress = "30 N"\nweight = "40 N"\n')
    told = r"load\.press and load\.weight are one key since format 3; remove one of them"
    with pytest.raises(SceneError, match=rf"{told} \(mine\.toml\)"):
        scenes.load(path)
    with pytest.raises(ValueError, match=told):
        migration.rewritten(path.read_text())


@pytest.mark.parametrize(("old", "new"), [
    ("# my format = 1\nformat = 2 # of mine\r\n[load]\r\n\"press\" = 3\r\n",
     "# my format = 1\nformat = 3 # of mine\r\n[load]\r\nforce = 3\r\n"),
    ('about = """\nformat = 1\n"""\n', 'format = 3\nabout = """\nformat = 1\n"""\n'),
])  # fmt: skip
def test_only_the_format_of_the_file_is_rewritten(renamed, old, new):
    assert migration.rewritten(old)[0] == new
