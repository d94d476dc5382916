"""Plots of outputs and sensors: as the parts declare them, else by their units; colours that all can tell apart."""

import pytest

import rig
from rig.model.assembly import Assembly, Output
from rig.scenes.shipped import names
from rig.view.channels import Channels


def channels(scene):
    assembly, sensors = scene.assemble(), {name: one.unit for name, one in scene.sensors.items()}
    return Channels((scene, assembly), {name: output.unit for name, output in assembly.outputs.items()}, sensors)


def declared(**outputs):
    """Plots of a rig with these outputs; no scene, no sensors."""
    a = Assembly(title="toy")
    a.outputs |= outputs
    scene = rig.load("belt")
    return Channels((scene, a), {name: output.unit for name, output in outputs.items()}, {})


@pytest.mark.parametrize("name", names())
def test_every_output_and_every_sensor_is_in_one_plot(name):
    scene = rig.load(name)
    found = channels(scene)
    shown = [output for panel in found.panels for output in panel.outputs] + [*found.at_points]
    assert sorted(shown) == sorted(scene.assemble().outputs)
    assert sorted(sensor for panel in found.panels for sensor in panel.sensors) == sorted(scene.sensors)
    assert found.portrait is not None


def test_outputs_that_declare_nothing_are_grouped_by_their_units():
    toy = {"push": "N", "x_speed": "m/s", "y_speed": "m/s", "x": "m", "heat": "W", "cold": "W"}
    told = [
        ("velocity [m/s]", ("x_speed", "y_speed")),
        ("forces [N]", ("push",)),
        ("displacement [m]", ("x",)),
        ("heat [W]", ("heat",)),
        ("cold [W]", ("cold",)),
    ]
    for found in (Channels(None, toy, {}), declared(**{name: Output({}, unit) for name, unit in toy.items()})):
        assert [(panel.title, panel.outputs) for panel in found.panels] == told
