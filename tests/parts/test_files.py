"""A plant, an effect, a sensor and a controller from files: in scenes, in every command, with their faults told."""

import inspect
import json
import shutil

import numpy as np
import pytest
from matplotlib.image import imread

import rig as lab
from rig.errors import SceneError
from rig.scenes.scene import Scene
from rig.view.palette import put


def rewritten(file, *changes):
    """Change the text of a file: pairs of old and new."""
    text = file.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    file.write_text(text)


def faults(folder, overrides=None):
    with pytest.raises(SceneError) as told:
        lab.load(folder / "scene.toml", overrides)
    return "\n".join(told.value.faults)


def test_a_recording_contains_the_data_that_a_plant_reads(rig, folder, tmp_path, strangers):
    """Named relative to the scene file. The recording is verified where the file is not."""
    rewritten(
        folder / "example_plant.py",
        ("from rig.quantities import", "from rig.parts import DataFile\nfrom rig.quantities import"),
        ("    drive: BeltDrive", "    measured: Measured\n    drive: BeltDrive"),
        ("class Parameters(", "class Measured(Section):\n    spring: DataFile\n\n\nclass Parameters("),
        (", p.block.stiffness\n", ", float(p.measured.spring.content)\n"),
    )
    rewritten(folder / "scene.toml", ("[block]", '[measured]\nspring = "./data/spring.txt"\n\n[block]'))
    assert "measured.spring" in faults(folder)
    assert "data/spring.txt: there is no such file (scene.toml, line " in faults(folder)
    assert 'relative to the scene: "./NAME"' in faults(folder, {"measured.spring": "spring.txt"})
    (folder / "data").mkdir()
    (folder / "data" / "spring.txt").write_text("1600")
    scene = lab.load(folder / "scene.toml")
    assert np.array_equal(scene.assemble().system().stiffness[0], [1600.0, -1600.0])
    log = tmp_path / "run.mcap"
    lab.simulate(scene, 0.1).save(log)
    assert "spring.txt" in rig("explain", folder / "scene.toml")[1]
    shutil.rmtree(folder / "data")
    strangers()
    code, out, err = rig("verify", log, "--trust")
    assert (code, err) == (0, ""), out


def test_it_runs_and_the_run_is_the_sum_of_its_parts(folder):
    scene = lab.load(folder / "scene.toml")
    run = lab.simulate(scene, 1.0)
    assert run.units["meas/geophone"] == "V"
    force = np.array([values[0] for values in run.commands["two_levels"].values])
    assert set(np.unique(force)) <= {15.0, 20.0, 25.0}
    free = lab.simulate(lab.load(folder / "scene.toml", {"buffer": "none"}), 1.0)
    assert "buffer_force" in run.signals
    assert "buffer_force" not in free.signals
    assert abs(run.energy["error"]) < 1e-9


def test_the_scene_as_json_carries_source_and_hash_and_no_path(folder):
    scene = lab.load(folder / "scene.toml")
    text = scene.to_json()
    assert str(folder) not in text
    parts = json.loads(text)["parts"]
    assert [(one["part"], one["name"]) for one in parts] == [
        ("plants", "example_plant.py"),
        ("effects", "example_effect.py"),
        ("sensors", "example_sensor.py"),
        ("controllers", "example_controller.py"),
    ]
    assert parts[0]["source"] == (folder / "example_plant.py").read_text()
    assert Scene.from_json(text) == scene
    assert "parts" not in json.loads(lab.load("belt").to_json())


def test_a_plant_draws_a_figure_of_its_own_from_its_file(folder):
    text = (
        'FIGURE = Own(":compose", ("table_velocity",))\n\n\ndef compose(figure, run):\n'
        '    figure.add_axes((0, 0, 1, 1)).set(facecolor="black", xticks=(), yticks=())\n'
    )
    rewritten(
        folder / "example_plant.py",
        ("import OnBelt, Plot", "import OnBelt, Own, Plot"),
        ("PICTURES", f"{text}\n\nPICTURES"),
    )
    dark = []
    for name in ("own", "common"):
        if name == "common":
            rewritten(folder / "example_plant.py", ('("table_velocity",)', '("not_there",)'))
        put(lab.simulate(lab.load(folder / "scene.toml"), 0.1).plot(), folder / f"{name}.png")
        dark.append(float(imread(folder / f"{name}.png")[..., :3].mean()))
    assert dark[0] < 0.05
    assert dark[1] > 0.5


def test_two_versions_of_a_file_are_open_at_once(folder):
    first = lab.load(folder / "scene.toml")
    rewritten(folder / "example_plant.py", ('"block on a soft table"', '"block on a hard table"'))
    second = lab.load(folder / "scene.toml")
    assert (first.assemble().title, second.assemble().title) == ("block on a soft table", "block on a hard table")
    assert first.digest != second.digest
    assert "soft table" in inspect.getsource(inspect.getmodule(type(first.parameters)).assemble)
    assert "hard table" in inspect.getsource(inspect.getmodule(type(second.parameters)).assemble)


def test_a_file_is_sought_from_the_file_that_names_it(folder, tmp_path_factory, monkeypatch):
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    (elsewhere / "mine.toml").write_text(f'based_on = "{folder}/scene.toml"\n[buffer]\nstiffness = "50 N/m"\n')
    monkeypatch.chdir(elsewhere)
    assert lab.load(elsewhere / "mine.toml").parameters.buffer.stiffness == 50.0
    own = (folder / "example_sensor.py").read_text().replace("28.0", "14.0")
    (elsewhere / "softer.py").write_text(own)  # a change on the command line: from the folder where it is typed
    scene = lab.load(elsewhere / "mine.toml", {"sensors.geophone.kind": "./softer.py"})
    assert scene.sensors["geophone"].sensitivity == 14.0


def test_linear_analyses_of_a_scene_with_parts(folder):
    scene = lab.load(folder / "scene.toml")
    plant = lab.state_space(scene)
    rates = np.linalg.eigvals(plant.A)
    stiffness = scene.parameters.buffer.stiffness
    swept = lab.sweep(scene, "buffer.stiffness", [stiffness, 2.0 * stiffness])
    assert np.sort_complex(swept.rates[0]) == pytest.approx(np.sort_complex(rates), rel=1e-9)
    with pytest.raises(SceneError, match=r"example_controller\.py is not a linear feedback"):
        lab.loop(scene, "two_levels")


def test_a_folder_of_scenes_is_listed(rig, folder):
    code, out, _ = rig("list", folder)
    assert code == 0
    assert "example_plant.py" in out
    assert "Parts of one's own" in out
    assert json.loads(rig("list", folder, "--json")[1])[0]["plant"] == "./example_plant.py"
