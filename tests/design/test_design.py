"""The design step: numbers for controllers from the matrices, and the friction law that does not enter.

Set PEND of Kroeger et al. (2008): m = 5, c = 2500, d = 2, F0 = 20, v0 = 0.06; the pendulum is the same at r = 0.2 m.
"""

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.linalg

from rig import controllers, design
from rig.controllers.belt_velocity import BeltVelocity
from rig.controllers.blocks.observer import advanced, at_rest, observer
from rig.controllers.dither import Dither
from rig.controllers.dither_sampled import SampledDither
from rig.controllers.normal_force import NormalForce
from rig.errors import SceneError
from rig.model.assembly import Assembly, Input, Output
from rig.model.friction_law import stribeck
from rig.sensors.accelerometer import Accelerometer
from rig.sensors.disc_speed import DiscSpeed
from rig.sensors.displacement_laser import DisplacementLaser
from rig.sensors.laser_vibrometer import LaserVibrometer

RADIUS = 0.2
SENSORS = {
    "vibrometer": LaserVibrometer(),
    "laser": DisplacementLaser(),
    "accelerometer": Accelerometer(),
    "encoder": LaserVibrometer(reads="turning"),
}


def rig(radius=None, lag=None):
    """A mass on a belt, or with `radius` the pendulum on a disc that is the same at its contact."""
    r = radius or 1.0
    a = Assembly(title="PEND")
    a.coordinate("x", 5.0 * r**2, 2.0 * r**2, 2500.0 * r**2)
    a.signal("load", {}, 20.0, "load")
    a.signal("command", {}, 0.06 / r, "drive")
    if lag:
        a.signal("speed", {"speed": -1.0 / lag}, 0.06 / r, "drive")
        a.limit("drive", {"command": 1.0}, 0.0, 2.0, "speed", 1.0 / lag)
    a.patch("contact", {"x": r}, {"speed" if lag else "command": r}, stribeck(0.5, 0.18, 0.05))
    a.normal("contact", "contact", {"load": 1.0})
    a.outputs = {
        "displacement": Output({"x": r}, "m"),
        "velocity": Output({"x'": r}, "m/s"),
        "acceleration": Output({"x''": r}, "m/s^2"),
        "turning": Output({"x'": 1.0}, "rad/s"),
        "friction_force": Output({"T:contact": 1.0}, "N"),
        "surface_speed": Output({"speed" if lag else "command": r}, "m/s"),
    }
    a.inputs = {
        "load.force": Input("N", 0.0, 100.0, 20.0, 0.0, state="load"),
        "drive.speed": Input("m/s", -5.0, 5.0, 0.06 / r, 0.0, state="command"),
    }
    return a


def scene(assembly, sensors=SENSORS, **sections):
    """What the design step takes of a scene whose controllers believe in the rig `assembly`."""
    parts = {"name": "PEND", "controllers": sections, "sensors": sensors, "parameters": None}
    return SimpleNamespace(**parts, designed_for=SimpleNamespace(**parts, assemble=lambda: assembly))


def normal_force(**given):
    return NormalForce(**{"kind": "normal_force", "sensor": "laser", "velocity": "observed", "gain": 200.0} | given)


def test_a_measured_velocity_needs_scales_and_no_observer():
    found = design.numbers(scene(rig(), a=normal_force(sensor="vibrometer", velocity="measured")))["a"]
    assert found == {
        "frequency": pytest.approx(3.5588, abs=1e-4),
        "read_scale": pytest.approx(1.0),
        "nominal": 20.0,
        "drive_scale": pytest.approx(1.0),
    }


@pytest.mark.parametrize("lag", [None, 0.01])
def test_a_pendulum_is_commanded_in_its_own_unit(lag):
    belt = BeltVelocity(kind="belt_velocity", sensor="encoder", gain=2.0)
    sampled = SampledDither(kind="dither_sampled", amplitude=0.1)
    found = design.numbers(scene(rig(RADIUS, lag), belt=belt, sampled=sampled))
    assert found["belt"]["read_scale"] == pytest.approx(RADIUS)
    for numbers in found.values():
        assert numbers["drive_scale"] == pytest.approx(1.0 / RADIUS)
        assert numbers["nominal"] == pytest.approx(0.06)


@pytest.mark.parametrize("sensor", ["laser", "accelerometer", "vibrometer"])
@pytest.mark.parametrize("radius", [None, RADIUS])
def test_the_observer_is_stable_and_the_same_for_belt_and_pendulum(sensor, radius):
    found = design.numbers(scene(rig(radius), a=normal_force(sensor=sensor)))["a"]["observer"]
    F, C, L = (np.array(found[key]) for key in ("transition", "output", "gain"))
    poles = np.log(np.linalg.eigvals(F - F @ np.outer(L, C))) / 1e-3
    assert poles.real.max() < (0.0 if sensor == "vibrometer" else -1.0)  # what no velocity sees may creep
    reference = design.numbers(scene(rig(), a=normal_force(sensor=sensor)))["a"]["observer"]
    for ours, theirs in ((radius or 1.0, found), (1.0, reference)):
        assert ours * np.array(theirs["gain"])[1] == pytest.approx(reference["gain"][1], rel=1e-6)


