"""rig new, and what explain and list tell of scenes that are based on others."""

import json
from pathlib import Path

from rig import scenes

GOLDEN = Path(__file__).parents[2] / "recordings" / "golden"


def test_a_new_scene_can_be_explained_at_once(rig, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, _ = rig("new", "mine", "--based-on", "belt")
    assert (code, out) == (
        0,
        "mine.toml: based on belt\nnext: edit it | rig explain mine.toml | rig simulate mine.toml\n",
    )
    code, out, err = rig("explain", "mine.toml")
    assert (code, err) == (0, "")
    assert "Based on scene belt\n" in out
    assert "\nvalues, with lines of scene belt\n" in out
    told = json.loads(rig("explain", "mine.toml", "-p", "load.force=30", "--json")[1])
    assert (told["based_on"], told["notes"]) == (["scene belt"], [])
    places = {value["key"]: (value["file"], value["line"]) for value in told["values"]}
    assert places["load.force"] == ("-p", None)
    assert places["body.mass"][0] == "scene belt"
    assert places["clock.tolerance"] == (None, None)


def test_a_new_scene_names_its_base_from_its_own_folder(rig, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "base.toml").write_text('based_on = "belt"')
    (tmp_path / "deep").mkdir()
    code, out, _ = rig("new", "deep/mine.toml", "--based-on", "base.toml", "--json")
    assert (code, json.loads(out)) == (0, {"file": "deep/mine.toml", "based_on": "../base.toml"})
    assert scenes.load("deep/mine.toml").digest == scenes.load("belt").digest


def test_a_new_scene_replaces_no_file_unless_forced(rig, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text("# mine")
    code, _, err = rig("new", "mine", "--based-on", "belt")
    assert (code, err) == (2, "NAME mine.toml exists; name another file, or add --force to replace it\n")
    assert (tmp_path / "mine.toml").read_text() == "# mine"
    assert rig("new", "mine", "--based-on", "belt", "--force")[0] == 0
    (tmp_path / "middle.toml").write_text('based_on = "mine.toml"')
    for name in ("mine", "middle"):
        code, _, err = rig("new", name, "--based-on", "middle.toml", "--force")
        assert (code, err) == (2, f"{name}: is a scene that the new one would be based on; name another file\n")
    assert scenes.load("mine.toml").plant == "belt"


def test_a_recording_in_place_of_a_scene_is_told(rig, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "log.mcap").write_bytes((GOLDEN / "belt.mcap").read_bytes())
    code, _, err = rig("simulate", "log.mcap")
    assert (code, err.splitlines()) == (
        2,
        ["log.mcap: is a recording (MCAP) and no scene; rig simulate --from LOG continues it"],
    )
