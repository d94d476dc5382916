"""Plots of outputs and sensors."""

import pytest

import rig
from rig.scenes.shipped import names
from rig.view.channels import Channels


def channels(scene):
    assembly, sensors = scene.assemble(), {name: one.unit for name, one in scene.sensors.items()}
    return Channels((scene, assembly), {name: output.unit for name, output in assembly.outputs.items()}, sensors)


@pytest.mark.parametrize("name", names())
def test_every_output_and_every_sensor_is_in_one_plot(name):
    scene = rig.load(name)
    found = channels(scene)
    shown = [output for panel in found.panels for output in panel.outputs] + [*found.at_points]
    assert sorted(shown) == sorted(scene.assemble().outputs)
    assert sorted(sensor for panel in found.panels for sensor in panel.sensors) == sorted(scene.sensors)
    assert found.portrait is not None
