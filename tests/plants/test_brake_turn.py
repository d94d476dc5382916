"""A brake disc that is not alike all round: stiffness by sectors of the turn, their edges in the ledger."""

import math

import numpy as np
import pytest

import rig
from rig.motion.motion import Motion
from rig.stability.linearisation import sliding_key, steady

DEPTH, COUNT, RPM = 0.005, 8, 1200.0
ROUND = {"inhomogeneity.depth": DEPTH, "inhomogeneity.sectors": COUNT, "drive.speed": f"{RPM} rpm"}


def system(changes):
    return rig.load("brake_3400", changes).assemble().system()


def in_sector(brake, i):
    patches, normals, limiters, *_ = brake.modes(sliding_key(brake))
    return steady(brake, brake.key(patches, normals, limiters, [i]))


@pytest.mark.parametrize("i", [0, 3, 6])
def test_a_sector_is_the_brake_at_another_scale(i):
    scale = rig.load("brake_3400").parameters.structure.scale * (
        1.0 + DEPTH * math.cos(2.0 * math.pi * (i + 0.5) / COUNT)
    )
    uniform = system({"structure.scale": scale, "drive.speed": ROUND["drive.speed"]})
    expected = steady(uniform, sliding_key(uniform)).eigenvalues()
    assert in_sector(system(ROUND), i).eigenvalues() == pytest.approx(expected, rel=1e-9)


def test_the_squeal_swings_by_seventeen_hertz():
    """Over the turn of 2.6 s at 23 rpm, as in figure 29 of Kroeger, Neubauer, Popp (2008)."""
    fine = system({"inhomogeneity.depth": DEPTH})
    hertz = np.array([in_sector(fine, i).eigenvalues()[0].imag for i in range(24)]) / (2.0 * math.pi)
    assert 0.5 * np.ptp(hertz) == pytest.approx(17.0, abs=0.3)
    assert 2.0 * math.pi / (fine.start[fine.one] * rig.load("brake_3400").parameters.drive.speed) == pytest.approx(
        2.6087, abs=1e-4
    )


def test_a_turn_of_squeal_closes_its_books_and_builds_nothing_on_the_way():
    brake = system(ROUND | {"start.velocity": 2.0})
    turn = 60.0 / RPM
    ticks = round(1.02 * turn / 20e-6)
    run = Motion(brake, 20_000, "exact", longest=ticks, cap=1000)
    prepared = run.counts()["mode_sets"]
    run.advance(ticks)
    edges = np.array([(e.tick + e.place) * 20e-6 for e in run.events() if e.what == "disc enters the next"])
    assert edges == pytest.approx(turn / COUNT * np.arange(1, COUNT + 1), rel=1e-12)
    assert any(e.what == "inner_left opens" for e in run.events())
    assert run.counts()["mode_sets"] == prepared == 9 * COUNT
    energy = run.energy()
    assert abs(energy["edges"]) > 1e-9 * energy["drive"]
    assert abs(energy["error"]) < 1e-9
