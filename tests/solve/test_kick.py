"""Kicks by contacts that open and close: problem P5 with its own numbers, order, energy, and what it refuses.

The reference is scipy's DOP853 on the plate's equations, written here once more and without the solver's matrices.
"""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import rig
from rig.model import friction_law, kick_tables
from rig.model.assembly import Assembly
from rig.model.method import chosen
from rig.motion.motion import Motion
from rig.plants.points import HALF_WAVES

PROBLEMS = Path(__file__).parents[1] / "problems"
TIME = 0.002  # s: the first tenth of the problem, some 160 lift-offs of 24 points


@pytest.fixture(scope="module")
def p5(num):
    """Problem P5: its numbers are those of the reference, the places of the points are ours."""
    p, scene = num["P5"]["params"], rig.load(PROBLEMS / "p5.toml")
    plate, contact = scene.parameters.plate, scene.parameters.contact
    count = contact.along * contact.across
    assert (p["modes"], p["contacts"], p["kc"]) == (len(HALF_WAVES), count, contact.stiffness)
    assert (p["mu"], p["lever"], p["zeta"]) == (scene.parameters.friction.mu, contact.lever, plate.damping_ratio)
    assert (p["N0"], p["plate"]) == (scene.parameters.load.force / count, [plate.length, plate.width, plate.mass])
    assert [list(pair) for pair in HALF_WAVES] == p["pairs"]
    assert np.linspace(plate.lowest, plate.highest, len(HALF_WAVES)) == pytest.approx(p["f_Hz"])
    return scene.assemble().system()


@pytest.fixture(scope="module")
def witness(num):
    """The end of the first tenth by DOP853."""
    p = num["P5"]["params"]
    w, zeta = 2.0 * np.pi * np.array(p["f_Hz"]), p["zeta"]
    length, _, mass = p["plate"]
    x, y = np.meshgrid((np.arange(6) + 0.5) / 6.0, (np.arange(4) + 0.5) / 4.0, indexing="ij")
    size = 2.0 / math.sqrt(mass)
    shape = np.array([size * np.sin(m * np.pi * x) * np.sin(n * np.pi * y) for m, n in p["pairs"]]).reshape(10, -1)
    turn = np.array(
        [size * m * np.pi / length * np.cos(m * np.pi * x) * np.sin(n * np.pi * y) for m, n in p["pairs"]]
    ).reshape(10, -1)
    push = shape + p["mu"] * p["lever"] * turn

    def rate(_, s):
        q, v = s[:10], s[10:]
        force = np.maximum(p["N0"] - p["kc"] * (shape.T @ q), 0.0)
        return np.concatenate([v, push @ force - 2.0 * zeta * w * v - w * w * q])

    start = np.zeros(20)
    start[10:15] = rig.load(PROBLEMS / "p5.toml").parameters.start.velocities
    return solve_ivp(rate, (0.0, TIME), start, method="DOP853", rtol=1e-10, atol=1e-16, max_step=1e-6).y[:10, -1]


def end(system, step_ns, time=TIME, method="kick", **how):
    ticks = round(time * 1e9 / step_ns)
    motion = Motion(system, step_ns, method, longest=ticks, **how)
    motion.advance(ticks)
    return motion


def test_it_is_the_default_where_mode_sets_cannot_be_numbered(p5):
    assert p5.keys > 5e7
    assert chosen("auto", p5) == "kick"
    with pytest.raises(ValueError, match=r"the rig has 5.03e\+07 mode sets, method .* use kick"):
        Motion(p5, 1000, "exact")


def test_second_order_and_beyond_a_thousandth(p5, witness):
    steps = [4000, 2000, 1000, 500]
    errors = [np.abs(end(p5, step).x[:10] - witness).max() / np.abs(witness).max() for step in steps]
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.35)
    assert errors[-1] < 1e-4


def test_other_methods_take_contacts_as_no_events_either(p5, witness):
    """Each for itself: rk4 at a twentieth of a microsecond, dopri5 by its tolerance."""
    size = np.abs(witness).max()
    assert np.abs(end(p5, 1000, method="rk4", substeps=20).x[:10] - witness).max() < 1e-6 * size
    assert np.abs(end(p5, 1000, method="dopri5", tolerance=1e-9).x[:10] - witness).max() < 1e-6 * size


