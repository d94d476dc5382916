"""The plate under a slider on a film of points: an independent integrator, statics, energy, what points may never do.

The integrator below is written from the equations of the paper's section 3.2 alone: explicit small steps in numpy.
Reference of statics and onset: tests/reference/plate.json.
"""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plate_ride import SMALL, ride
from reference import numbers

import rig
from rig.bench.run.before import findings
from rig.errors import NumericsError
from rig.motion.motion import Motion
from rig.plants import plate

REFERENCE = numbers("plate")
RISING = {"load.force": "ramped"}


def independent(p, duration, h, every, written):
    """Places, pressing forces and frictions every `every` s: velocity Verlet, friction by increments, points (X, Y)."""
    block, film, model = p.slider, p.film, p.reduced()
    sides = [
        ((np.arange(n) + 0.5) / n - 0.5) * size for n, size in ((film.along, block.length), (film.across, block.width))
    ]
    X, Y = (grid.ravel() for grid in np.meshgrid(*sides, indexing="ij"))
    area, nu = block.length * block.width / len(X), film.poisson
    k = film.young * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu)) / film.thickness * area
    shear, c = film.young / (2.0 * (1.0 + nu)) / film.thickness * area, film.retardation * k
    m = block.length * block.width * (block.density * block.thickness + 0.5 * film.density * film.thickness)
    inertia = [m * (size**2 / 12.0 + block.thickness**2 / 3.0) for size in (block.length, block.width)]
    arm, mu, speed = block.thickness + film.thickness, p.friction.mu, p.drive.speed
    omega, still = 2.0 * np.pi * model.frequencies, np.zeros(3)
    mass = np.concatenate([np.ones(len(omega)), [m, *inertia]])
    K, C = np.append(omega**2, still), np.append(2.0 * p.plate.damping_ratio * omega**2 / omega[-1], still)
    load = np.zeros(len(mass))
    load[-3] = -p.load.force

    def rows(place):
        at = np.array(
            [
                model.surface.at(np.array([place + 0.5 * block.length + x]), np.array([y]))[:, :, 0, 0]
                for x, y in zip(X, Y)
            ]
        )
        along, across, up = at.transpose(2, 1, 0)
        o = np.zeros(len(X))
        return np.array(
            [np.vstack([up, o - 1.0, X, -Y]), np.vstack([along, o, o + arm, o]), np.vstack([across, o, o, o - arm])]
        )

    q, pushed, v = np.zeros(len(mass)), load, np.array([written.get(name, 0.0) for name in velocities(len(omega))])
    f, g, cell, found = np.zeros(len(X)), np.zeros(len(X)), None, []
    for step in range(1, round(duration / h) + 1):
        v = v + 0.5 * h * (pushed - K * q - C * v) / mass
        q = q + h * v
        where = (block.position + (speed * step * h if block.travels else 0.0)) / model.grid.pitch
        if int(where) != cell:
            cell = int(where)
            here, there = rows(cell * model.grid.pitch), rows((cell + 1) * model.grid.pitch)
        up, along, across = here + (where - cell) * (there - here)
        deep = up.T @ q
        P = np.where(deep > 0.0, np.maximum(k * deep + c * (up.T @ (v + 0.5 * h * (pushed - K * q) / mass)), 0.0), 0.0)
        f = f + shear * h * (speed - along.T @ v)
        if film.lateral:
            g = g - shear * h * (across.T @ v)
        most = mu * P / np.maximum(np.hypot(f, g), 1e-300)
        f, g = f * np.minimum(most, 1.0), g * np.minimum(most, 1.0)
        pushed = load - up @ P + along @ f + across @ g
        v = (v + 0.5 * h * (pushed - K * q) / mass) / (1.0 + 0.5 * h * C / mass)
        if step % round(every / h) == 0:
            found.append([q, P, f, g])
    q, P, f, g = (np.array(part) for part in zip(*found))
    return SimpleNamespace(q=q, P=P, f=f, g=g, X=X, Y=Y)


def velocities(modes):
    return [*(f"q{i + 1}'" for i in range(modes)), "z'", "theta'", "psi'"]


UNSEEN = {
    "load.force": 60.0,
    "drive.speed": 5e-4,
    "friction.mu": 0.45,
    "film.thickness": 0.002,
    "slider.position": 0.0052,
}
KNOCKED = {"q1'": 1e-4, "q2'": -2e-4, "q3'": 5e-5, "psi'": 0.02}