def test_the_gain_is_that_of_the_riccati_equation():
    """The same observer, unscaled and by scipy alone."""
    found = design.numbers(scene(rig(), a=normal_force(unknown_force=10.0)))["a"]["observer"]
    f = math.sqrt(500.0) / (2.0 * math.pi)
    A = np.array([[0.0, 1.0, 0.0], [-500.0, -0.4, 0.2], [0.0, 0.0, -f]])
    C, T = np.array([[1.0, 0.0, 0.0]]), 1e-3
    assert np.array(found["model"]) == pytest.approx(A, abs=1e-9)
    both = scipy.linalg.expm(np.block([[-A, np.diag([0.0, 0.0, 100.0 * f])], [np.zeros((3, 3)), A.T]]) * T)
    F = both[3:, 3:].T
    r = 1.5e-6**2 + 1.5e-6**2 / 12.0
    P = scipy.linalg.solve_discrete_are(F.T, C.T, F @ both[:3, 3:], [[r]])
    assert np.array(found["transition"]) == pytest.approx(F, abs=1e-9)
    assert np.array(found["gain"]) == pytest.approx((P @ C.T / (C @ P @ C.T + r)).ravel(), rel=1e-4)


@pytest.mark.parametrize("sensor", ["laser", "accelerometer"])
def test_a_wrong_zero_of_the_instrument_is_no_velocity(sensor):
    o = observer(design.numbers(scene(rig(), a=normal_force(sensor=sensor)))["a"]["observer"])
    zero = {"laser": 1e-3, "accelerometer": 0.02}[sensor]
    z = at_rest(o, zero)
    for _ in range(10_000):
        z, v = advanced(o, z, zero)
    assert abs(v) < 1e-3


def test_the_law_of_friction_does_not_enter():
    a, b = rig(), rig()
    b.patches[0] = (*b.patches[0][:3], stribeck(0.9, 0.1, 0.2), *b.patches[0][4:])
    found = design.numbers(scene(a, a=normal_force()))
    assert found == design.numbers(scene(b, a=normal_force())) == json.loads(json.dumps(found))


def test_all_faults_are_told_at_once_with_their_keys():
    faulty = scene(
        rig(),
        a=normal_force(velocity="measured"),
        b=normal_force(period="1.5 ms"),
        c=normal_force(sensor="vibrometer", drive="drive.speed"),
    )
    with pytest.raises(SceneError) as told:
        design.numbers(faulty)
    assert "controllers.a.velocity: is 'measured', but laser reads displacement" in str(told.value)
    assert "controllers.b.period: is 0.0015 s; an observer needs a fresh sample each time" in str(told.value)
    assert "controllers.c.drive: drive.speed does not move" in str(told.value)


def dithered(on, radius=None):
    from rig.plants import belt, pendulum

    r = radius or 1.0
    tables = {
        "load": {"force": 20.0},
        "friction": {"law": "stribeck", "mu_static": 0.5, "mu_dynamic": 0.18, "speed_scale": 0.05},
        "dither": {"on": on, "amplitude": 0.1, "frequency": 200.0, "phase": 1.0},
        "drive": {"speed": 0.06 / r},
    }
    if radius is None:
        body = {"mass": 5.0, "stiffness": 2500.0, "damping": 2.0}
        return belt.assemble(belt.Parameters.model_validate(tables | {"body": body}))
    body = {"radius": r, "inertia": 5.0 * r**2, "stiffness": 2500.0 * r**2, "damping": 2.0 * r**2}
    return pendulum.assemble(pendulum.Parameters.model_validate(tables | {"body": body}))


@pytest.mark.parametrize("radius", [None, RADIUS])
@pytest.mark.parametrize("on", ["belt", "mass"])
def test_a_dither_is_told_in_the_unit_of_its_generator(on, radius):
    found = design.numbers(scene(dithered(on, radius), a=Dither(kind="dither", sensor="vibrometer")))["a"]
    assert found["nominal"] == 0.06  # without the dither that shakes the surface at the start
    assert found["frequency"] == 200.0
    controller = controllers.build(Dither(kind="dither", sensor="vibrometer"), found)
    _, (amplitude, frequency, enable) = controller.update(controller.start(), 0, (0.0,))
    assert (frequency, enable) == (200.0, 1.0)
    expected = 0.2 if on == "belt" else 0.2 * 2.0 * math.pi * 200.0 * 5.0
    assert amplitude == pytest.approx(expected)


@pytest.mark.parametrize(("radius", "reads"), [(None, "surface_speed"), (RADIUS, "disc_speed")])
def test_the_belt_speed_may_be_measured_at_the_disc(radius, reads):
    section = Dither(kind="dither", sensor="vibrometer", speed_sensor="disc")
    sensors = SENSORS | {"disc": DiscSpeed(reads=reads)}
    given = scene(dithered("belt", radius), sensors, a=section)
    found = design.numbers(given)["a"]
    assert found["speed_scale"] == pytest.approx(1.0 if reads == "surface_speed" else RADIUS)


def test_a_dither_of_the_load_has_no_search():
    with pytest.raises(SceneError, match="searches a tangential dither"):
        design.numbers(scene(dithered("load"), a=Dither(kind="dither", sensor="vibrometer")))
    with pytest.raises(SceneError, match=r"controllers.a.kind: .* no \[dither\]"):
        design.numbers(scene(rig(), a=Dither(kind="dither", sensor="vibrometer")))


def test_every_scene_that_ships_gets_its_numbers(shipped):
    for given in shipped:
        for name, numbers in design.numbers(given).items():
            controllers.build(given.controllers[name], numbers)
