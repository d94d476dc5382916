"""Closed forms of docs/theory for shunt, dither, controllers and the certificate of a quiet tick, evaluated against the
program. Those of filters, noise and echoes are in tests/solve/test_pole_response.py and tests/sensors.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import BPoly
from scipy.linalg import expm
from scipy.optimize import brentq
from scipy.special import i0, i1

import rig
from rig.analysis.cycles.averaged import mean_friction
from rig.analysis.linear.control_loop import loop
from rig.model.mode_sets import ModeSets, guard_bounds
from rig.papers.kroeger_shunt import CAPACITANCE, stack, transfer
from rig.solve.expm import balance
from rig.solve.many_states import QUICK
from rig.stability.linearisation import sliding_key, steady


@pytest.mark.parametrize("delta", [0.0, -0.5, -0.9])
@pytest.mark.parametrize("R", [25.0, 100.0])
def test_a_shunt_in_tune_turns_the_force_by_a_right_angle_and_dissipates_what_the_page_says(R, delta):
    """eq-shunt-stiffness, eq-shunt-resonance: at resonance the imaginary part is 1 / rho for every delta."""
    scene = stack(R, delta)
    coil = scene.parameters.shunt.inductance
    resonance = math.sqrt((1.0 + delta) / (CAPACITANCE * coil))
    rho = R * CAPACITANCE * resonance
    [G] = transfer(scene, np.array([resonance / (2.0 * math.pi)]))
    s = 1j * resonance
    Z = R + s * coil + delta / (s * CAPACITANCE)
    assert pytest.approx(Z / (Z + 1.0 / (s * CAPACITANCE)), rel=1e-9) == G
    assert G.imag == pytest.approx(1.0 / rho, rel=1e-9)


@pytest.mark.parametrize("share", [0.2, 0.9, 1.1, 3.0])
def test_the_mean_force_under_dither_is_the_integral_of_the_page(share):
    """eq-averaged, by quadrature."""
    law, w, a = rig.load("belt").assemble().system().patches[0].law, 0.06, 0.06 * share

    def force(theta):
        slip = w + a * math.cos(theta)
        return law.mu(abs(slip)) * math.copysign(1.0, slip)

    turns = [math.acos(-w / a)] if a > w else []
    expected = quad(force, 0.0, math.pi, points=turns or None, epsabs=1e-12)[0] / math.pi
    assert mean_friction(law, w, 1.0, complex(a))[0] == pytest.approx(expected, rel=1e-9)


def test_dither_below_the_belt_speed_raises_an_exponential_law_by_a_bessel_function():
    """The solution of the lesson on dither: the mean of exp(-w / c) is I0(a / c) exp(-w / c)."""
    p = rig.load("belt").parameters.friction
    law, w, a, c = p.friction(), 0.06, 0.03, p.speed_scale
    mean = p.mu_dynamic + (p.mu_static - p.mu_dynamic) * math.exp(-w / c) * i0(a / c)
    assert mean_friction(law, w, 1.0, complex(a))[0] == pytest.approx(mean, rel=1e-9)


def prompt(scene, name, period=1_000):
    """The scene with a loop that samples every microsecond without delay."""
    section = scene.controllers[name].model_copy(update={"period": period, "delay": 0})
    sensors = {key: sensor.model_copy(update={"rate": 1e9 / period}) for key, sensor in scene.sensors.items()}
    clock = scene.clock.model_copy(update={"frame": period})
    return replace(scene, clock=clock, sensors=sensors, controllers={**scene.controllers, name: section})


@pytest.mark.parametrize("gain", [50.0, 200.0])
def test_damping_of_normal_force_feedback(gain):
    """eq-normal-force-damping: without delay and lag, growth is -d_eff / 2 m."""
    scene = rig.load("belt_normal_force", {"controllers.nf.gain": gain})
    p = scene.parameters
    law = p.friction.friction()
    v = p.drive.speed
    damping = p.body.damping + p.load.force * law.slope(v) + law.mu(v) * gain
    found = loop(prompt(scene, "nf"), "nf").growth
    assert found == pytest.approx(-damping / (2.0 * p.body.mass), rel=0.02)


@pytest.mark.parametrize("step", [1e-4, 1e-3])
@pytest.mark.parametrize("name", ["belt_c", "two_dof", "pin", "belt_shunt"])
def test_no_guard_leaves_the_bound_of_its_chord(name, step):
    """eq-certificate, for random states: the largest distance of g from its chord is below sum B_j |x_j|."""
    system = rig.load(name).assemble().system()
    A = steady(system, sliding_key(system)).modes.A
    draw = np.random.default_rng(3)
    guards = draw.standard_normal((4, len(A)))
    bounds, _ = guard_bounds(A, guards, step)
    places = np.linspace(0.0, 1.0, 17)
    motions = [expm(A * step * place) for place in places]
    closest = 0.0
    for x in draw.standard_normal((10, len(A))):
        g = np.array([guards @ motion @ x for motion in motions])
        chord = g[0] + places[:, None] * (g[-1] - g[0])
        away, bound = np.abs(g - chord).max(axis=0), bounds @ np.abs(x)
        assert np.all(away <= bound)
        closest = max(closest, float((away / bound).max()))
    assert closest > 0.02  # the bound is no empty promise


@pytest.mark.parametrize("name", ["brake", "four_dof"])
def test_no_guard_leaves_the_bound_of_its_quick_polynomial(name):
    """The same where there are many states, whose ticks are certified by polynomials of low degree."""
    scene = rig.load(name)
    system = scene.assemble().system()
    mode_sets = ModeSets(system, scene.step_ns * 1e-9, [])
    A, t = mode_sets.add(sliding_key(system)).A, mode_sets.tables
    wide, n, count = t.many_states, system.n, int(t.guards[0])
    assert t.depth[0] == 0
    tick, margin = (np.concatenate(list(table[0]), axis=1).T for table in (wide.tick, wide.margin))
    quick = tick[n : n + count * (QUICK + 1)].reshape(count, QUICK + 1, n)
    d = balance(A)
    closest, places = 0.0, np.linspace(0.0, 1.0, 17)
    for x in np.random.default_rng(3).standard_normal((5, n)) / d:
        motion = [expm(A * d[:, None] / d * scene.step_ns * 1e-9 * place) @ (d * x) / d for place in places]
        along = BPoly(np.array([quick @ x]).transpose(2, 0, 1), [0.0, 1.0])(places)
        away = np.abs(along - np.array(motion) @ t.G[0, :count].T).max(axis=0)
        bound = (margin @ np.abs(x))[:count]
        assert np.all(away <= bound + 1e-12 * np.abs(along).max(axis=0))
        closest = max(closest, float((away / bound).max()))
    assert closest > 0.02


def test_the_unstable_cycle_between_two_states_has_the_amplitude_of_the_lesson():
    """Damper and falling friction take and give the same: d a^2 / 2 = N 0.32 exp(-V / c) a I1(a / c)."""
    p = rig.load("belt").parameters
    drop, c = p.friction.mu_static - p.friction.mu_dynamic, p.friction.speed_scale

    def balance(a):
        return 0.5 * p.body.damping * a - p.load.force * drop * math.exp(-0.4 / c) * i1(a / c)

    assert brentq(balance, 0.1, 0.4) == pytest.approx(0.353, abs=5e-4)