@pytest.mark.parametrize(
    ("changes", "meets"),
    [
        ({}, {"opens", "sticks", "is dragged back"}),
        ({"film.lateral": True}, {"opens", "sticks", "is dragged back"}),
        ({"film.retardation": 1e-7}, {"opens", "sticks"}),
        ({"drive.speed": 0.5}, {"opens"}),
        ({"slider.travels": False}, {"opens", "sticks", "is dragged back"}),
    ],
    ids=["along", "lateral", "damped", "travels", "held"],
)
def test_an_independent_integrator_of_the_equations_agrees(changes, meets):
    """0.6 ms after a load has been put on at once and the plate was knocked."""
    ours = ride(UNSEEN | changes, 6e-4, 50, 5_000, KNOCKED)
    theirs = independent(ours.p, 6e-4, 5e-8, 5e-6, KNOCKED)
    order = [int(np.argmin(np.hypot(ours.film.x - x, ours.film.y - y))) for x, y in zip(theirs.X, theirs.Y)]
    pairs = [(ours.places, theirs.q)]
    pairs += [(ours.of_points(kept)[:, order], getattr(theirs, kept)) for kept in ("P", "f")]
    if "film.lateral" in changes:
        pairs.append((ours.of_points("g")[:, order], theirs.g))
    for found, expected in pairs:
        off, size = (np.sqrt(np.mean(part**2, axis=0)) for part in (found - expected, expected))
        assert (off < 5e-3 * size).all()
    most = ours.p.friction.mu * theirs.P
    met = {"opens": theirs.P == 0.0, "sticks": np.abs(theirs.f) < 0.99 * most, "is dragged back": theirs.f < 0.0}
    assert {what for what, where in met.items() if where.any()} >= meets


def test_a_footprint_under_even_pressure_sinks_as_independent_elements_do():
    """The points' rows over the modes, and what the modes leave out: their mean deflection."""
    scene = rig.load("plate", {"foam.thickness": 0.010, "foam.young": 1e10, "slider.position": 0.02185})
    film, model = scene.assemble().system().film, scene.parameters.reduced()
    rows = film.everywhere(0.02185)[0][: len(model.frequencies)]
    pressure = REFERENCE["pressure"]
    force = rows.sum(axis=1) * pressure * 0.043 * 0.0253 / film.points
    mean = (rows.T @ (force / (2.0 * np.pi * model.frequencies) ** 2)).mean() + pressure * model.surface.residual
    assert 1e9 * mean == pytest.approx(REFERENCE["deflection_nm"], rel=0.01)


def test_pressure_stands_ahead_of_the_middle_by_friction_times_its_arm():
    """Steady sliding, of a plate so damped that it comes to rest: mu (h + t_f) = 4.08 mm."""
    changes = {"load.force": 108.79, "plate.damping_ratio": 0.5, "film.retardation": 5e-7}
    found = ride(changes | {"slider.position": 0.02}, 0.02, 1000)
    assert found.at("film.fraction")[-1] == 1.0
    assert found.at("film.centre_x")[-200:].mean() == pytest.approx(0.3 * 0.0136, abs=2e-5)
    assert found.at("film.friction")[-1] == pytest.approx(0.3 * 108.79, rel=1e-3)


@given(scale=st.floats(0.2, 5.0), position=st.floats(0.0, 0.0437))
@settings(max_examples=6)
def test_pressure_and_speed_together_scale_the_motion(scale, position):
    """The rig knows no other force and no other speed; the slider is held."""
    changes = {"slider.travels": False, "slider.position": position, "friction.mu": 0.5}
    one = ride(changes | {"load.force": 60.0, "drive.speed": 5e-4}, 1e-3, 1000)
    other = ride(changes | {"load.force": 60.0 * scale, "drive.speed": 5e-4 * scale}, 1e-3, 1000)
    assert other.places == pytest.approx(scale * one.places, rel=1e-4, abs=1e-6 * scale * np.abs(one.places).max())
    assert one.openings[-1] == other.openings[-1] > 0.0


