"""The tip of a clamped beam in several modes: elements against closed forms, the contact against the beam in one mode.

Closed forms: clamped-free Euler-Bernoulli beam, cos(b) cosh(b) = -1; clamped-free bar. Setting: Tonazzi, Passafiume,
Papangelo, Hoffmann, Massi, Nonlinear Dynamics 102 (2020) 1361, section 4.2.
"""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

import rig
from rig.analysis.recorded.stick_speeds import stages
from rig.plants.structures.bending import clamped, matrices
from rig.plants.tip import Inclination
from rig.plants.tip_beam import shapes

BENDING, EXTENSION, LINE, LENGTH = 8.27, 5.9e6, 0.305, 0.075


def roots(count):
    """B of cos(b) cosh(b) = -1."""
    return [brentq(lambda b: math.cos(b) + 1.0 / math.cosh(b), i * math.pi, (i + 1) * math.pi) for i in range(count)]


def frequencies(elements):
    """Bending and extension of the clamped beam [rad/s]."""
    K, M = (whole[3:, 3:] for whole in matrices(BENDING, EXTENSION, LINE, LENGTH, elements))
    out = []
    for part in (np.arange(len(K)) % 3 != 0, np.arange(len(K)) % 3 == 0):
        own = np.linalg.eigvals(np.linalg.solve(M[np.ix_(part, part)], K[np.ix_(part, part)]))
        out.append(np.sqrt(np.sort(own.real)))
    return out


def test_frequencies_converge_to_the_closed_forms_with_the_order_of_the_elements():
    bent = [b**2 * math.sqrt(BENDING / (LINE * LENGTH**4)) for b in roots(3)]
    drawn = [(i + 0.5) * math.pi * math.sqrt(EXTENSION / (LINE * LENGTH**2)) for i in range(2)]
    coarse, fine = (
        [np.array(one[: len(exact)]) / exact - 1.0 for one, exact in zip(frequencies(n), (bent, drawn))]
        for n in (8, 16)
    )
    for order, before, after in zip((4.0, 2.0), coarse, fine):
        assert (after > 0.0).all()
        assert np.log2(before / after) == pytest.approx(order, abs=0.1)
    assert fine[0].max() < 3e-4


@pytest.mark.parametrize("elements", [1, 3, 24])
def test_a_force_at_the_tip_bends_and_stretches_the_beam_exactly(elements):
    K, _ = matrices(BENDING, EXTENSION, LINE, LENGTH, elements)
    yields = np.linalg.inv(K[3:, 3:])
    assert yields[-2, -2] == pytest.approx(LENGTH**3 / (3.0 * BENDING), rel=1e-9)
    assert yields[-3, -3] == pytest.approx(LENGTH / EXTENSION, rel=1e-9)


@pytest.mark.parametrize("modes", [1, 3, 6])
def test_the_reduced_beam_keeps_its_modes_and_is_statically_exact(modes):
    found = clamped(BENDING, EXTENSION, LINE, LENGTH, modes)
    across, along = found.tip.T
    assert ((across / found.omega) ** 2).sum() == pytest.approx(LENGTH**3 / (3.0 * BENDING), rel=1e-9)
    assert ((along / found.omega) ** 2).sum() == pytest.approx(LENGTH / EXTENSION, rel=1e-9)
    shear, pull = found.clamp.T  # what the tip is pushed with arrives at the clamp
    assert (shear * across / found.omega**2).sum() == pytest.approx(1.0, rel=1e-9)
    assert (pull * along / found.omega**2).sum() == pytest.approx(1.0, rel=1e-9)
    assert (shear * along / found.omega**2).sum() == pytest.approx(0.0, abs=1e-9)
    bent = [b**2 * math.sqrt(BENDING / (LINE * LENGTH**4)) for b in roots(min(modes, 3))]
    assert found.omega[: len(bent)] == pytest.approx(bent, rel=1e-4)


