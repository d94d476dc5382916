"""Loops about steady sliding: the linearised rig, closed-loop eigenvalues, margins.

Rightmost roots with a pure delay: Kroeger, Neubauer, Popp (2008), equations 4.6 to 4.9, set PEND, by independent code
(tests/reference/loop_roots.json). Everything sampled is held against the simulation itself.
"""

import json
import math
import re
from pathlib import Path

import control
import numpy as np
import pytest

import rig
from rig import controllers
from rig.analysis.linear.control_loop import plant, sweep_loop
from rig.design import numbers, sampled_loops
from rig.design.sampled_loops import ControlLoop, sampled
from rig.errors import SceneError
from rig.scenes.axis import Axis

ROOTS = json.loads((Path(__file__).parents[1] / "reference" / "loop_roots.json").read_text())
FINE = {"clock.frame": "100 us", "controllers.nf.period": "100 us", "sensors.vibrometer.rate": "10 kHz"}
QUIET = {"clock.tolerance": 1e-12, "controllers.nf.enable_at": 0.0, "drive.speed": 0.1}


def closed(space, actuator, gain):
    b = space.B[:, [space.input_labels.index(actuator)]]
    return np.linalg.eigvals(space.A + gain * b @ space.C[[space.output_labels.index("velocity")]])


@pytest.mark.parametrize("column", range(len(ROOTS["taus"])))
@pytest.mark.parametrize(
    ("table", "scene", "actuator", "sign"),
    [("NF", "belt_normal_force", "load_force", -1.0), ("BV", "belt_velocity_feedback", "drive_speed", 1.0)],
)
def test_the_rightmost_roots_with_a_delay_are_those_of_the_reference(table, scene, actuator, sign, column):
    space = rig.state_space(scene, ROOTS["taus"][column])
    for gain, row in ROOTS[table].items():
        found = closed(space, actuator, sign * float(gain))
        rightmost = found[np.argmax(found.real)]
        assert rightmost.real == pytest.approx(row[column][0], rel=1e-6)
        assert abs(rightmost.imag) == pytest.approx(abs(row[column][1]), rel=1e-6)


def test_the_state_space_is_that_of_the_rig():
    """T = mu(w) N about (w, N) = (v0, F0): written out for one mass."""
    space = rig.state_space("belt")
    slope, mu = -0.32 / 0.05 * math.exp(-1.2), 0.18 + 0.32 * math.exp(-1.2)
    assert list(space.input_labels) == ["drive_speed", "load_force"]
    assert space.A == pytest.approx(np.array([[0.0, 1.0], [-500.0, -(2.0 + 20.0 * slope) / 5.0]]), rel=1e-12)
    assert space.B == pytest.approx(np.array([[0.0, 0.0], [20.0 * slope / 5.0, mu / 5.0]]), rel=1e-12)
    rows = dict(zip(space.output_labels, np.hstack([space.C, space.D])))
    assert rows["friction_force"] == pytest.approx([0.0, -20.0 * slope, 20.0 * slope, mu], rel=1e-12)
    assert rows["normal_force"] == pytest.approx([0.0, 0.0, 0.0, 1.0])
    assert rows["slip_speed"] == pytest.approx([0.0, -1.0, 1.0, 0.0])
    assert rows["acceleration"] == pytest.approx([*space.A[1], *space.B[1]], rel=1e-12)


def test_the_gain_that_makes_sliding_stable():
    """K_lin for a loop without delay; sample and hold at 0.1 ms moves it by 1e-6, at 1 ms by 1e-4."""
    for changes, off in ((FINE, 2e-5), ({}, 2e-4)):
        scene = rig.load("belt_normal_force", changes)
        found = rig.sweep(scene, "controllers.nf.gain", np.linspace(0.0, 400.0, 9), controller="nf")
        [one] = found.critical
        assert one.value == pytest.approx(ROOTS["K_lin"], rel=off)
        assert (one.kind, one.becomes) == ("flutter", "stable")
        assert rig.loop(scene, "nf").gain_range[0] == pytest.approx(one.value, rel=1e-9)
    assert found.loop == "nf"
    assert set(one.shape) == {"x", "x'"}


def pole(run, period, start):
    """The pair lambda of a decaying oscillation after `start` [s], from samples of about a sixth of its period."""
    stride = round(0.045 / period) * round(period / (run.time[1] - run.time[0]))
    v, step = run.signals["velocity"][run.time > start], stride * (run.time[1] - run.time[0])
    (a, b), *_ = np.linalg.lstsq(np.stack([v[stride:-stride], -v[: -2 * stride]], axis=1), v[2 * stride :], rcond=None)
    return np.log(complex(a, math.sqrt(4.0 * b - a * a)) / 2.0) / step


