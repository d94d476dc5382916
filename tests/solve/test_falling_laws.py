"""dopri5 with several contacts under laws that fall with speed, normal forces that move and open, and drives."""

import math

import numpy as np
import pytest

from rig.model import friction_law
from rig.model.assembly import Assembly
from rig.motion.motion import Motion
from rig.scenes import load
from rig.stability.linearisation import sliding_key, steady


def pair(opens=False, inertia=0.0):
    """Two masses on two belts, coupled; the second contact's normal force moves with the first mass, and may open."""
    a = Assembly("pair")
    a.coordinate("x", 1.0, 0.5, 900.0)
    a.coordinate("y", 1.4, 0.7, 1500.0)
    a.stiffness["x", "y"] = a.stiffness["y", "x"] = -250.0
    a.patch("first", {"x": 1.0}, {"one": 0.06}, friction_law.stribeck(0.5, 0.2, 0.03))
    a.patch("second", {"y": 1.0}, {"one": -0.04}, friction_law.falling(0.4, 1.5, 0.1))
    a.normal("load 1", "first", {"one": 8.0})
    a.normal(
        "load 2", "second", {"one": 5.0, "x": 1600.0 if opens else 300.0}, inertia={"x": inertia} if inertia else {}
    )
    a.start |= {"x": 0.001, "y": -0.002}
    return a.system()


@pytest.mark.parametrize("system", [pair(), pair(opens=True), pair(inertia=0.2)], ids=["moves", "opens", "inertia"])
def test_dopri5_and_rk4_agree_on_two_falling_contacts(run, system):
    exact = run(system, 0.02, 1.0, "rk4")
    found = run(system, 1.0, 1.0, "dopri5", tolerance=1e-10)
    assert len(found.times) > 10
    assert found.what == exact.what
    assert found.times == pytest.approx(exact.times, abs=2e-9)
    assert abs(found.energy["error"]) < 1e-8
    assert abs(exact.energy["error"]) < 1e-8


@pytest.mark.parametrize("tolerance", [1e-4, 1e-7, 1e-10])
def test_a_release_is_not_undone_at_its_own_instant(tolerance):
    """It is a zero of the force itself that sticking needs, not of a polynomial near it: slip would begin too early."""
    motion = Motion(pair(inertia=0.2), 1_000_000, "dopri5", tolerance=tolerance, with_energy=False, longest=1000)
    motion.advance(1000)
    times = np.array([event.tick + event.place for event in motion.events()])
    assert len(times) == 12
    assert np.diff(times).min() > 0.1


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-8])
def test_mode_changes_are_the_same_at_every_tolerance_where_a_load_winds_along_a_stick(rigs, run, tolerance):
    """Stuck, the mass moves straight on and no error of a step is to be seen: the load winds within it all the same."""
    a = rigs.oscillator(law=friction_law.stribeck(0.42, 0.3, 0.0045), load={"one": 20.0, "wave": 4.0})
    a.product("wave", ("cos-1", {"x": 2000.0}))
    found, exact = run(a.system(), 0.1, 2.0, "dopri5", tolerance=tolerance), run(a.system(), 0.02, 2.0, "rk4")
    assert len(exact.what) == 18
    assert found.what == exact.what
    assert found.times[0] == pytest.approx(exact.times[0], abs=1e-10)  # where the stick of the start ends


def test_a_step_too_long_to_tell_whether_slip_goes_on_does_not_end_it_at_its_begin(rigs, run):
    """Just let go, a contact moves off as the square of the time: beside it the error that 1e-2 leaves is large."""
    law = friction_law.seal(0.97, 620.0, 3.4785, 1e-5)
    lip = rigs.oscillator(belt={"one": 0.003}, load={"one": 10.0}, law=law, start={"x'": 0.003}, m=0.2, k=2e4, c=3.17)
    found = run(lip.system(), 0.1, 2.0, "dopri5", tolerance=1e-2)
    assert "contact releases +" in found.what
    assert np.diff(found.times).min() > 1e-6