def test_the_scene_has_the_compliance_ratio_and_relief_of_the_beam_in_one_mode():
    p = rig.load("tip_beam").parameters
    found = shapes(p)
    across, along = (float(((shape / p.beam.reduced().omega) ** 2).sum()) for shape in p.beam.reduced().tip.T)
    eps = (along + 1.0 / p.contact.stiffness) / across
    assert eps == pytest.approx(0.0055, rel=0.02)
    one = Inclination(angle=p.contact.angle, compliance=eps)
    assert found.relief(p.contact.stiffness) == pytest.approx(one.relief(), rel=0.01)
    stiff = one.stiffening() / across
    slides = rig.modes(rig.load("tip_beam", {"drive.speed": 0.02})).sliding
    assert slides.equilibrium["friction_force"] / slides.equilibrium["displacement"] == pytest.approx(stiff, rel=0.01)


def test_steady_sliding_relieves_the_contact_and_the_clamp_holds_the_friction_force():
    scene = rig.load("tip_beam", {"drive.speed": 0.02})
    found = rig.modes(scene).sliding.equilibrium
    relief = shapes(scene.parameters).relief(scene.parameters.contact.stiffness)
    assert found["normal_force"] == pytest.approx(50.0 / (1.0 + 0.3 * relief), rel=1e-9)
    assert found["clamp_force"] == pytest.approx(found["friction_force"], rel=1e-9)
    mixed = found["height"] * scene.parameters.contact.stiffness
    assert found["normal_force"] + mixed == pytest.approx(50.0, rel=1e-9)


def test_more_modes_change_the_first_one_on_the_disc_little():
    first = [rig.modes(rig.load("tip_beam", {"drive.speed": 0.02, "beam.modes": n})).sliding.modes for n in (1, 3, 8)]
    hertz = [min(mode.frequency for mode in modes) for modes in first]
    assert hertz[1] == pytest.approx(hertz[2], rel=1e-4)
    assert hertz[0] == pytest.approx(hertz[2], rel=0.02)


@pytest.fixture(scope="module")
def run():
    return rig.simulate("tip_beam")


def test_the_run_is_exact_closes_its_energy_balance_and_keeps_the_friction_cone(run):
    """Stick-slip lasts up to 13 mm/s, sliding until the disc stops."""
    found = stages(run)
    assert 1e3 * found.up == pytest.approx(13.0, abs=0.4)
    assert not found.down > 2e-4
    assert run.summary["plant"]["method"] == "exact"
    assert run.summary["plant"]["opened_ticks"] < 0.2 * run.summary["plant"]["ticks"]
    assert abs(run.energy["error"]) < 1e-9
    friction, normal = run.signals["friction_force"], run.signals["normal_force"]
    assert normal.min() > 0.0
    assert (np.abs(friction) <= 0.3153 * normal * (1.0 + 1e-9)).all()
    system = rig.load("tip_beam").assemble().system()
    sticks = [key for key in np.unique(run.mode) if "stick" in system.describe(int(key))]
    slip = run.signals["slip_speed"][np.isin(run.mode, sticks)]
    assert len(slip) > 1000
    assert np.abs(slip).max() < 1e-15


def test_sticks_excite_the_higher_modes_and_steady_sliding_does_not(run):
    """The second mode on the disc, 3.4 kHz, in stick-slip at 6 mm/s and in sliding at 20."""
    hertz = sorted(mode.frequency for mode in rig.modes(rig.load("tip_beam", {"drive.speed": 0.02})).sliding.modes)[1]
    level = {}
    for name, since in (("stick-slip", 1.2), ("sliding", 4.2)):
        part = (run.time >= since) & (run.time < since + 0.2)
        line = np.abs(np.fft.rfft(run.signals["acceleration"][part] * np.hanning(part.sum())))
        f = np.fft.rfftfreq(part.sum(), 1e-5)
        level[name] = line[np.abs(f - hertz) < 0.05 * hertz].max()
    assert 3000.0 < hertz < 3700.0
    assert level["stick-slip"] > 1e4 * level["sliding"]