SMOOTH = {  # an instrument with a lag and a transport time, without noise
    "sensors.vibrometer.ideal": "false",
    "sensors.vibrometer.bandwidth": "40 Hz",
    "sensors.vibrometer.delay": "2.3 ms",
    "sensors.vibrometer.noise": 0.0,
    "sensors.vibrometer.offset": 0.0,
    "sensors.vibrometer.resolution": "1e-15 m/s",
    "sensors.vibrometer.dropout_rate": "0 1/s",
}
LOOPS = {
    "late": {"controllers.nf.delay": "7 ms"},
    "late, but ideal, sensor": {"sensors.vibrometer.delay": "17 ms", "controllers.nf.gain": "365 N*s/m"},
    "slow and late": {"controllers.nf.period": "10 ms", "controllers.nf.delay": "14 ms"},
    "slow sensor": {"sensors.vibrometer.rate": "50 Hz", "controllers.nf.delay": "3 ms"},
    "slow sensor, late by more than its period": {"sensors.vibrometer.rate": "100 Hz", "controllers.nf.delay": "24 ms"},
    "filtered and predicted": {"controllers.nf.filter": "30 Hz", "controllers.nf.compensation": "5 ms"},
    "an instrument and a slow controller": SMOOTH | {"controllers.nf.period": "4 ms", "controllers.nf.delay": "5 ms"},
    "a magnet with a lag": {"load.lag": "5 ms"},
}


@pytest.mark.parametrize("name", LOOPS)
def test_a_loop_decays_in_the_simulation_as_its_eigenvalue_says(name):
    changes = QUIET | LOOPS[name]
    scene = rig.load("belt_normal_force", changes)
    loop = rig.loop(scene, "nf")
    fast = loop.spectrum.rates[0]
    rest = rig.modes(scene).sliding.equilibrium["displacement"]
    scene = rig.load("belt_normal_force", changes | {"start.displacement": rest + 1e-6, "start.velocity": 0.0})
    found = pole(rig.simulate(scene, 2.0), loop.model.period, 0.5)
    assert found == pytest.approx(fast, rel=1e-6)


@pytest.mark.parametrize("name", LOOPS)
def test_a_cut_loop_that_is_closed_is_the_loop_that_is_not_cut(name):
    scene = rig.load("belt_normal_force", LOOPS[name])
    section, sensor = scene.controllers["nf"], scene.sensors["vibrometer"]
    feedback = controllers.build(section, numbers(scene)["nf"])
    loop = ControlLoop(feedback, sensor.reads, sensor.front_end(), section.delay)
    whole = sampled_loops.closed(plant(scene), [loop]).matrix
    assert sampled(plant(scene), loop).closed() == pytest.approx(whole, rel=1e-12, abs=1e-12)


def test_the_delay_of_an_ideal_sensor_is_in_the_loop():
    """A held command, 17 periods old: roots of det(z I - A) z^17 + K c adj(z I - A) b, written out for one mass."""
    m, c, k, gain, period, late = 5.0, 2.0, 2500.0, 365.0, 1e-3, 17
    mu, slope = 0.18 + 0.32 * math.exp(-1.2), -0.32 / 0.05 * math.exp(-1.2)
    damping = (c + 20.0 * slope) / m
    root = np.sqrt(complex(0.25 * damping**2 - k / m))
    p, q = -0.5 * damping + root, -0.5 * damping - root
    A = np.array([[0.0, 1.0], [-k / m, -damping]])
    F = ((np.exp(p * period) * (A - q * np.eye(2)) - np.exp(q * period) * (A - p * np.eye(2))) / (p - q)).real
    g = np.linalg.solve(A, (F - np.eye(2)) @ [0.0, mu / m])
    adjugate = np.array([[[1.0, -F[1, 1]], [0.0, F[0, 1]]], [[0.0, F[1, 0]], [1.0, -F[0, 0]]]])
    polynomial = np.polymul([1.0, -F.trace(), np.linalg.det(F)], [1.0] + [0.0] * late)
    polynomial = np.polyadd(polynomial, gain * np.einsum("jk,j->k", adjugate[1], g))
    rates = np.log(np.roots(polynomial)) / period
    expected = rates[np.argmax(rates.real)]
    changes = {"controllers.nf.gain": gain, "sensors.vibrometer.delay": "17 ms"}
    loop = rig.loop(rig.load("belt_normal_force", changes), "nf")
    assert loop.growth == pytest.approx(expected.real, rel=1e-9)
    assert abs(loop.spectrum.rates[0].imag) == pytest.approx(abs(expected.imag), rel=1e-9)
    assert loop.growth == pytest.approx(-8.33028, abs=5e-6)
    assert loop.delay == pytest.approx(0.017)


