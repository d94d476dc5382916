"""Knocks that take time: the motion and the work of a half sine against closed forms."""

import math
from pathlib import Path

import control
import numpy as np
import pytest
from scipy.linalg import expm

import rig as laboratory
from rig.analysis.recorded import response
from rig.effects import knock

MASS, STIFFNESS, DAMPING = 5.0, 2500.0, 2.0
IMPULSE, DURATION = 0.05, 0.01
FREE = """format = 1
based_on = "belt_c"
protocol = [
    { step = "hold", time = "0.1 s" },
    { step = "knock", impulse = "0.05 N*s", duration = "10 ms" },
    { step = "hold", time = "3 s" },
]
body.damping = "2 N*s/m"
load.force = "0 N"
start = { displacement = "0 m", velocity = "0 m/s" }
sensors.laser.rate = "10 kHz"
"""


@pytest.fixture
def scene(tmp_path):
    """Makes a scene of the text above: a mass on a spring and a damper that no friction holds."""

    def make(changes=None, text=FREE):
        path = Path(tmp_path) / "struck.toml"
        path.write_text(text)
        return laboratory.load(path, changes or {})

    return make


def struck(t):
    """Displacement and velocity t [s] after the begin of the knock, by a matrix exponential."""
    omega = math.pi / DURATION
    a = np.array([[0, 1, 0, 0], [-STIFFNESS / MASS, -DAMPING / MASS, 1 / MASS, 0], [0, 0, 0, omega], [0, 0, -omega, 0]])
    x = expm(a * min(t, DURATION)) @ [0.0, 0.0, 0.0, math.pi * IMPULSE / (2.0 * DURATION)]
    return expm(a[:2, :2] * max(t - DURATION, 0.0)) @ x[:2]


@pytest.mark.parametrize(("method", "off"), [("exact", 1e-12), ("dopri5", 1e-12), ("smooth", 1e-6), ("rk4", 1e-7)])
def test_the_mass_moves_as_a_half_sine_moves_it(scene, method, off):
    run = laboratory.simulate(scene({"clock.method": method}))
    size = np.abs(run.signals["displacement"]).max(), np.abs(run.signals["velocity"]).max()
    for t in (0.003, 0.01, 0.5, 2.9):
        i = int(np.argmin(np.abs(run.time - 0.1 - t)))
        found = run.signals["displacement"][i], run.signals["velocity"][i]
        assert np.abs((found - struck(t)) / size).max() < off
    force = run.signals["knock_force"]
    inside = (run.time > 0.1) & (run.time < 0.11)
    exact = 0.5 * math.pi * IMPULSE / DURATION * np.sin(math.pi * (run.time - 0.1) / DURATION)
    assert force[inside] == pytest.approx(exact[inside], abs=1e-5 * exact.max())
    assert not force[(run.time < 0.0999) | (run.time > 0.1101)].any()
    assert run.units["knock_force"] == "N"


def test_halving_the_step_of_rk4_divides_the_error_by_sixteen(scene):
    off = []
    for step in ("1 ms", "0.5 ms", "0.25 ms"):
        run = laboratory.simulate(scene({"clock.method": "rk4", "clock.rk4_step": step, "sensors.laser.rate": "1 kHz"}))
        off.append(abs(run.signals["displacement"][110] - struck(0.01)[0]))
    assert np.log2(np.array(off)[:-1] / np.array(off)[1:]) == pytest.approx(4.0, abs=0.3)


def test_the_work_of_the_hammer_is_in_the_energy_balance(scene):
    """E at the end of the knock: m v^2 / 2 + k x^2 / 2, and what the damper has taken by then."""
    energy = laboratory.simulate(scene(), 0.11).energy
    x, v = struck(DURATION)
    stored = 0.5 * MASS * v**2 + 0.5 * STIFFNESS * x**2
    assert energy["stored"] == pytest.approx(stored, rel=1e-10)
    assert energy["forces"] == pytest.approx(stored + energy["damper"], rel=1e-10)
    assert energy["impulses"] == 0.0
    assert abs(energy["error"]) < 1e-12


