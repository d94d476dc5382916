"""The energy ledger closes, and each of its terms is what an independent quadrature of the run says."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rig.model import friction_law
from rig.model.assembly import Assembly

SMOOTH, WITH_EVENTS = 1e-9, 1e-6


@pytest.mark.parametrize("step", [0.1, 20.0])
@pytest.mark.parametrize("name", ["p1", "p3", "p4", "hc1"])
def test_ledger_closes_over_events(rigs, run, name, step):
    found = run(getattr(rigs, name)(), step, 4.0)
    assert len(found.times) > 20
    assert abs(found.energy["error"]) < 1e-10


@pytest.mark.parametrize(
    ("method", "tolerance", "bound"),
    [
        ("dopri5", 1e-7, WITH_EVENTS),
        ("dopri5", 1e-10, 1e-9),
        ("dop853", 1e-10, 1e-9),
        ("rosenbrock", 1e-7, WITH_EVENTS),
        ("rosenbrock", 1e-10, 1e-9),
        ("rk4", 1e-7, WITH_EVENTS),
    ],
)
def test_ledger_of_a_falling_law_closes_over_events(rigs, run, method, tolerance, bound):
    assert abs(run(rigs.p2(), 1.0, 4.0, method, tolerance=tolerance).energy["error"]) < bound


def test_ledger_closes_in_smooth_motion(rigs, run):
    falling = rigs.oscillator(law=friction_law.stribeck(0.4, 0.25, 0.02), start={"x": 0.003}, vb=0.2, c=1.0).system()
    for method in ("dopri5", "dop853", "rosenbrock", "rk4"):
        found = run(falling, 0.2, 2.0, method, tolerance=1e-10)
        assert len(found.times) == 0
        assert abs(found.energy["error"]) < SMOOTH
    constant = rigs.p1(vb=0.5)
    found = run(constant, 1.0, 4.0)
    assert abs(found.energy["error"]) < SMOOTH


def test_terms_of_a_stick_slip_run(rigs, run, num):
    """Of the mean friction force from momentum, of the damper from v^2; the heat is what is left of the belt's work."""
    p = num["P1"]["params"]
    found = run(rigs.p1(), 0.02, 4.0)
    x, v = np.vstack([[0.0, p["vb"], 1.0], found.states])[:, :2].T
    h = 2e-5
    impulse = p["m"] * (v[-1] - v[0]) + p["c"] * (x[-1] - x[0]) + p["k"] * np.trapezoid(x, dx=h)
    damper = p["c"] * np.trapezoid(v * v, dx=h)
    stored = 0.5 * (p["m"] * (v[-1] ** 2 - v[0] ** 2) + p["k"] * (x[-1] ** 2 - x[0] ** 2))
    drive = p["vb"] * impulse
    assert found.energy["drive"] == pytest.approx(drive, rel=1e-7)
    assert found.energy["damper"] == pytest.approx(damper, rel=1e-6)
    assert found.energy["stored"] == pytest.approx(stored, rel=1e-9)
    assert found.energy["friction"] == pytest.approx(drive - stored - damper, rel=1e-6)


def test_terms_of_a_run_with_separation(rigs, run, num):
    p = num["P3"]["params"]
    rows = [{"N:load": 1.0}, {"T:contact": 1.0}, {"w:contact": 1.0}]
    found = run(rigs.p3(), 0.005, 1.0, outputs=rows)
    z, vx, vz = np.vstack([[6e-5, 0.0, 0.0, 0.0, 1.0], found.states]).T[1:4]
    load = np.concatenate([[p["F0"]], found.outputs[:, 0]])
    h = 5e-6
    assert found.energy["normal"] == pytest.approx(-np.trapezoid(load * vz, dx=h), rel=1e-5)
    assert found.energy["forces"] == pytest.approx(p["F0"] * (z[-1] - z[0]), rel=1e-9)
    damper = np.trapezoid(p["cx"] * vx**2 + p["cz"] * vz**2, dx=h)
    assert found.energy["damper"] == pytest.approx(damper, rel=1e-5)
    assert found.energy["friction"] == pytest.approx(
        np.trapezoid(found.outputs[:, 1] * found.outputs[:, 2], dx=h), rel=1e-4
    )