def test_echoes_are_no_part_of_a_loop():
    changes = {"sensors.vibrometer.kind": "microphone"}
    with pytest.raises(SceneError, match=r"nf\.sensor: has echoes.*paths = \[\]"):
        rig.loop(rig.load("belt_normal_force", changes | {"sensors.vibrometer.ideal": "false"}), "nf")
    rig.loop(rig.load("belt_normal_force", changes), "nf")


def test_an_observed_loop_is_discretised_with_its_observer():
    """At rest the observer still reads a velocity off the friction force: the load settles beside the scene's."""
    changes = QUIET | {"sensors.laser.noise": 0.0, "sensors.laser.resolution": "1e-15 m", "start.velocity": 0.0}
    rest = rig.modes(rig.load("belt_normal_force_displacement", changes)).sliding.equilibrium["displacement"]
    run = rig.simulate(rig.load("belt_normal_force_displacement", changes | {"start.displacement": rest + 1e-6}), 6.0)
    load = float(run.signals["normal_force"][-1])
    assert load == pytest.approx(20.0, rel=2e-4)
    loop = rig.loop(rig.load("belt_normal_force_displacement", changes | {"load.force": load}), "nf")
    assert pole(run, 1e-3, 0.5) == pytest.approx(loop.spectrum.rates[0], rel=1e-6)


@pytest.mark.parametrize("scene", ["belt_velocity_feedback", "belt_normal_force_displacement"])
def test_margins_agree_with_python_control(scene):
    [name] = rig.load(scene).controllers
    loop = rig.loop(scene, name)
    omega = np.unique(
        np.concatenate([np.geomspace(1.0, 0.999 * math.pi / loop.model.period, 1500), np.linspace(15.0, 40.0, 4000)])
    )
    data = control.FRD(loop.response(omega), omega)
    gains, phases, _, _, at_phase, _ = control.stability_margins(data, returnall=True)
    low, high = loop.gain_range
    assert loop.gain * max(g for g in gains if g < 1.0) == pytest.approx(low, rel=1e-5)
    above = [
        loop.gain * g for g in gains if g > 1.0
    ]  # what turns over at the last frequency, python-control leaves out
    assert min(above, default=loop.gain / abs(loop.response(omega[-1:])[0])) == pytest.approx(high, rel=3e-3)
    assert math.degrees(loop.margins["phase"]) == pytest.approx(np.abs(phases).min(), rel=1e-5)
    turns = np.mod(np.radians(phases), 2.0 * math.pi) / at_phase
    assert loop.margins["delay"] == pytest.approx(turns.min(), rel=1e-5)


def test_the_opened_loop_is_a_state_space_that_unity_feedback_closes():
    loop = rig.loop("belt_normal_force", "nf")
    ours = np.exp(loop.spectrum.rates * loop.model.period)
    theirs = control.feedback(loop.state_space()).poles()
    assert sorted(theirs[np.abs(theirs) > 1e-6], key=np.imag) == pytest.approx(sorted(ours, key=np.imag), rel=1e-9)


def test_the_loop_bears_its_delay_margin_and_no_more():
    margin = rig.loop("belt_normal_force", "nf").margins["delay"]
    late = rig.loop(rig.load("belt_normal_force", {"controllers.nf.delay": "31 ms"}), "nf")
    assert late.margins["delay"] == pytest.approx(margin - 31e-3, abs=2e-6)
    scene = rig.load("belt_normal_force")
    found = sweep_loop(scene, Axis.of("controllers.nf.delay", [0.025, 0.035], scene, "nf"), "nf")
    assert [one.value for one in found.critical] == pytest.approx([margin], rel=1e-4)
    assert [one.becomes for one in found.critical] == ["unstable"]


def test_a_card_that_is_too_slow_has_no_gain_that_works():
    """25 Hz and 20 ms: fails for every gain (the reference's loops with a LabJack U12)."""
    loop = rig.loop("belt_slow_card", "nf")
    assert loop.gain_ranges == []
    assert loop.gain_range is None
    assert loop.margins is None
    assert "stable with no gain" in loop.text()


