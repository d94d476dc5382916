"""The section [faults]: units of the part that is faulty, and what a user is told about what cannot be."""

import pytest

from rig import scenes
from rig.errors import SceneError
from rig.scenes.explain import explain
from rig.scenes.scene import Scene

BELT = "belt_normal_force"
FROZEN = {"faults.a.sensor": "vibrometer", "faults.a.kind": "freeze", "faults.a.at": "5 s"}


def faults(changes, scene=BELT):
    with pytest.raises(SceneError) as caught:
        scenes.load(scene, changes)
    return caught.value.faults


def test_values_have_the_unit_of_the_sensor_and_a_recording_keeps_them():
    drift = {"b.sensor": "normal_force", "b.kind": "drift", "b.at": "1 s", "b.rate": "6 N/min"}
    spike = {"a.sensor": "vibrometer", "a.kind": "spike", "a.at": "5 s", "a.height": "3 mm/s"}
    scene = scenes.load(BELT, {f"faults.{key}": value for key, value in (drift | spike).items()})
    assert scene.faults["a"].height == pytest.approx(3e-3)
    assert scene.faults["b"].rate == pytest.approx(0.1)
    again = Scene.from_json(scene.to_json())
    assert again.faults == scene.faults
    assert again.digest == scene.digest != scenes.load(BELT).digest
    units = {value.key: value.unit for value in explain(scene).values}
    assert (units["faults.a.height"], units["faults.b.rate"], units["faults.a.at"]) == ("m/s", "N/s", "s")


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"faults.a.sensor": "vibromter"}, 'faults.a.sensor = "vibromter": unknown sensor; did you mean vibrometer?'),
        ({"faults.a.at": "1.5 ms"}, "1.5 ms is not a whole number of frames (1 ms); nearest: 1 ms or 2 ms"),
        (
            {
                "faults.b.kind": "authority",
                "faults.b.actuator": "load.force",
                "faults.b.at": "1 s",
                "faults.b.factor": "150 %",
            },
            'faults.b.factor = "150 %": must be at most 1',
        ),
        (
            {"faults.b.sensor": "vibrometer", "faults.b.kind": "dropout", "faults.b.at": "7 s"},
            "faults.a and faults.b: both act on vibrometer at 7 s; one fault at a time is possible: end one before",
        ),
    ],
)
def test_a_fault_that_cannot_be_is_refused(changes, told):
    assert told in "\n".join(faults(FROZEN | changes))


def test_a_value_that_makes_new_matrices_cannot_jam():
    about = {"faults.a.kind": "jam", "faults.a.actuator": "shunt.resistance", "faults.a.at": "1 ms"}
    assert "every value of it makes new matrices" in "\n".join(faults(about, "brake_shunt"))


def test_one_after_the_other_is_possible():
    second = {"sensor": "vibrometer", "kind": "dropout", "at": "6 s"}
    two = {"faults.a.duration": "1 s"} | {f"faults.b.{key}": value for key, value in second.items()}
    assert [*scenes.load(BELT, FROZEN | two).faults] == ["a", "b"]