@given(
    mu=st.just(0.0) | st.floats(1e-3, 1.0),
    force=st.floats(1.0, 500.0),
    speed=st.floats(1e-5, 1.0),
    lateral=st.booleans(),
    retardation=st.sampled_from([0.0, 1e-8, 2e-7]),
    roll=st.floats(-0.1, 0.1),
)
@settings(max_examples=12)
def test_no_point_pulls_or_bears_more_than_its_friction(mu, force, speed, lateral, retardation, roll):
    changes = {
        "friction.mu": mu,
        "load.force": force,
        "drive.speed": speed,
        "film.lateral": lateral,
        "film.retardation": retardation,
    }
    found = ride(changes, 3e-4, 1000, 1000, {"psi'": roll})
    P, f = found.of_points("P"), found.of_points("f")
    size = np.hypot(f, found.of_points("g")) if lateral else np.abs(f)
    assert P.min() >= 0.0
    assert (size <= mu * P * (1.0 + 1e-12)).all()
    assert found.at("film.normal") == pytest.approx(P.sum(axis=1), rel=1e-12)
    assert found.at("film.friction") == pytest.approx(f.sum(axis=1), rel=1e-9, abs=1e-12 * force)
    assert found.at("film.fraction") == pytest.approx((P > 0.0).mean(axis=1))
    opened = np.count_nonzero((P[:-1] > 0.0) & (P[1:] == 0.0))
    assert found.openings[-1] - found.openings[0] == opened


def test_a_point_that_sticks_creeps_by_no_more_than_its_shear_gives():
    """Inside the cone friction changes by the film's shear times the way slid; at rest that is mu P / k_t at most."""
    changes = {"slider.travels": False, "drive.speed": 0.0, "friction.mu": 0.6, "load.force": 80.0}
    found = ride(changes, 2e-3, 1000, 1000, KNOCKED)
    P, f = found.of_points("P"), found.of_points("f")
    carried = found.places @ found.film.everywhere(0.0)[1]
    inside = np.abs(f) < 0.999 * 0.6 * P
    stuck = inside[1:] & inside[:-1]
    assert 0.2 < stuck.mean() < 1.0
    crept, given = np.diff(carried, axis=0)[stuck], np.diff(f, axis=0)[stuck]
    assert given == pytest.approx(-found.film.shear[0] * crept, rel=1e-6, abs=1e-9 * np.abs(f).max())
    rested = ride(changes | {"plate.damping_ratio": 0.5, "film.retardation": 5e-7}, 0.02, 1000)
    P, carried = rested.of_points("P"), rested.places @ rested.film.everywhere(0.0)[1]
    assert np.ptp(carried[-500:], axis=0).max() < 1e-6 * (0.6 * P / rested.film.shear).max()


