"""Mode sets: built when first visited, each with propagators, guards and bounds that hold."""

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from rig.errors import SceneError
from rig.model.formulation import assemble
from rig.model.mode_sets import ModeSets
from rig.motion.motion import Motion
from rig.solve import expm
from rig.solve.records import OPEN, SLIP_MINUS, SLIP_PLUS, STICK


def test_only_mode_sets_that_are_visited_are_built(rigs, run):
    motion = run(rigs.p1(), 1.0, 2.0).motion
    assert motion.system.keys == 6
    assert len(motion.mode_sets.sets) == motion.counts()["mode_sets"] == 2
    assert {motion.system.describe(s.key) for s in motion.mode_sets.sets} == {"contact stick", "contact slip+"}


def test_mode_sets_that_were_foreseen_are_there_and_change_no_bit(rigs, run):
    plain, foreseen = (Motion(rigs.p1(), 1_000_000, "exact") for _ in range(2))
    foreseen.foresee(most=5)
    assert len(foreseen.mode_sets.sets) == len(plain.mode_sets.sets) == 1  # there are six: more than asked for
    foreseen.foresee()
    assert {s.key for s in foreseen.mode_sets.sets} == set(range(foreseen.system.keys))
    for _ in range(2000):
        plain.advance(1)
        foreseen.advance(1)
    assert plain.counts()["events"] == foreseen.counts()["events"] > 10
    assert plain.x.tobytes() == foreseen.x.tobytes()
    assert plain.energy() == foreseen.energy()


def test_a_key_names_its_modes_and_back(rigs):
    system = rigs.p3()
    for key in range(system.keys):
        assert system.key(*system.modes(key)) == key
    assert system.describe(system.key([SLIP_MINUS], [OPEN], [])) == "contact slip-, load open"


def test_a_propagator_carries_the_landing(rigs):
    system = rigs.p4()
    mode_sets = ModeSets(system, 1e-3, [])
    for mode in (SLIP_PLUS, STICK):
        modes = mode_sets.add(system.key([mode], [0], []))
        at = mode_sets.tables.mode_set_of[modes.key]
        d = expm.balance(modes.A)
        Phi = scipy.linalg.expm(modes.A * d[:, None] / d[None, :] * 1e-3) * d[None, :] / d[:, None]
        expected = modes.landing @ Phi @ modes.landing
        assert mode_sets.tables.E[at, 0] + np.eye(system.n) == pytest.approx(expected, rel=1e-9, abs=1e-13)


def test_a_deeper_ladder_leaves_the_older_mode_sets_alone(rigs):
    """Stick of P4 has the network's frequencies too; mode sets of different depth share one table."""
    system = rigs.p3()
    mode_sets = ModeSets(system, 5e-3, [])
    first = mode_sets.add(system.key([SLIP_PLUS], [0], []))
    before = mode_sets.tables.E[0, : mode_sets.tables.depth[0] + 1].copy()
    for key in range(system.keys):
        if mode_sets.tables.mode_set_of[key] < 0:
            mode_sets.add(key)
    assert np.array_equal(mode_sets.tables.E[0, : len(before)], before)
    assert mode_sets.tables.mode_set_of[first.key] == 0


@given(
    seed=st.integers(0, 2**32 - 1), name=st.sampled_from(["p1", "p3", "p4"]), step=st.sampled_from([1e-4, 1e-3, 5e-3])
)
@settings(max_examples=25)
def test_the_bound_of_a_guard_bounds_its_bulge(rigs, seed, name, step):
    """No guard leaves the chord over a step by more than the bound that certifies quiet ticks."""
    system = getattr(rigs, name)()
    mode_sets = ModeSets(system, step, [])
    mode_sets.add(system.key([SLIP_PLUS], [0], []))
    t = mode_sets.tables
    rng = np.random.default_rng(seed)
    size = np.array([1e-3, 1e-3, 0.1, 0.1][: 2 * len(system.coordinates) : 1] + [1.0] * 4)[: system.n]
    x = rng.normal(size=system.n) * size
    x[system.one] = 1.0
    A = mode_sets.sets[0].A
    d = expm.balance(A)
    B = A * d[:, None] / d[None, :]
    share = np.linspace(0.0, 1.0, 23)
    along = [scipy.linalg.expm(B * step * u) @ (x * d) / d for u in share]
    for k in range(t.guards[0]):
        g = np.array([t.G[0, k] @ y for y in along])
        chord = g[0] + share * (g[-1] - g[0])
        bound = t.B[0, k] @ np.abs(x)
        assert np.abs(g - chord).max() <= bound * (1.0 + 1e-9) + 1e-12 * np.abs(g).max()


def test_jamming_shows_in_the_determinant(rigs):
    """1 for plain contacts; 1 - mu tan(phi) for a contact whose normal force bears the inertia of a tilted pin."""
    assert assemble(rigs.p1(), rigs.p1().key([SLIP_PLUS], [0], [])).jam == pytest.approx(1.0, rel=1e-15)
    a = rigs.oscillator(mud=0.25)
    name, patch, row, direction, _, opens = a.normals[0]
    a.normals[0] = (name, patch, row, direction, {"x": 1.6}, opens)
    system = a.system()
    assert assemble(system, system.key([SLIP_PLUS], [0], [])).jam == pytest.approx(1.0 - 0.25 * 1.6, rel=1e-14)
    assert assemble(system, system.key([SLIP_MINUS], [0], [])).jam == pytest.approx(1.0 + 0.25 * 1.6, rel=1e-14)


def test_rows_that_name_what_is_not_there_are_all_told(rigs):
    a = rigs.oscillator()
    a.push("x", {"nowhere": 1.0})
    a.network["U"] = {"neither": 1.0}
    with pytest.raises(SceneError) as told:
        a.system()
    assert "nowhere" in str(told.value)
    assert "neither" in str(told.value)