def test_a_sliding_contact_is_struck_too(scene):
    """Friction falls with speed: dopri5. The work is the integral of force and velocity."""
    sliding = {"load.force": "20 N", "drive.speed": "0.3 m/s", "start.velocity": 0.0, "clock.method": "dopri5"}
    text = FREE.replace("belt_c", "belt").replace('rate = "10 kHz"', 'rate = "20 kHz"')
    made = scene(sliding | {"start.displacement": "0.0015 m"}, text)
    run = laboratory.simulate(made, 0.11)
    force, v = run.signals["knock_force"], run.signals["velocity"]
    work = np.sum(0.5 * (force[1:] * v[1:] + force[:-1] * v[:-1]) * np.diff(run.time))
    assert run.energy["forces"] == pytest.approx(work, rel=1e-4)
    assert abs(run.energy["error"]) < 1e-7
    assert run.signals["slip_speed"].min() > 0.0


def test_a_short_knock_is_one_at_once(scene):
    """After T the displacement differs by I T / (2 m) to first order, the velocity by second order."""
    changes = {"clock.frame": "10 us", "sensors.laser.rate": "1 kHz", "sensors.vibrometer": "none"}
    text = FREE.replace("10 ms", "20 us")
    run = laboratory.simulate(scene(changes, text), 0.10002)
    assert run.signals["velocity"][-1] == pytest.approx(IMPULSE / MASS, rel=1e-5)
    assert run.signals["displacement"][-1] == pytest.approx(IMPULSE * 20e-6 / (2.0 * MASS), rel=1e-5)


def test_two_durations_and_a_sensor(scene):
    more = '    { step = "knock", impulse = "0.1 N*s", duration = "4 ms" },\n]\n'
    hammer = 'sensors.hammer = { kind = "normal_force", reads = "knock_force", rate = "10 kHz", ideal = true }\n'
    run = laboratory.simulate(scene({}, FREE.replace("]\n", more) + hammer))
    t, v = run.measurements["hammer"].t_ns * 1e-9, run.measurements["hammer"].v
    for begin, duration, impulse in ((0.1, 0.01, 0.05), (3.11, 0.004, 0.1)):
        here = (t > begin - 1e-6) & (t < begin + duration + 1e-6)
        whole = v[here].sum() * 1e-4
        assert whole == pytest.approx(impulse, rel=math.pi**2 / 6.0 * (1e-4 / duration) ** 2)  # trapezium rule
        assert v[here].max() == pytest.approx(knock.peak(impulse, round(duration * 1e9)), rel=1e-6)


def test_a_recording_with_such_a_knock_and_noise_holds_to_the_bit(rig, tmp_path, scene):
    scene()
    log = tmp_path / "run.mcap"
    made = rig("simulate", tmp_path / "struck.toml", "-p", "noise.force=0.05 N/Hz^0.5", "--out", log)
    assert made[0] == 0, made
    code, out, err = rig("verify", log)
    assert code == 0, out + err
    _, out, _ = rig("explain", tmp_path / "struck.toml", "-p", "noise.force=0.05")
    assert "the force of a knock: half sine within 10 ms" in out
    assert "a random force along the sliding direction" in out


def test_a_modal_test_finds_the_matrices(scene):
    """Force and displacement of a struck rig: its transfer function, natural frequency and damping ratio."""
    made = scene({"body.damping": "20 N*s/m"}, FREE.replace("3 s", "10 s"))
    run = laboratory.simulate(made)
    found = response(run, "knock_force", "displacement")
    plant = control.tf([1.0], [MASS, 20.0, STIFFNESS])
    low = found.f < 40.0
    exact = plant(2j * math.pi * found.f[low])
    omega = 2.0 * math.pi * found.f[low]
    bias = 1e-8 / 12.0 * ((math.pi / DURATION) ** 2 - omega**2)  # of the force sampled at 10 kHz: Euler and Maclaurin
    assert np.abs(found.h[low] / exact - 1.0 - bias).max() < 0.02 * bias.max()
    [mode] = laboratory.modes(made).sliding.modes
    [one] = found.resonances
    assert one.frequency == pytest.approx(mode.frequency, rel=1e-5)
    assert one.damping == pytest.approx(mode.damping, rel=1e-4)


def test_the_modal_test_of_the_pages_finds_mass_stiffness_and_damper():
    """With sensors that have noise and drift; within what five blows can tell."""
    run = laboratory.simulate(laboratory.load(Path(__file__).parents[2] / "docs" / "modal_test.toml"))
    [one] = response(run, "hammer", "accelerometer").resonances
    rate = 10.0 / (2.0 * MASS)
    assert one.frequency == pytest.approx(math.sqrt(STIFFNESS / MASS - rate**2) / (2.0 * math.pi), rel=1e-3)
    assert one.damping == pytest.approx(rate / math.sqrt(STIFFNESS / MASS), rel=0.01)
