"""Mode sets: built when first visited, each with propagators, guards and bounds that hold."""

import pytest

from rig.model.formulation import assemble
from rig.motion.motion import Motion
from rig.solve.records import SLIP_MINUS, SLIP_PLUS


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


def test_jamming_shows_in_the_determinant(rigs):
    """1 for plain contacts; 1 - mu tan(phi) for a contact whose normal force bears the inertia of a tilted pin."""
    assert assemble(rigs.p1(), rigs.p1().key([SLIP_PLUS], [0], [])).jam == pytest.approx(1.0, rel=1e-15)
    a = rigs.oscillator(mud=0.25)
    name, patch, row, direction, _, opens = a.normals[0]
    a.normals[0] = (name, patch, row, direction, {"x": 1.6}, opens)
    system = a.system()
    assert assemble(system, system.key([SLIP_PLUS], [0], [])).jam == pytest.approx(1.0 - 0.25 * 1.6, rel=1e-14)
    assert assemble(system, system.key([SLIP_MINUS], [0], [])).jam == pytest.approx(1.0 + 0.25 * 1.6, rel=1e-14)
