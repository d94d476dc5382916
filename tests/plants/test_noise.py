"""Process noise: its size against closed forms, what a stuck contact does with it, and that every run has the same."""

import math

import numpy as np
import pytest
from scipy.signal import welch

import rig
from rig import scenes
from rig.bench.run.runner import PlantRunner
from rig.scenes.shipped import card

FORCE = 0.5  # N/Hz^0.5
FREE = {"load.force": "0 N", "noise.force": FORCE, "body.damping": 50.0, "start.velocity": 0.0}


@pytest.fixture(scope="module")
def free():
    """The mass on its spring, no friction, shaken for 400 s: 2000 times its memory of 0.2 s."""
    return rig.simulate(rig.load("belt", FREE), 400.0)


def test_the_frame_changes_what_is_drawn_and_not_how_strong_it_is():
    run = rig.simulate(rig.load("belt", {**FREE, "clock.frame": "0.25 ms"}), 60.0)
    assert run.signals["velocity"].std() == pytest.approx(math.sqrt(FORCE**2 / 2.0 / 500.0), rel=0.1)


def test_the_mass_moves_as_white_noise_moves_it(free):
    # m x'' + d x' + c x = F, <F F> = D delta, D = FORCE^2 / 2 two-sided: <v^2> = D / (2 m d), <x^2> = D / (2 c d)
    D, m, c, d = FORCE**2 / 2.0, 5.0, 2500.0, 50.0
    assert free.signals["velocity"].std() == pytest.approx(math.sqrt(D / (2.0 * m * d)), rel=0.03)
    assert free.signals["displacement"].std() == pytest.approx(math.sqrt(D / (2.0 * c * d)), rel=0.03)


def test_the_density_of_the_force_is_what_the_scene_says(free):
    f, density = welch(free.signals["noise_force"], fs=1000.0, nperseg=1000)
    low = (f > 1.0) & (f < 450.0)
    assert math.sqrt(density[low].mean()) == pytest.approx(FORCE, rel=0.01)
    assert free.units["noise_force"] == "N"


def test_the_ledger_has_the_work_of_the_noise(free):
    energy = free.energy
    assert energy["forces"] == pytest.approx(energy["damper"], rel=0.05)
    assert abs(energy["error"]) < 1e-9


def at_rest(force):
    still = {"drive.speed": "0 m/s", "start.velocity": 0.0, "noise.force": force}
    return rig.simulate(rig.load("belt", still), 5.0)


def test_a_contact_that_sticks_bears_it_and_lets_go_what_it_overcomes():
    run = at_rest(0.02)
    assert run.signals["noise_force"].std() > 0.4
    assert not run.signals["velocity"].any()
    assert np.array_equal(run.signals["friction_force"][1:], -run.signals["noise_force"][1:])
    assert not [event for event in run.events if event["kind"] == "contact"]
    run = at_rest(0.3)  # 6.7 N rms; 10 N are held
    stuck = run.signals["velocity"] == 0.0
    assert 0.01 < 1.0 - stuck.mean() < 0.99
    assert np.all(np.abs(run.signals["friction_force"][stuck]) <= 10.0 * (1.0 + 1e-12))


def test_it_depends_on_the_seed_and_on_nothing_else():
    def drawn(**changes):
        return rig.simulate(rig.load("belt", {"noise.force": 0.1, **changes}), 6.0).signals["noise_force"]

    first = drawn()
    assert np.array_equal(first, drawn())
    assert np.array_equal(first, drawn(**{"sensors.laser": None, "drive.speed": 0.1, "clock.method": "rk4"}))
    assert not np.array_equal(first[1:], drawn(seed=2)[1:])
    assert np.array_equal(2.0 * first, drawn(**{"noise.force": 0.2}))


@pytest.mark.parametrize(("scene", "changes"), [("belt", {}), ("brake", {"noise.force": 1e-3}), ("plate", {})])
def test_frame_by_frame_or_many_at_once_are_the_same_bits(scene, changes):
    made = rig.load(scene, {"noise.force": 1e-2, **changes})
    one, many = PlantRunner(made), PlantRunner(made, truthful=True)
    count = {"belt": 2000}.get(scene, 100)
    for _ in range(count):
        one.frame()
    while many.tick < count:
        many.frames(count - many.tick)
    assert np.array_equal(one.motion.x, many.motion.x)
    assert one.motion.x[one.motion.system.names.index("noise")] != 0.0


def test_another_strength_from_some_instant_on_goes_on_with_the_same_numbers():
    runner, other = (PlantRunner(rig.load("belt", {"noise.force": 0.1})) for _ in range(2))
    for tick in range(100):
        if tick == 50:
            runner.set_parameter("noise.force", 0.2)
        runner.frame()
        other.frame()
        assert runner.output("noise_force") == (2.0 if tick >= 50 else 1.0) * other.output("noise_force")


def test_a_knock_and_noise_reach_every_rig():
    for scene in {card(name)["plant"]: name for name in scenes.names()}.values():
        system = rig.load(scene, {"noise.force": 1.0}).assemble().system()
        assert system.strike.any()
        noisy = system.force[:, system.names.index("noise")]
        assert np.allclose(noisy / np.abs(noisy).max(), system.strike / np.abs(system.strike).max())