def test_a_gain_of_the_wrong_sign_is_named():
    right, wrong = (rig.loop(rig.load("belt_normal_force", {"controllers.nf.gain": g}), "nf") for g in (200.0, -200.0))
    assert wrong.gain_ranges == [pytest.approx(one, rel=1e-9) for one in right.gain_ranges]
    assert wrong.gain_range is None
    assert wrong.margins is None
    assert "stable with a gain from 132.266 to 36180.4 N*s/m" in wrong.text()
    assert "its own gain, -200 N*s/m, has the wrong sign" in wrong.text()
    assert "wrong sign" not in right.text()


def test_a_negative_gain_has_its_range_and_margins():
    """Late by half a period of 0.28 s: now the other sign damps. Against python-control."""
    late = {"controllers.nf.delay": "140 ms", "controllers.nf.gain": -200.0, "controllers.nf.period": "10 ms"}
    loop = rig.loop(rig.load("belt_normal_force", late), "nf")
    assert loop.growth < 0.0
    [(low, high)] = loop.gain_ranges
    assert low < -200.0 < high < 0.0
    for gain in np.linspace(2.0 * low, -2.0 * low, 11):
        stable = np.abs(np.linalg.eigvals(loop.model.closed(gain))).max() < 1.0
        assert stable is np.bool_(low < gain < high)
    omega = np.unique(np.concatenate([np.geomspace(1.0, 300.0, 1000), np.linspace(10.0, 50.0, 3000)]))
    gains, phases, *_ = control.stability_margins(control.FRD(loop.response(omega), omega), returnall=True)
    assert -200.0 * max(g for g in gains if g < 1.0) == pytest.approx(high, rel=1e-5)
    assert -200.0 * min(g for g in gains if g > 1.0) == pytest.approx(low, rel=1e-5)
    assert math.degrees(loop.margins["phase"]) == pytest.approx(np.abs(phases).min(), rel=1e-5)


def test_a_loop_gain_that_never_reaches_one_has_no_margins():
    loop = rig.loop(rig.load("belt_normal_force", {"drive.speed": 0.3, "controllers.nf.gain": 1e-3}), "nf")
    w = np.geomspace(1e-2, 0.999 * math.pi / loop.model.period, 20_000)
    assert np.abs(loop.response(w)).max() < 1.0
    assert "no phase margin and no delay margin: the loop gain never reaches 1" in loop.text()
    assert not re.search("nan|inf", loop.text())
    assert "phase margin" in rig.loop("belt_normal_force", "nf").text()


@pytest.mark.parametrize(
    ("scene", "name", "changes", "told"),
    [
        ("belt", "nf", {}, "controller nf: unknown; there is none in this scene"),
        ("belt_normal_force", "nf", {"drive.speed": 0.0}, "no steady sliding"),
        (
            "belt_normal_force",
            "nf",
            {"controllers.nf.period": "3 ms", "sensors.vibrometer.rate": "500 Hz"},
            "3 ms and the 2 ms between samples are not multiples",
        ),
    ],
)
def test_loops_that_cannot_be_are_refused(scene, name, changes, told):
    with pytest.raises(SceneError) as raised:
        rig.loop(rig.load(scene, changes), name)
    assert told in str(raised.value)


def test_the_command_closes_the_loop_and_tells_all_faults(rig):
    code, out, _ = rig("modes", "belt_normal_force", "--controller", "nf")
    assert (code, "stable with a gain from 132.266 to" in out) == (0, True)
    code, _, err = rig("modes", "belt_normal_force", "--controller", "nff", "--sweep", "load.force=1:2:1")
    assert (code, "did you mean nf?" in err, "count = 1" in err) == (2, True, True)


def test_an_observer_of_modes_has_a_loop_too():
    """The squeal grows without it; a loop that is late by its delay margin begins to grow."""
    scene = rig.load("brake_active")
    found = rig.loop(scene, "nb")
    low, high = found.gain_range
    assert found.growth < 0.0 < low < 1.0 < high
    section, sensor = scene.controllers["nb"], scene.sensors["vibrometer"]
    feedback = controllers.build(section, numbers(scene)["nb"])

    def growth(late):
        late_loop = ControlLoop(feedback, sensor.reads, sensor.front_end(), round(1e9 * late))
        model = sampled(plant(scene), late_loop)
        return math.log(np.abs(np.linalg.eigvals(model.closed())).max()) / model.period

    margin = found.margins["delay"]
    assert growth(0.98 * margin) < 0.0 < growth(1.02 * margin)
