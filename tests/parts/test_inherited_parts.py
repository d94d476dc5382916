"""Scenes that inherit from a scene with parts from files, in another folder; and names of such files."""

import shutil
from pathlib import Path

import pytest

import rig as lab
from rig.errors import SceneError
from rig.scenes.draft import draft

TOYS = Path(__file__).parent / "two_masses"


@pytest.fixture
def lab_one(tmp_path):
    """A folder whose subfolder `lab one` has the parts and their scene."""
    shutil.copytree(TOYS, tmp_path / "lab one", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def scene(folder, text, name="mine.toml"):
    path = folder / name
    path.parent.mkdir(exist_ok=True)
    path.write_text(text)
    return path


def copied(folder, old, new, *changes):
    """A copy of a part beside the scene; pairs of old and new text."""
    text = (folder / "lab one" / old).read_text()
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    (folder / new).write_text(text)


def test_parts_are_sought_from_the_folder_of_the_file_that_names_them(lab_one, monkeypatch):
    scene(lab_one, 'based_on = "../lab one/scene.toml"\n[eddy]\nlag = "-1 s"\nconstant = "3 N"\n', "deep/y.toml")
    path = scene(lab_one, 'based_on = "deep/y.toml"\n[eddy]\nlag = "2 ms"\n')
    with pytest.raises(SceneError) as caught:
        lab.load(path)
    assert caught.value.faults == (
        'eddy.constant = "3 N": expected a unit that converts to N*s/m (deep/y.toml, line 4)',
    )
    monkeypatch.chdir(lab_one / "deep")
    scene(lab_one, 'based_on = "../lab one/scene.toml"\n', "deep/y.toml")
    mine = lab.load(path)
    assert (mine.plant, mine.parameters.eddy.lag, mine.bases) == (
        "twin.py",
        2e-3,
        ("deep/y.toml", "lab one/scene.toml"),
    )


def test_another_effect_drops_the_values_of_the_former_one(lab_one):
    copied(lab_one, "eddy.py", "other.py", ("constant", "drag"))
    text = (lab_one / "lab one" / "scene.toml").read_text()
    scene(lab_one / "lab one", text.replace("[eddy]", '[eddy]\nconstant = "2 N*s/m"'), "scene.toml")
    base = 'based_on = "lab one/scene.toml"\n'
    by_file = lab.load(scene(lab_one, f'{base}[eddy]\neffect = "./other.py"\nlag = "2 ms"\n'))
    changed = lab.load(scene(lab_one, base), {"eddy.effect": str(lab_one / "other.py"), "eddy.lag": "2 ms"})
    for mine, where in ((by_file, " (mine.toml, line 3)"), (changed, "")):
        assert (mine.parameters.eddy.drag, mine.parameters.eddy.lag) == (1.0, 2e-3)
        [note] = mine.notes
        assert "other.py: dropped constant of " in note
        assert note.endswith(f"eddy.py{where}")


def test_an_effect_that_acts_on_any_plant_stays_with_another_plant(lab_one):
    tables = "\n".join(
        [
            'based_on = "lab one/scene.toml"\nplant = "belt"\nsensors = "none"\ncontrollers = "none"',
            '[body]\nmass = "1 kg"\nstiffness = "1000 N/m"\n[drive]\nspeed = "1 m/s"\n[load]\nforce = "3 N"',
            '[friction]\nlaw = "coulomb"\nmu_static = 0.3\nmu_kinetic = 0.2\n',
        ]
    )
    mine = lab.load(scene(lab_one, tables))
    assert {"x", "eddy"} <= set(mine.assemble().names)
    assert "dropped coupling, left, right, drive, load, friction of " in mine.notes[0]


def test_a_new_scene_lists_values_that_stand_in_no_table(lab_one):
    base = lab.load(lab_one / "lab one" / "scene.toml")
    text = draft(base, "lab one/scene.toml", "mine.toml")
    mine = lab.load(scene(lab_one, text))
    assert mine.digest == base.digest
    assert text.index('# coupling = "400 N/m"') < text.index("[load]")
    assert lab.load(scene(lab_one, text.replace('# coupling = "400', 'coupling = "300'))).parameters.coupling == 300.0
