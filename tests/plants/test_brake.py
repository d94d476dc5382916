"""The disc brake: matrices, eigenvalues, critical friction over pressure, the squeal that lift-off bounds.

Numbers: tests/reference/brake.json, by independent code (sets BRAKE and BRAKE-P); eigenvalues to 1e-3 1/s, in Hz.
"""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import rig
from rig.errors import SceneError
from rig.solve.formulation import assemble
from rig.solve.linear import sliding_key

BRAKE = json.loads((Path(__file__).parents[1] / "reference" / "brake.json").read_text())


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


def test_light_braking_never_squeals():
    assert BRAKE["mu_crit_vs_p_bar"]["2"] is None
    assert all(growth({"load.pressure": "2 bar", "friction.mu": mu}) < 0.0 for mu in np.linspace(0.1, 1.5, 15))


def test_the_stiffer_brake_grows_as_the_shorted_stack_does():
    flutter = rig.modes(rig.load("brake_3400")).sliding.modes[0]
    assert [flutter.growth, 2.0 * math.pi * flutter.frequency] == pytest.approx(BRAKE["BRAKE-P"]["short"], abs=1e-3)


def test_contacts_of_a_pad_are_one_patch():
    brake = system()
    assert [p.name for p in brake.patches] == ["inner_pad", "outer_pad"]
    assert [k.patch for k in brake.normals] == [0, 0, 1, 1]


def test_sliding_is_where_the_scene_says():
    found = rig.modes(rig.load("brake")).sliding.equilibrium
    assert [found[f"normal_force_{name}"] for name in ("inner_left", "inner_right")] == pytest.approx([1000.0, 1000.0])
    assert found["displacement"] == pytest.approx(0.0, abs=1e-15)
    at_rest = rig.modes(rig.load("brake", {"load.at": "rest"})).sliding.equilibrium
    assert at_rest["normal_force_inner_left"] != pytest.approx(at_rest["normal_force_inner_right"], rel=0.05)


def test_pressure_presses():
    found = rig.modes(rig.load("brake", {"load.pressure": "5 bar"})).sliding.equilibrium
    assert found["normal_force"] == pytest.approx(2000.0 / 3.0)


def test_all_faults_of_the_geometry_are_told_at_once():
    changes = {
        "springs.disc_x.first": "disk",
        "springs.bridge.second": "free_carrier",
        "contacts.inner_left.pad": "inner_pad.nose",
        "springs.piston_left.stiffness": "-1 N/m",
    }
    with pytest.raises(SceneError) as told:
        rig.load("brake", changes)
    assert "springs.piston_left.stiffness" in str(told.value)
    del changes["springs.piston_left.stiffness"]
    with pytest.raises(SceneError) as told:
        rig.load("brake", changes)
    assert [line.partition(":")[0].partition(" = ")[0] for line in told.value.faults] == [
        "springs.disc_x",
        "springs.bridge",
        "contacts.inner_left",
    ]
