"""A film whose numbers change in a run: beside exact patches with the same change, closed forms, energy."""

import numpy as np
import pytest
from points_on_structure import structure

from rig.model.film import over
from rig.motion.motion import Motion
from rig.solve.film_steps import SLIDES

TICK = 100_000  # ns
MASS, DAMPING = np.diag([1.0, 0.7]), np.diag([3.0, 2.0])
STIFFNESS = np.array([[4e4, 9e3], [9e3, 3e4]])
SLIDING = {"normal": [[0.3, 1.0], [-0.2, 0.9]], "along": [[1.0, 0.1], [0.9, -0.2]], "stiffness": 5e4, "mu": 0.4}


def rig_of(film=True, **points):
    """Two points that slide on a structure of two coordinates, as a film or as patches."""
    given = SLIDING | {"shear": 1e8} | points
    return structure(MASS, DAMPING, STIFFNESS, given, 5.0, film, load=(0.0, 40.0), start=(0.0, 1e-4), tells=True)


def changed(assembly, other, step_ns=1000, ticks=200):
    """The motion of `assembly`, which becomes `other` after half of the ticks; the states at all of them."""
    film = assembly.film is not None
    motion = Motion(
        assembly.system(), TICK, "kick" if film else "exact", substeps=TICK // step_ns if film else 1, longest=ticks
    )
    motion.advance(ticks // 2)
    states = [motion.states[:, :4].copy()]
    motion.replace(motion.ready(other.system()))
    motion.advance(ticks // 2)
    return motion, np.concatenate([*states, motion.states[:, :4]])


def state(motion, kind):
    """The states of one kind of both points."""
    return motion.x[[motion.system.names.index(f"{kind}:{point}") for point in (1, 2)]]


@pytest.mark.parametrize("factor", [10.0, 0.1])
def test_points_with_another_stiffness_move_like_exact_patches_with_it(factor):
    other = {"stiffness": 5e4 * factor, "shear": 1e8 * factor}
    _, exact = changed(rig_of(False), rig_of(False, **other))
    errors = []
    for step_ns in (4000, 1000):
        _, film = changed(rig_of(), rig_of(**other), step_ns)
        errors.append(float((np.abs(film - exact).max(axis=0) / np.abs(exact).max(axis=0)).max()))
    assert errors[1] < 1e-5
    assert errors[1] < errors[0] / 8.0


@pytest.mark.parametrize("factor", [10.0, 0.1])
@pytest.mark.parametrize("damping", [0.0, 20.0])
def test_a_change_of_stiffness_keeps_gaps_and_shear_and_gives_the_energy_of_the_springs(factor, damping):
    new = {"stiffness": 5e4 * factor, "shear": 1e8 * factor, "damping": damping * factor}
    motion = Motion(rig_of(damping=damping).system(), TICK, "kick", substeps=100)
    for _ in range(40):
        motion.advance(1)
    P, f, gaps, before = (
        state(motion, "P"),
        state(motion, "f"),
        motion.x[:2] @ np.array(SLIDING["normal"]).T,
        motion.energy(),
    )
    assert (P > 0.0).all()
    motion.replace(motion.ready(rig_of(**new).system()))
    after = motion.energy()
    assert state(motion, "P") == pytest.approx(factor * P, rel=1e-12)
    assert state(motion, "f") == pytest.approx(factor * f, rel=1e-12)
    given = 0.5 * (factor - 1.0) * (5e4 * gaps**2 + f**2 / 1e8).sum()
    assert after["impulses"] - before["impulses"] == pytest.approx(given, rel=1e-9)
    normal, along = (np.array(SLIDING[name]) for name in ("normal", "along"))
    forces = motion.x[[motion.system.names.index(f"film:q{i}") for i in (1, 2)]]
    assert forces == pytest.approx(factor * (f @ along - P @ normal), rel=1e-12)
    assert motion.x[motion.system.names.index(over("normal"))] == pytest.approx(factor * P.sum(), rel=1e-12)
    motion.advance(1)
    assert abs(motion.energy()["error"]) < 1e-7


def test_points_beyond_their_new_friction_slip_at_once_and_lose_the_energy_of_their_shear():
    motion = Motion(rig_of(shear=1e6).system(), TICK, "kick", substeps=100)
    motion.advance(1)
    P, f, before = state(motion, "P"), state(motion, "f"), motion.energy()
    assert f == pytest.approx(0.4 * P, rel=1e-12)
    motion.replace(motion.ready(rig_of(shear=1e6, mu=0.1).system()))
    assert state(motion, "f") == pytest.approx(0.1 * P, rel=1e-12)
    assert (state(motion, "s") == SLIDES).all()
    after, lost = motion.energy(), (f**2 - (0.1 * P) ** 2).sum() / 2e6
    assert after["friction"] - before["friction"] == pytest.approx(lost, rel=1e-9)
    assert after["impulses"] == pytest.approx(before["impulses"], abs=1e-12 * lost)
    assert abs(after["error"]) < 1e-7


def test_points_that_become_damped_resist_at_the_speed_of_their_compression():
    motion = Motion(rig_of().system(), TICK, "kick", substeps=100)
    motion.advance(3)
    P, rate = state(motion, "P"), motion.x[2:4] @ np.array(SLIDING["normal"]).T
    motion.replace(motion.ready(rig_of(damping=20.0).system()))
    assert state(motion, "P") == pytest.approx(P + 20.0 * rate, rel=1e-12)
    assert state(motion, "c") == pytest.approx(P / 5e4, rel=1e-12)
    motion.advance(20)
    assert abs(motion.energy()["error"]) < 1e-7


def test_a_change_beside_the_film_leaves_its_states_alone():
    motion = Motion(rig_of(damping=20.0).system(), TICK, "kick", substeps=100)
    motion.advance(7)
    a = rig_of(damping=20.0)
    a.damping = {key: 2.0 * value for key, value in a.damping.items()}
    before = motion.x.copy()
    motion.replace(motion.ready(a.system()))
    assert motion.x.tobytes() == before.tobytes()
