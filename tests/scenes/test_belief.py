"""What controllers believe of a rig that is varied: the scene that they were designed for, and set-points."""

from dataclasses import replace
from itertools import count

import numpy as np
import pytest

import rig
from rig.bench.again.verify import verify
from rig.design import numbers
from rig.errors import SceneError, UsageError
from rig.record.save_run import save
from rig.scenes import load
from rig.scenes.belief import untold, varied
from rig.scenes.scene import Scene

NOMINAL = load("brake_active").parameters.structure.scale


def of(name, **overrides):
    return load(name, {key.replace("__", "."): value for key, value in overrides.items()})


def test_a_varied_value_is_not_told_and_a_set_point_is():
    scene = of("belt_normal_force")
    made = varied(scene, {"load.force": 25.0, "body.mass": 6.0, "drive.speed": 0.1, "controllers.nf.gain": 100.0})
    believed = of("belt_normal_force", load__force=25.0, drive__speed=0.1, controllers__nf__gain=100.0)
    assert made.believed == {"body.mass": scene.parameters.body.mass}
    assert made.parameters.body.mass == 6.0
    assert numbers(made) == numbers(believed)


def test_an_instrument_may_be_untold():
    scene = of("belt_normal_force_displacement")
    made = untold(scene, {"sensors.laser.noise": "50 um"})
    assert made.sensors["laser"].noise == pytest.approx(50e-6)
    assert numbers(made) == numbers(scene) != numbers(of("belt_normal_force_displacement", sensors__laser__noise=50e-6))


@pytest.mark.parametrize(
    ("name", "values", "fault"),
    [
        ("belt", {"load.force": 1.0}, "has no controller"),
        ("belt_normal_force", {"load.frce": 1.0}, "did you mean load.force"),
        ("belt_normal_force", {"controllers.nf.gain": 1.0}, "is a value of a controller"),
        ("belt_normal_force", {"clock.frame": "1 ms"}, "is no value of the rig or of a sensor"),
        ("belt_normal_force", {"sensors.no.noise": 1.0}, "is no value of this rig"),
        ("belt_normal_force", {"load": 1.0, "": 2.0}, "is no value of this rig"),
    ],
)
def test_what_cannot_be_untold_is_refused(name, values, fault):
    with pytest.raises(UsageError, match=fault):
        untold(load(name), values)


def test_a_wrong_value_that_is_untold_states_its_key():
    with pytest.raises(SceneError, match=r"untold load\.force = \"25 m\""):
        untold(load("belt_normal_force"), {"load.force": "25 m"})


def test_redesign_needs_controllers():
    with pytest.raises(UsageError, match="no controllers"):
        rig.sweep("belt", "drive.speed", [0.1, 0.2], redesign=True)


def test_a_scene_keeps_what_its_controllers_believe_in_its_text():
    scene = varied(replace(of("belt_normal_force"), redesign=False), {"body.mass": 6.0})
    again = Scene.from_json(scene.to_json())
    assert again == scene
    assert again.digest == scene.digest != load("belt_normal_force").digest
    told = replace(scene, redesign=True)
    assert Scene.from_json(told.to_json()).redesign


def test_the_loop_of_a_varied_brake_has_the_controller_of_the_scene():
    """Growth at -2, -1, +1, +2 % of all frequencies: +33.8, -1.26, +24.2, +33.8 1/s, from independent matrices."""
    values = [share * NOMINAL for share in (0.98, 0.99, 1.01, 1.02)]
    swept = rig.sweep("brake_active", "structure.scale", values, "nb")
    assert swept.largest == pytest.approx([33.8, -1.26, 24.2, 33.8], rel=0.01)
    assert "not told structure.scale" in swept.text()
    for value, growth in zip(values, swept.largest):
        assert rig.loop("brake_active", "nb", untold={"structure.scale": value}).growth == pytest.approx(growth)
    told = rig.sweep("brake_active", "structure.scale", values, "nb", redesign=True)
    assert np.all(told.largest < 0.0)
    assert "designed anew" in told.text()


def last_displacement(run):
    return float(run.signals["displacement"][-1])


def test_a_study_runs_the_rig_that_its_controllers_do_not_know(tmp_path):
    """The observer is designed with the mass: a point of a study is the run with an untold mass."""
    name, at_once, masses = "belt_normal_force_displacement", {"controllers.nf.enable_at": 0.0}, (4.5, 5.5)
    scene = load(name, at_once)
    study = rig.study(scene, {"body.mass": masses}, [last_displacement], duration=0.5, folder=tmp_path, workers=1)
    seeded = (replace(scene, seed=seed) for seed in count(scene.seed))  # as the points of a study
    runs = [rig.simulate(each, 0.5, untold={"body.mass": mass}) for each, mass in zip(seeded, masses)]
    told = [rig.simulate(load(name, {**at_once, "body.mass": mass}), 0.5) for mass in masses]
    assert study.values[:, 0].tolist() == [last_displacement(run) for run in runs]
    assert all(last_displacement(a) != last_displacement(b) for a, b in zip(runs, told))
    assert "not told body.mass" in study.text()


def test_a_run_with_an_untold_value_is_recorded_and_repeats_to_the_bit(tmp_path):
    run = rig.simulate("belt_normal_force", 0.5, untold={"load.force": "25 N"})
    save(run, tmp_path / "run.mcap")
    assert verify(tmp_path / "run.mcap").identical
    again = rig.open(tmp_path / "run.mcap")
    assert [event["text"] for event in again.plant_events if event["kind"] == "belief"] == [
        "controllers believe load.force = 20 N; the rig has 25 N"
    ]
    continued = rig.fork(tmp_path / "run.mcap", 0.3, duration=0.2)
    assert np.array_equal(continued.signals["velocity"], run.signals["velocity"])