@pytest.mark.parametrize(("tolerance", "off"), [(1e-4, 0.0), (1e-7, 1e-12), (1e-11, 1e-15), (1e-11, 1e-10)])
@pytest.mark.parametrize("scene", ["pair", "lever", "disc_slider", "brake"])
def test_a_motion_that_begins_at_rest_takes_the_steps_of_a_smooth_one(scene, tolerance, off):
    """At rest speeds are rounding of the forces that balance: errors relative to them would need steps of any size."""
    if scene == "pair":
        system, method = pair(), "dopri5"
    else:
        scene = load(scene, {"drive.speed": "7 rpm"} if scene == "lever" else {})
        system, method = scene.assemble().sliding(), "smooth" if scene.name == "brake" else "dopri5"
    rest = steady(system, sliding_key(system))
    assert rest.exists
    speeds = slice(len(system.coordinates), 2 * len(system.coordinates))
    begin = rest.x.copy()
    begin[speeds] += off * np.abs(rest.speed).max() * np.cos(np.arange(len(system.coordinates)))
    fastest = np.abs(rest.eigenvalues()).max()
    motion = Motion(system, round(1e8 / fastest), method, tolerance=tolerance, longest=400)
    motion.restart(begin)
    motion.advance(400)
    assert not motion.events()
    assert motion.counts()["trial_steps"] < 1600  # four for each tenth of a radian of the fastest vibration
    assert np.abs((motion.x - begin)[speeds]).max() < (1e-10 + 1e3 * off) * np.abs(rest.speed).max()
    assert abs(motion.energy()["error"]) < 1e-6


def test_a_falling_law_without_its_fall_is_coulomb_friction(rigs, run, num):
    """The path for laws over speed, on a law that is constant: the events of P1 with one coefficient."""
    flat = rigs.oscillator(law=friction_law.falling(0.3, 0.0, 0.3)).system()
    plain = rigs.p1(mus=0.3, mud=0.3)
    found, exact = run(flat, 1.0, 4.0, "dopri5", tolerance=1e-11), run(plain, 1.0, 4.0)
    assert found.states == pytest.approx(exact.states, abs=1e-9)


def test_exact_refuses_a_law_over_speed(rigs, run):
    with pytest.raises(ValueError, match="not linear: contact; use auto"):
        run(rigs.p2(), 1.0, 0.1, "exact")
    with pytest.raises(ValueError, match=r"euler.*known: exact, dopri5, dop853, rosenbrock"):
        run(rigs.p1(), 1.0, 0.1, "euler")


def test_friction_follows_the_load_that_depends_on_it(run):
    """N = N0 + g a and T = sigma mu(v) N solved together: T and N of the record satisfy both, to rounding."""
    rows = [{"T:second": 1.0}, {"N:load 2": 1.0}, {"w:second": 1.0}, {"x": 1.0}, {"x''": 1.0}]
    found = run(pair(inertia=0.2), 0.1, 0.5, "dopri5", outputs=rows)
    T, N, w, x, acceleration = found.outputs.T
    assert N == pytest.approx(5.0 + 300.0 * x + 0.2 * acceleration, abs=1e-9)
    slips = np.abs(w) > 1e-6
    mu = np.maximum(0.4 - 1.5 * np.abs(w[slips]), 0.1)
    assert T[slips] == pytest.approx(mu * N[slips] * np.sign(w[slips]), abs=1e-9)


@pytest.mark.parametrize("method", ["dopri5", "rk4"])
def test_a_contact_under_load_dither_opens_where_the_load_is_zero(rigs, run, method):
    """N = N0 + A sin(w t), A > N0: it opens and closes at arcsines, whatever the mass does."""
    omega, load, amplitude = 2.0 * math.pi * 50.0, 4.0, 6.0
    a = rigs.oscillator(load={"one": load, "shake": amplitude}, law=friction_law.stribeck(0.4, 0.25, 0.02))
    rigs.sine(a, "shake", 1.0, omega)
    system = a.system()
    found = run(system, 0.1, 0.5, method, outputs=[{"N:load": 1.0}, {"T:contact": 1.0}])
    down = math.pi + math.asin(load / amplitude)
    n = np.arange(25)
    opens = np.array([t for t, what in zip(found.times, found.what) if what == "load opens"])
    closes = np.array([t for t, what in zip(found.times, found.what) if what == "load closes"])
    assert opens == pytest.approx((down + 2.0 * math.pi * n) / omega, abs=1e-8)
    assert closes == pytest.approx((3.0 * math.pi - down + 2.0 * math.pi * n) / omega, abs=1e-8)
    N, T = found.outputs.T
    assert N.min() == 0.0
    assert np.all(T[N == 0.0] == 0.0)
