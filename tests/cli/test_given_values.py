"""A fault of a changed value names what changed it: an option, a line of a study or of a torture case, the call."""

import numpy as np
import pytest

import rig as package
from rig.errors import SceneError
from rig.papers.entry import quiet

SET = '\n[set]\n"body.mas" = "3 kg"\n[set.drive]\nspeed = "3 kg"\n'
MASS = "body.mas: unknown key; did you mean body.mass? ({})"
SPEED = 'drive.speed = "3 kg": expected a unit that converts to m/s ({})'


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("-p", "body.mas=3 kg"), MASS.format("given with -p")),
        (("--net", "meas/vibro: delay 2 ms"), "did you mean vibrometer? (given with --net)"),
        (
            ("--method", "exct"),
            'clock.method = "exct": unknown; known: auto, exact, dopri5, dop853, rosenbrock, rk4, kick, smooth '
            "(given with --method)",
        ),
        (("--controller", "own.py"), "own.py: defines no class Controller (given with --controller)"),
        (("--method", "exact", "-p", "clock.method=dopri5"), "--method and -p: both give clock.method; leave out one"),
    ],
)
def test_an_option_is_named(rig, tmp_path, monkeypatch, options, told):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.py").write_text("")
    code, _, err = rig("simulate", "belt", *options)
    assert code == 2
    assert told in err


def test_a_decimal_comma_is_a_point_on_the_command_line(rig):
    outputs = {text: rig("explain", "belt", "-p", f"load.force={text}") for text in ("15,5 N", "15.5 N")}
    assert outputs["15,5 N"][:2] == outputs["15.5 N"][:2]
    assert outputs["15,5 N"][0] == 0
    lines = [rig("modes", "belt", "--sweep", f"load.force=10{point}5 N:12 N:2")[1] for point in ",."]
    assert lines[0] == lines[1]


@pytest.mark.parametrize(
    ("scene", "told"),
    [
        ("belt_c", "nothing vibrates and nothing decays in steady sliding"),
        ("belt", "no spring holds x, so forces there find no balance"),
    ],
)
def test_a_rig_that_cannot_vibrate_is_told(rig, scene, told):
    for command in (("cycle", scene), ("map", scene, "--x", "drive.speed=0.01:0.1:2")):
        code, _, err = rig(*command, "-p", "body.stiffness=0")
        assert code == 2
        assert told in err


@pytest.mark.parametrize(
    ("scene", "key"),
    [
        ("belt_tuned_mass", "body.stiffness"),
        ("pin", "pin.stiffness"),
        ("north", "body.tilt_stiffness"),
        ("four_dof", "spring_5.stiffness"),
    ],
)
def test_a_spring_may_be_absent(scene, key):
    loose = package.load(scene, {key: 0.0})
    found = package.modes(loose).sliding
    assert found.modes or "no spring holds" in found.why
    assert np.isfinite([one.growth for one in found.modes]).all()
    run = package.simulate(loose, 0.05)
    assert all(np.isfinite(values).all() for values in run.signals.values())


@pytest.mark.parametrize(
    ("scene", "key"),
    [("tread", "tip.tangential_stiffness"), ("tip", "tip.stiffness"), ("belt_shunt", "body.stiffness")],
)
def test_without_a_spring_that_prevents_divergence_no_run_starts(scene, key):
    with pytest.raises(SceneError, match="divergence"):
        package.simulate(package.load(scene, {key: 0.0}), 0.05)


def test_a_pendulum_without_a_spring_turns_with_the_disc():
    """Dragged to the speed of the disc within w J / (mu N r^2), with constant friction; then it sticks."""
    changes = {"body.stiffness": 0.0, "body.damping": 0.0, "friction.law": "constant", "friction.mu": 0.3}
    changes |= {"start.displacement": 0.0, "start.velocity": 0.0, "limits.displacement": "none"}
    scene = package.load("pendulum", changes)
    p = scene.parameters
    speed = p.drive.speed * p.body.radius
    run = package.simulate(quiet(scene), 2.0)
    push = 0.3 * p.load.force * p.body.radius**2 / p.body.inertia
    expected = speed * run.time[-1] - 0.5 * speed**2 / push
    assert run.signals["displacement"][-1] == pytest.approx(expected, rel=1e-9)
    assert run.signals["slip_speed"][-1] == 0.0


def test_a_block_without_a_spring_slides_to_a_halt():
    """x = v^2 / (2 mu g) with constant friction; here N is the load."""
    changes = {"body.stiffness": 0.0, "body.damping": 0.0, "drive.speed": 0.0, "start.displacement": 0.0}
    changes |= {"start.velocity": "0.3 m/s", "friction.law": "constant", "friction.mu": 0.3}
    for method in ("exact", "dopri5", "rk4"):
        scene = package.load("belt_c", changes | {"clock.method": method})
        force = 0.3 * scene.parameters.load.force
        run = package.simulate(scene, 2.0)
        expected = 0.5 * scene.parameters.body.mass * 0.3**2 / force
        assert run.signals["displacement"][-1] == pytest.approx(expected, rel=1e-9)
        assert run.signals["velocity"][-1] == 0.0


def test_the_version_is_printed(rig):
    assert rig("--version")[:2] == (0, f"{package.__version__}\n")


def test_a_call_is_named():
    with pytest.raises(SceneError) as found:
        package.load("belt", {"body.mas": 3.0, "drive.speed": "3 kg"})
    assert [*found.value.faults] == [MASS.format("given in the call"), SPEED.format("given in the call")]
