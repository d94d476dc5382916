"""Scenes to choose from, their values as a form, and what is wrong with changed ones."""

import json
from pathlib import Path

import pytest

from rig import scenes
from rig.errors import SceneError, UsageError
from rig.scenes.shipped import groups
from rig.web.catalogue import Catalogue
from rig.web.form import form, timing


def test_every_shipped_scene_has_a_card_and_those_of_the_folder_come_first(tmp_path):
    (tmp_path / "mine.toml").write_text('based_on = "belt"\ntitle = "My belt"\n')
    (tmp_path / "pyproject.toml").write_text('[project]\nname = "x"\n')
    found = Catalogue(tmp_path).cards()
    assert [one["name"] for one in found if one["own"]] == [str(tmp_path / "mine.toml")]
    assert {one["name"]: one["group"] for one in found if not one["own"]} == groups()


@pytest.mark.parametrize("name", ["belt_normal_force", "pendulum", "brake_shunt"])
def test_the_form_has_every_value_with_unit_range_and_origin(name):
    scene = scenes.load(name)
    found = json.loads(json.dumps(form(scene), allow_nan=False))
    entries = {one["key"]: one for section in found["sections"] for one in section["values"]}
    for key, one in scene.assemble().inputs.items():
        assert entries[key]["limits"] == [one.low, one.high]
        assert entries[key]["live"]
        assert entries[key]["actuator"]
    for key, (value, unit) in scene.values().items():
        if key in entries and not isinstance(value, bool):
            assert (entries[key]["value"], entries[key]["unit"]) == (value, unit)
    for one in entries.values():
        if one["slider"]:
            low, high = one["slider"]["low"], one["slider"]["high"]
            assert one["limits"][0] <= low <= one["value"] <= high <= one["limits"][1]
            assert low < high
    assert all(not one["live"] for key, one in entries.items() if key.startswith(("start.", "clock.")))
    owners = {key: entry["owner"] for key, entry in entries.items() if entry["owner"]}
    assert owners == ({} if name == "brake_shunt" else {"load.force": "nf"})


ODD = {
    "clock": ("clock = 3\nplant = 'belt'\n", "clock = 3: expected a table [clock]"),
    "circle": ("based_on = './circle.toml'\n", "based on one another in a circle"),
    "cut": ('based_on = "belt"\n[drive\n', "line 2"),
}


def test_an_odd_scene_file_is_the_text_of_its_row_on_the_page_and_in_the_list(client, folder, rig):
    for name, (text, _) in ODD.items():
        (folder / f"{name}.toml").write_text(text)
    (folder / "good.toml").write_text("based_on = 'belt'\ntitle = 'a.b.c'\n[clock]\npace_limit = ['2', 'chosen']\n")
    code, out, err = rig("list", folder, "--json")
    assert (code, err) == (0, "")
    for rows in (json.loads(out), [row for row in client.get("/api/scenes").json() if row["own"]]):
        titles = {Path(row["name"]).stem: row["title"] for row in rows}
        assert titles.keys() == {"good", *ODD}
        assert titles["good"] == "a.b.c"
        assert {name: told for name, (_, told) in ODD.items() if told not in titles[name]} == {}
        assert all(titles[name].startswith("cannot be read: ") for name in ODD)
    for row in rows:
        if Path(row["name"]).stem in ODD:
            assert client.refused("/api/scene", scene=row["name"])
    (folder / "typo.toml").write_text('based_on = "belt"\n[drive]\nsped = 3\n')
    assert "did you mean drive.speed" in client.refused("/api/scene", scene=str(folder / "typo.toml"))


def test_faults_are_those_of_the_command_line(rig, tmp_path):
    changes = {"friction.mu_static": -1, "load.force": "3 m", "zzz": 1.0}
    with pytest.raises(SceneError) as told:
        Catalogue(tmp_path).scene("belt", changes)
    options = [part for key, value in changes.items() for part in ("-p", f"{key}={value}")]
    _, _, printed = rig("explain", "belt", *options)
    assert str(told.value) == printed.strip().replace("given with -p", "given on the page")


def test_what_is_no_scene_no_change_no_pace_is_refused(tmp_path):
    catalogue = Catalogue(tmp_path)
    for name in ("/etc/passwd", "../x.toml", 5, None, "nothing"):
        with pytest.raises(UsageError, match="no scene is called"):
            catalogue.scene(name)
    with pytest.raises(UsageError, match='"changes" is'):
        catalogue.scene("belt", [1])
    with pytest.raises(UsageError, match="is not a value"):
        catalogue.scene("belt", {"load.force": [1.0]})
    belt = catalogue.scene("belt")
    for pace in (0.0, "fast", 1e9, float("nan")):
        with pytest.raises(UsageError, match="the pace "):
            timing(belt, pace, None)
    for length in (0.0, "long", "3 m", 1e9):
        with pytest.raises(UsageError, match="the duration "):
            timing(belt, 1.0, length)
    assert timing(belt, "max", "500 ms") == (None, 0.5)
    assert timing(belt, "auto", None) == ("auto", None)
    assert timing(belt, "0,5", "10,5 s") == (0.5, 10.5)


def test_a_saved_scene_has_the_changed_values_and_is_offered(tmp_path):
    catalogue = Catalogue(tmp_path)
    path = catalogue.save("mine", "belt_normal_force", {"load.force": "21 N", "controllers.nf.gain": 150, "seed": 7})
    again = scenes.load(path)
    values = again.values()
    assert (values["load.force"][0], values["controllers.nf.gain"][0], again.seed) == (21.0, 150.0, 7)
    assert again.origins["load.force"].origin == "user"
    assert str(path) in [one["name"] for one in catalogue.cards()]
    for name, told in (("mine", "exists already"), ("belt", "exists already"), ("../x", "cannot name a scene")):
        with pytest.raises(UsageError, match=told):
            catalogue.save(name, "belt", {})
    with pytest.raises(SceneError, match="must be at least 0"):
        catalogue.save("wrong", "belt", {"load.force": -1})
    assert not (tmp_path / "wrong.toml").exists()
