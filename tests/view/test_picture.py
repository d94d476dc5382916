"""The moving picture: in stick all move as one, and scales are round."""

import math

import numpy as np
import pytest

import rig
from rig.picture import OnBelt
from rig.plants import PLANTS
from rig.view.base import Scale, scale_of
from rig.view.belt import Belt
from rig.view.blueprint import blueprint
from rig.view.drawing import Drawing
from rig.view.picture import picture_of


def outputs(scene):
    return {name: output.unit for name, output in scene.assemble().outputs.items()}


def drawn(scene):
    assembly = scene.assemble()
    return picture_of(scene, assembly, assembly.system())


def moving(columns, path, component):
    """Values that a frame list gives an entity."""
    found = next(c for c in columns if c.path == path and component in c.columns.fields)
    return np.array(found.columns.fields[component], float).reshape(len(found.t_ns), -1)


def test_in_stick_arm_and_disc_turn_as_one():
    scene = rig.load("pendulum")
    picture = drawn(scene)
    t_ns = np.arange(0, 500_000_000, 5_000_000)
    speed = np.full(t_ns.size, 0.03)
    signals = {name: np.zeros(t_ns.size) for name in outputs(scene)}
    signals |= {"disc_speed": speed, "angle": 0.03 * t_ns * 1e-9, "friction_force": speed, "normal_force": speed}
    frames = []
    for part in np.split(np.arange(t_ns.size), 4):  # as it comes, batch by batch
        cut = {name: v[part] for name, v in signals.items()}
        frames.append(picture.frames(t_ns[part], cut, np.zeros(part.size, int), np.arange(0, part.size, 4)))
    for columns in frames:
        disc, arm = (moving(columns, path, "quaternion") for path in ("rig/disc", "rig/pendulum"))
        assert np.allclose(disc, arm, atol=1e-7)
        assert np.ptp(arm[:, 2]) > 0.0


@pytest.mark.parametrize("name", ["belt", "pendulum", "belt_c_damped", "belt_lugre", "belt_rate_state"])
def test_motion_is_magnified_by_a_round_number_that_keeps_it_in_the_picture(name):
    scene = rig.load(name)
    system = scene.assemble().system()
    scale = scale_of(system)
    mantissa = scale.motion / 10 ** math.floor(math.log10(scale.motion) + 1e-9)
    assert min(abs(mantissa - step) for step in (1, 2, 5)) < 1e-9
    reach = system.patches[0].law.at_rest(20.0) * 20.0 * system.patches[0].direction[0] / system.stiffness[0, 0]
    assert 0.05 < scale.motion * reach < 0.5


def test_a_rig_that_declares_no_picture_gets_curves_and_a_strip_and_nothing_is_guessed(monkeypatch):
    monkeypatch.delattr(PLANTS["belt"], "PICTURES")
    scene = rig.load("belt")
    drawing = Drawing(scene.to_json(), outputs(scene), {})
    assert {"displacement", "surface_speed", "friction_force", "normal_force"} <= set(outputs(scene))
    assert drawing.picture is None
    assert drawing.worded
    assert set(drawing.curves) == set(outputs(scene))


def test_a_body_on_a_belt_is_drawn_along_across_and_turned_by_the_outputs_that_are_declared():
    said = OnBelt(along="place", up="rise", turn="roll", surface="band", friction="pull", normal="press")
    picture = Belt(Scale(10.0, 5.0), said)
    t_ns = np.arange(3) * 1_000_000
    signals = dict.fromkeys(said.outputs, np.zeros(3))
    signals |= {"place": np.array([0.0, 0.01, 0.02]), "rise": np.full(3, 0.005), "roll": np.full(3, 0.02)}
    columns = picture.frames(t_ns, signals, np.zeros(3, int), np.arange(3))
    place, turn = (moving(columns, "rig/mass", name) for name in ("translation", "quaternion"))
    assert place == pytest.approx(np.array([[0.0, 0.0, 0.05], [0.1, 0.0, 0.05], [0.2, 0.0, 0.05]]))
    assert turn[:, 1] == pytest.approx(math.sin(0.1))


@pytest.mark.parametrize(("name", "until"), [("pendulum", None), ("brake_shunt_sound", 20.0), (None, 20.0)])
def test_every_rig_has_a_window(name, until):
    scene = rig.load(name).to_json() if name else "{}"
    told = outputs(rig.load(name)) if name else {"velocity": "m/s"}
    drawing = Drawing(scene, told, {})
    assert (drawing.picture is None) == (name is None)
    blueprint(drawing, until)
