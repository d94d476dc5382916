"""The disc brake: matrices, eigenvalues, critical friction over pressure, the squeal that lift-off bounds.

Numbers: tests/reference/brake.json, by independent code (sets BRAKE and BRAKE-P); eigenvalues to 1e-3 1/s, in Hz.
"""

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from reference import numbers
from scipy.optimize import brentq

import rig
from rig.model.formulation import assemble
from rig.motion.motion import Motion
from rig.solve.records import OPEN, STICK
from rig.stability.linearisation import sliding_key, steady

BRAKE = numbers("brake")


def system(changes=None, scene="brake"):
    return rig.load(scene, changes or {}).assemble().system()


def stiffness(mu, scene="brake"):
    """K with the friction of sliding contacts in it, as the eigenvalues see it."""
    rig_ = system({"friction.mu": mu}, scene)
    modes = assemble(rig_, sliding_key(rig_))
    n = len(rig_.coordinates)
    return -rig_.mass @ modes.A[n : 2 * n, :n]


def rates(mu, scene="brake"):
    found = rig.modes(rig.load(scene, {"friction.mu": mu})).sliding
    return np.array(sorted(([m.growth, m.frequency] for m in found.modes), key=lambda m: m[1]))


def growth(changes):
    return rig.modes(rig.load("brake", changes)).sliding.growth


@pytest.mark.parametrize("mu", [float(mu) for mu in BRAKE["eig_vs_mu"]])
def test_eigenvalues_are_those_of_the_reference(mu):
    expected = np.array(sorted(BRAKE["eig_vs_mu"][f"{mu:g}" if mu != 1.0 else "1.0"], key=lambda m: m[1]))
    assert rates(mu) == pytest.approx(expected, abs=1e-3 / (2.0 * math.pi))


def test_frequencies_without_friction():
    assert rates(0.0)[:, 1] == pytest.approx(np.array(BRAKE["f_mu0_Hz"]), rel=1e-9)


def test_stiffness_is_that_of_the_reference_and_its_skew_part_is_the_frictions():
    K = stiffness(0.64)
    assert np.diag(K) == pytest.approx(np.array(BRAKE["K_mu0_64_diag"]), rel=1e-10)
    assert np.abs(K - K.T).max() == pytest.approx(BRAKE["max_skew_mu0_64"], rel=1e-10)
    for mu in (0.2, 1.0):
        other = stiffness(mu)
        assert (other - other.T) / mu == pytest.approx((K - K.T) / 0.64, abs=1e-9 * np.abs(K).max())
    plain = stiffness(0.0)
    assert plain == pytest.approx(plain.T, abs=1e-12 * np.abs(plain).max())


def test_critical_friction():
    """0.64 and 2140 Hz, as published."""
    found = brentq(lambda mu: growth({"friction.mu": mu}), 0.62, 0.66, xtol=1e-12)
    assert found == pytest.approx(BRAKE["mu_crit"], abs=1e-6)
    flutter = rig.modes(rig.load("brake", {"friction.mu": found})).sliding.modes[0]
    assert flutter.frequency == pytest.approx(BRAKE["f_crit_Hz"], abs=1e-3)


@pytest.mark.parametrize("bar", [p for p, found in BRAKE["mu_crit_vs_p_bar"].items() if found])
def test_critical_friction_falls_with_the_pressure(bar):
    mu, hertz = BRAKE["mu_crit_vs_p_bar"][bar]
    below, above = (growth({"load.pressure": f"{bar} bar", "friction.mu": mu + d}) for d in (-1e-6, 1e-6))
    assert below < 0.0 < above
    flutter = rig.modes(rig.load("brake", {"load.pressure": f"{bar} bar", "friction.mu": mu})).sliding.modes[0]
    assert flutter.frequency == pytest.approx(hertz, abs=1e-3)


def test_sliding_is_where_the_scene_says():
    found = rig.modes(rig.load("brake")).sliding.equilibrium
    assert [found[f"normal_force_{name}"] for name in ("inner_left", "inner_right")] == pytest.approx([1000.0, 1000.0])
    assert found["displacement"] == pytest.approx(0.0, abs=1e-15)
    at_rest = rig.modes(rig.load("brake", {"load.at": "rest"})).sliding.equilibrium
    assert at_rest["normal_force_inner_left"] != pytest.approx(at_rest["normal_force_inner_right"], rel=0.05)
    pressed = rig.modes(rig.load("brake", {"load.pressure": "5 bar"})).sliding.equilibrium
    assert pressed["normal_force"] == pytest.approx(2000.0 / 3.0)


def open_stack(scene="brake_3400", changes=None):
    """The rig with the stack of BRAKE-P open, whose charge then only stiffens it: kappa between pad and calliper."""
    found = system(changes, scene)
    row = np.zeros(len(found.coordinates))
    offset = BRAKE["BRAKE-P"]["piezo_offset_x"]
    for body, sign in (("inner_pad", 1.0), ("calliper", -1.0)):
        row[found.coordinates.index(f"{body}.z")] = sign
        row[found.coordinates.index(f"{body}.phi")] = -sign * offset
    return replace(found, stiffness=found.stiffness + BRAKE["BRAKE-P"]["kappa"] * np.outer(row, row))


def motion(brake, step=20e-6, duration=0.0, **how):
    row = rig.load("brake").assemble().outputs["velocity"].row
    ticks = round(duration / step)
    found = Motion(brake, round(step * 1e9), "exact", outputs=[row], longest=max(ticks, 1), cap=1000, **how)
    if ticks:
        found.advance(ticks)
    return found