@given(roll=st.floats(1e-3, 0.1), lateral=st.booleans())
@settings(max_examples=6)
def test_a_mirrored_knock_gives_the_mirrored_motion(roll, lateral):
    changes = {"film.lateral": lateral, "load.force": 60.0, "drive.speed": 2e-3}
    left, right = (ride(changes, 4e-4, 500, written={"psi'": side * roll}) for side in (1.0, -1.0))
    mirrored = np.roll(right.of_points("P"), right.film.points // 2, axis=1)
    assert left.openings[-1] > 0.0
    assert left.of_points("P") == pytest.approx(mirrored, abs=1e-6 * mirrored.max())
    assert left.at("psi") == pytest.approx(-right.at("psi"), abs=1e-6 * np.abs(left.at("psi")).max())
    assert left.at("film.centre_y") == pytest.approx(-right.at("film.centre_y"), abs=1e-6 * 0.0253)


def test_the_position_is_exact_at_the_end_of_the_whole_travel():
    """4.37 s at 10 mm/s, as printed, in two million steps: at the edge, and not beyond it."""
    found = ride({"load.force": 10.0, "drive.speed": 0.01, "plate.modes": 4}, 4.37, 4000, 20_000)
    time = 2e-5 * np.arange(1, len(found.places) + 1)
    assert np.abs(found.at("position") - 0.01 * time).max() < 1e-12
    with pytest.raises(NumericsError, match=r"the slider has reached the end of its travel, 0\.0437 m\n  at t = 4\.37"):
        found.motion.advance(1)


def test_friction_across_the_travel_damps_like_a_dashpot_of_mu_n_over_v():
    """3260 N s/m at the paper's values, for motions in y that are slow beside the travel."""
    changes = {"load.force": 108.79, "slider.position": 0.02, "drive.speed": 0.01, "slider.travels": False}
    changes["film.lateral"] = True
    rested = ride(changes | {"plate.damping_ratio": 0.5}, 0.02, 1000)
    assert np.ptp(rested.places[-200:], axis=0).max() < 1e-14
    P, film, nq = rested.of_points("P")[-1], rested.film, len(rested.system.coordinates)
    normal, along, across = film.everywhere(0.02)
    K = np.append((2.0 * np.pi * rested.p.reduced().frequencies) ** 2, np.zeros(3))
    K = np.diag(K) + film.stiffness * (normal - 0.3 * along) @ normal.T
    C = 0.3 / 0.01 * (across * P) @ across.T
    assert 0.3 / 0.01 * P.sum() == pytest.approx(3264.0, rel=1e-3)
    A = np.block([[np.zeros((nq, nq)), np.eye(nq)], [-K, -C]])
    A[nq:] /= np.diag(rested.system.mass)[:, None]
    values = np.linalg.eigvals(A)
    (swaying,) = values[
        (values.imag > 2.0 * np.pi * 4500.0) & (values.imag < 2.0 * np.pi * 6500.0) & (values.real < -500.0)
    ]
    moving = plate.assemble(rig.load("plate", SMALL | changes | {"plate.damping_ratio": 0.0}).parameters, {}).system()
    motion = Motion(moving, 10_000, "kick", substeps=10, longest=150)
    x = rested.motion.state.x.copy()
    x[moving.names.index("q1'")] += 1e-6  # m/s: the mode that shears the foam sideways
    motion.restart(x)
    motion.advance(150)
    swing = [np.ptp(motion.states[:, 0][k : k + 40]) for k in (20, 100)]
    assert math.log(swing[0] / swing[1]) / 8e-4 == pytest.approx(-swaying.real, rel=0.05)


CLOSED = {
    "slider.travels": False,
    "load.force": 0.0,
    "drive.speed": 0.5,
    "plate.damping_ratio": 0.1,
    "friction.mu": 0.1,
}
SLOWLY = {"load.slope": 100.0 / 4e-3}


def test_closed_and_sliding_it_is_the_bonded_rig_whose_energy_closes_by_the_square_of_the_step():
    exact = ride(CLOSED | {"film.opens": False}, 4e-3, 10_000, written=SLOWLY, method="exact", moved=RISING)
    energy = exact.motion.energy()
    assert abs(energy["error"]) < 1e-9
    assert energy["forces"] > 0.0
    steps, errors = [2000, 1000, 500, 250], []
    for step in steps:
        found = ride(CLOSED, 4e-3, step, written=SLOWLY, moved=RISING)
        assert found.openings[-1] == 0.0
        errors.append(np.abs(found.places - exact.places).max() / np.abs(exact.places).max())
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.2)
    assert errors[-1] < 6e-5


def test_what_the_energy_leaves_over_falls_fourfold_when_the_step_is_halved():
    """Points open and close all the time after a load that was put on at once."""
    left = []
    for step in (2000, 1000, 500, 250):
        found = ride(UNSEEN | {"drive.speed": 0.5, "slider.travels": False}, 5e-4, step)
        energy = found.motion.energy()
        assert found.openings[-1] > 10.0
        left.append(abs(energy["error"]))
    assert left[2] < 1e-2
    assert (left[0] / left[3]) ** (1.0 / 3.0) == pytest.approx(4.0, rel=0.4)


@pytest.mark.parametrize(
    ("changes", "level"), [({"clock.rk4_step": 1e-5}, "error"), ({"film.retardation": 1e-6}, "warning")]
)
def test_the_step_that_is_advised_is_one_that_is_taken(changes, level):
    """A damped film is the stiffer, the shorter the step: the advice counts with it."""
    found = [one for one in findings(rig.load("plate", SMALL | changes)) if "every point closed" in one.what]
    assert [one.level for one in found] == [level]
    advised = found[0].remedy.removeprefix("rk4_step of ").removesuffix(" or less")
    again = findings(rig.load("plate", SMALL | changes | {"clock.rk4_step": advised}))
    assert not [one for one in again if "every point closed" in one.what and one.level in ("error", level)]


def test_one_run_and_what_it_is_made_of_say_that_it_is_chaotic(rig):
    opens = ("-p", "plate.damping_ratio=0", "-p", "slider.position=4 mm", "-p", "noise.force=1e-6")
    code, out, _ = rig("simulate", "plate", *opens, "--duration", "0.14")
    assert code == 0
    assert "a point opens first at t = 0.1" in out
    assert "its numbers are statistics" in out
    code, out, _ = rig("simulate", "plate", "--duration", "0.02")
    assert "no point opens" in out
    assert "chaotic" in rig("explain", "plate")[1]
    assert "chaotic" not in rig("explain", "belt")[1]