def test_work_done_on_a_shunt_is_stored_there_or_heats_its_resistor(rigs, run, num):
    p = num["P4"]["params"]
    found = run(rigs.p4(), 0.005, 1.0)
    U, i = np.vstack([[0.0, 0.0], found.states[:, 2:4]]).T
    C = p["Cp"] / (1.0 + p["delta"])
    stored = 0.5 * (p["L"] * i[-1] ** 2 + C * U[-1] ** 2)
    heat = p["R"] * np.trapezoid(i * i, dx=5e-6)
    assert -found.energy["forces"] == pytest.approx(stored + heat, rel=1e-4)


def test_a_blow_is_booked(rigs, run):
    motion = run(rigs.p1(), 1.0, 0.5).motion
    before = motion.energy()["stored"]
    v = motion.x[1]
    motion.write(1, v + 0.3)
    jump = 0.5 * ((v + 0.3) ** 2 - v**2)
    assert motion.energy()["impulses"] == pytest.approx(jump, rel=1e-12)
    assert motion.energy()["stored"] == pytest.approx(before + jump, rel=1e-12)
    motion.advance(500)
    assert abs(motion.energy()["error"]) < 1e-10


def test_a_jump_of_the_belt_moves_no_energy(rigs, run):
    """A stuck mass whose belt jumps slips; nothing is carried along by itself (NUM, case HC13)."""
    a = rigs.oscillator(belt={"belt": 1.0})
    a.signal("slope", {}, 0.0, "test")
    a.signal("belt", {"slope": 1.0}, 0.05, "test")
    motion = run(a.system(), 1.0, 0.05).motion
    assert motion.system.describe(motion.key) == "contact stick"
    stored = motion.energy()["stored"]
    motion.write(motion.system.names.index("belt"), 0.08)
    assert motion.x[1] == pytest.approx(0.05, abs=1e-15)
    motion.advance(1)
    assert motion.event_count == 0
    assert motion.system.describe(motion.key) == "contact slip+"
    assert motion.energy()["stored"] == pytest.approx(stored, rel=0.2)
    motion.advance(2000)
    assert motion.energy()["impulses"] == 0.0
    assert abs(motion.energy()["error"]) < 1e-10


def micro(limit):
    """Floats of a sensible size: whole millionths."""
    return st.integers(-round(limit * 1e6), round(limit * 1e6)).map(lambda i: i * 1e-6)


@given(
    mu=st.floats(0.05, 0.8),
    extra=st.floats(0.0, 0.5),
    belt=micro(0.3),
    damping=st.floats(0.0, 20.0),
    x=micro(0.02),
    v=micro(1.0),
)
@settings(max_examples=60)
def test_friction_only_ever_heats(run, mu, extra, belt, damping, x, v):
    """T w >= 0 at every tick, |T| within the cone, and the ledger's heat never falls."""
    a = Assembly("one mass")
    a.coordinate("x", 1.0, damping, 1000.0)
    a.patch("contact", {"x": 1.0}, {"one": belt}, friction_law.coulomb(mu + extra, mu))
    a.normal("load", "contact", {"one": 10.0})
    a.start |= {"x": x, "x'": v}
    found = run(a.system(), 1.0, 0.5, outputs=[{"T:contact": 1.0}, {"w:contact": 1.0}], longest=500)
    T, w = found.outputs.T
    assert np.all(T * w >= -1e-15)
    assert np.all(np.abs(T) <= 10.0 * (mu + extra) * (1.0 + 1e-12))
    assert np.all(np.abs(T[np.abs(w) > 1e-12]) == pytest.approx(10.0 * mu, rel=1e-12))
    assert found.energy["friction"] >= -1e-15
    assert abs(found.energy["error"]) < 1e-9