def velocity(run):
    return run.outputs_at(run.states, run.mode_sets_of_states)[:, 0]


def test_growth_of_the_open_stack_is_that_of_the_reference():
    found = steady(open_stack(), sliding_key(open_stack())).eigenvalues()[0]
    assert [found.real, found.imag] == pytest.approx(BRAKE["BRAKE-P"]["open"], abs=1e-3)


def test_squeal_is_bounded_by_lift_off():
    """Amplitude and frequency of the open limit cycle: 0.17768 m/s, 3399.8 Hz; one contact opens once in a period."""
    run = motion(open_stack(), duration=0.4)
    assert run.energy()["error"] == pytest.approx(0.0, abs=1e-9)
    run.advance(5000)
    v, period = velocity(run), 1.0 / BRAKE["BRAKE-P"]["f_open_LC_Hz"]
    assert np.abs(v).max() == pytest.approx(BRAKE["BRAKE-P"]["v_pad_x_open_LC"], rel=2e-4)
    up = np.flatnonzero((v[:-1] < 0.0) & (v[1:] >= 0.0))
    crossings = up - v[up] / (v[up + 1] - v[up])
    assert np.ptp(crossings) * 20e-6 / (len(up) - 1) == pytest.approx(period, rel=1e-4)
    what = Counter(event.what for event in run.events())
    assert set(what) == {"inner_left opens", "inner_left closes"}
    assert what["inner_left opens"] == pytest.approx(0.1 / period, abs=1.5)
    assert run.energy()["error"] == pytest.approx(0.0, abs=1e-9)


def test_events_do_not_depend_on_the_step():
    times = []
    for step in (2.5e-6, 10e-6, 20e-6, 50e-6):
        run = motion(open_stack(changes={"start.velocity": 2.0}), step, 2e-3)
        times.append([(e.tick + e.place) * step for e in run.events()])
    assert len(times[0]) > 20
    for other in times[1:]:
        assert other == pytest.approx(times[0], abs=1e-14)


def test_a_marginal_mode_neither_grows_nor_decays():
    """No false damping: at the critical friction the flutter keeps its amplitude to 1e-3 1/s."""
    run = motion(system({"friction.mu": BRAKE["mu_crit"]}), duration=1.0)
    at = steady(run.system, sliding_key(run.system))
    values, shapes = np.linalg.eig(at.modes.A)
    left = np.linalg.inv(shapes)[np.argmin(np.abs(values - 2j * math.pi * BRAKE["f_crit_Hz"]))]
    sizes = np.abs((run.states - at.x) @ left)
    assert math.log(sizes[-1] / sizes[0]) / (len(sizes) - 1) / 20e-6 == pytest.approx(0.0, abs=1e-3)


def test_pads_that_creep_stick():
    """The disc at 2 rpm, the pads faster than it: both stick in turn, and contacts open while they do."""
    run = motion(system({"drive.speed": "2 rpm", "start.velocity": 1.0}, "brake_3400"), duration=0.02)
    modes = [run.system.modes(s.key) for s in run.mode_sets.sets]
    assert any(STICK in patches for patches, *_ in modes)
    assert any(STICK in patches and OPEN in normals for patches, normals, *_ in modes)
    slip = run.states @ run.system.slip_rows.T
    stuck = np.array([[m == STICK for m in run.system.modes(s.key)[0]] for s in run.mode_sets.sets])[
        run.mode_sets_of_states
    ]
    assert np.abs(slip[stuck]).max() < 1e-14
    assert abs(run.energy()["error"]) < 1e-6


@pytest.mark.parametrize(("speed", "events"), [(0.0, 18), (0.001, 217)])
def test_pads_on_a_disc_at_rest_or_nearly_so_come_to_stick(speed, events):
    """Released with an acceleration of 1e-12 m/s^2 that is rounding of 1320 N, a pad is not caught again at once."""
    run = motion(system({"drive.speed": speed}), duration=0.1)
    patches, *_ = run.system.modes(run.key)
    assert patches == [STICK, STICK]
    assert run.counts()["events"] == events
    assert np.abs(run.system.slip_rows @ run.x).max() < 1e-15
    assert abs(run.energy()["error"]) < 1e-6


def test_the_verdict_tells_growth_and_what_bounds_it():
    """A squealing brake is refused by nobody: lift-off bounds it. The growth is that of the eigenvalues."""
    what = "flutter in inner_pad slip+, outer_pad slip+,"
    [found] = [one for one in rig.modes(rig.load("brake_3400")).findings if what in one.what]
    assert found.level == "info"
    assert found.number == pytest.approx(BRAKE["BRAKE-P"]["short"][0], abs=1e-3)
    assert found.what.endswith("it grows until inner_left opens")
    assert "friction" in found.remedy


def test_the_brake_is_preloaded_in_steady_sliding_under_a_law_that_its_load_warms():
    """Where the preload is that of sliding, steady sliding is the undeformed rig."""
    warm = {"friction.law": "contact_temperature", "friction.mu": "none", "friction.mu_cold": 0.3}
    warm |= {"friction.mu_hot": 0.15, "friction.temperature_scale": "20 K", "friction.capacity": "5 J/K"}
    scene = rig.load("brake", warm | {"friction.cooling": "5 W/K", "load.at": "sliding"})
    system = scene.assemble().system()
    at = steady(system, sliding_key(system))
    nq = len(system.coordinates)
    cold = rig.load("brake", {"load.at": "rest"}).assemble().system()
    away = np.abs(steady(cold, sliding_key(cold)).x[:nq]).max()
    assert at.x[2 * nq] > 20.0
    assert np.abs(at.x[:nq]).max() < 1e-9 * away