def test_substeps_are_steps(p5):
    fine = end(p5, 1000)
    within = end(p5, 8000, substeps=8)
    assert within.x == pytest.approx(fine.x, rel=1e-12, abs=1e-18)


def test_ledger_closes(p5):
    energy = end(p5, 1000).energy()
    assert abs(energy["error"]) < 1e-12
    assert energy["friction"] > 0.0


def test_energy_of_a_contact_that_opens_and_closes_stays():
    """A mass that bounces on a spring for ever: held forces would feed it."""
    a = Assembly("bouncing")
    a.coordinate("z", 1.0, 0.0, 100.0)
    a.push("z", {"one": -5.0})
    a.patch("contact", {}, {"one": 1.0}, friction_law.coulomb(0.0, 0.0), {})
    a.normal("load", "contact", {"z": -1e4}, {"z": 1.0})
    a.start["z"] = 0.05
    for idle in range(4):  # so many states that the kernel is that of the plate
        a.coordinate(f"idle{idle}", 1.0, 0.0, 1.0)
    ticks = 50_000
    motion = Motion(a.system(), 1_000_000, "kick", outputs=[{"N:load": 1.0}], longest=ticks)
    motion.advance(ticks)
    z, v = motion.states[:, 0], motion.states[:, 5]
    total = 0.5 * v * v + 50.0 * z * z + 5.0 * z + 5e3 * np.minimum(z, 0.0) ** 2
    first, last = total[: ticks // 10], total[-ticks // 10 :]
    assert np.abs(total / 0.375 - 1.0).max() < 0.02
    assert last.mean() == pytest.approx(first.mean(), rel=1e-3)
    load = motion.outputs_at(motion.states, motion.mode_sets_of_states)[:, 0]
    assert load.min() == 0.0
    assert load == pytest.approx(np.maximum(-1e4 * z, 0.0), abs=1e-9)


def test_what_it_refuses(rigs):
    assert kick_tables.refusal(rigs.p3()) == ""
    with pytest.raises(ValueError, match="kick: no contact of this rig opens"):
        Motion(rigs.p1(), 1_000_000, "kick")
    a = Assembly("damped contact")
    a.coordinate("z", 1.0)
    a.patch("contact", {}, {"one": 1.0}, friction_law.coulomb(0.1, 0.1), {})
    a.normal("load", "contact", {"z": -1e4, "z'": -1.0}, {"z": 1.0})
    assert "depends on more than positions" in kick_tables.refusal(a.system())


def test_the_residual_is_what_the_springs_hold_beyond_the_work_of_the_kicks(p5):
    """The same splitting written out with the plate's matrices: force times mean velocity of each kick, by points."""
    step, nq = 4e-6, 10
    points = [k for k in p5.normals if k.opens]
    rows, push = np.array([k.row for k in points]), np.array([k.direction for k in points])
    give = -np.sum(rows[:, :nq] * push, axis=1) / np.sum(rows[:, :nq] ** 2, axis=1)
    A = np.block([[np.zeros((nq, nq)), np.eye(nq)], [-p5.stiffness, -p5.damping]])  # modes of mass one
    flow, x, load = expm(A * step), p5.start[: 2 * nq].copy(), rows[:, 2 * nq :] @ p5.start[2 * nq :]

    def press(x):
        return np.maximum(rows[:, :nq] @ x[:nq] + load, 0.0)

    first, work = 0.5 * give @ press(x) ** 2, 0.0
    for _ in range(round(TIME / step)):
        for last in (False, True):
            force = press(x)
            pull = push.T @ force
            work += 0.5 * step * (give * force) @ rows[:, :nq] @ (x[nq:] + 0.25 * step * pull)
            x[nq:] += 0.5 * step * pull
            x = x if last else flow @ x
    off = 0.5 * give @ press(x) ** 2 - first - work
    found = end(p5, 4000).residual()
    assert found["energy"] == pytest.approx(off, rel=1e-4)
    assert 1e-5 < found["share"] < 1e-2


def test_the_residual_falls_with_the_square_of_the_step_and_other_methods_have_none(p5):
    sizes = [end(p5, step).residual()["share"] for step in (4000, 1000)]
    assert sizes[1] < 0.25 * sizes[0]
    assert end(p5, 4000, method="dopri5", tolerance=1e-4).residual() is None
