"""Boxes whose truth is known: proved where no rig grows, refuted where one does, never the wrong way round."""

import numpy as np
import pytest

import rig as lab
from rig.analysis.robust.certificate import Examination, NoProof, perron_bounds
from rig.analysis.robust.growth import Growth, Matrix
from rig.analysis.robust.search import PARTS, PROVED, REFUTED, UNDECIDED, examined
from rig.analysis.robust.stated import box


def certify(matrix, count, *stated, most=PARTS, period=0.0, **more):
    """What is known of the unit cube of matrix(u [count]), examined in this process."""

    try:
        examination = Examination(lambda u: Matrix(matrix(u), period), count, *stated, **more)
    except NoProof as fault:
        why = str(fault)
        return examined(lambda parts: [{"why": why}], [np.array([np.zeros(count), np.ones(count)])], 0.0)

    def ask(parts):
        return [examination.examined(*part[2:]) for part in parts]

    return examined(ask, [np.array([np.zeros(count), np.ones(count)])], 0.0, most)


def oscillator(damping, stiffness=1.0):
    return np.array([[0.0, 1.0], [-stiffness, -damping]])


def flutter(mu, k3, c, k1=100.0, k2=50.0):
    """Two springs at 135 and 45 degrees with equal dampers, and a contact: growth -c/2 + max Re sqrt(c^2/4 - kappa)."""
    along = [np.outer(v, v) for v in (np.array([-1.0, 1.0]) / np.sqrt(2.0), np.array([1.0, 1.0]) / np.sqrt(2.0))]
    K = k1 * along[0] + k2 * along[1] + k3 * np.array([[0.0, mu], [0.0, 1.0]])
    A = np.zeros((4, 4))
    A[:2, 2:] = np.eye(2)
    A[2:, :2] = -K
    A[2:, 2:] = -c * np.eye(2)
    return A, K


def worst_flutter(ranges, c):
    kappas = [
        np.linalg.eigvals(flutter(mu, k3, c)[1])
        for mu in np.linspace(*ranges[0], 41)
        for k3 in np.linspace(*ranges[1], 41)
    ]
    return -c / 2 + np.sqrt(c**2 / 4 - np.array(kappas).astype(complex)).real.max()


def spread(ranges, matrix):
    low, high = np.array(ranges).T
    return lambda u: matrix(*(low + (high - low) * u))


@pytest.mark.parametrize(("limit", "verdict"), [(-0.045, PROVED), (-0.0501, REFUTED)])
def test_an_oscillator_decays_with_half_its_least_damping(limit, verdict):
    found = certify(spread([(0.1, 0.3), (1.0, 1.5)], oscillator), 2, limit)
    assert found.verdict == verdict
    if verdict == REFUTED:
        damping = 0.1 + 0.2 * found.rig[0]
        assert -damping / 2 > limit


@pytest.mark.parametrize("share", [0.02, -0.02])
def test_a_bound_beside_the_closed_form_of_flutter(share):
    ranges, c = [(0.3, 0.42), (40.0, 60.0)], 1.0
    truth = worst_flutter(ranges, c)
    limit = truth + share
    found = certify(spread(ranges, lambda mu, k3: flutter(mu, k3, c)[0]), 2, limit)
    assert found.verdict == (PROVED if share > 0.0 else REFUTED)


@pytest.mark.parametrize(("least", "verdict"), [(0.02, PROVED), (-0.002, REFUTED)])
def test_a_worst_rig_that_lies_inside_of_the_box(least, verdict):
    found = certify(spread([(0.0, 1.0)], lambda x: oscillator(least + (x - 0.37) ** 2)), 1)
    assert found.verdict == verdict
    if verdict == REFUTED:
        assert least + (found.rig[0] - 0.37) ** 2 < 0.0


def test_a_narrow_dip_that_no_corner_and_no_middle_shows():
    found = certify(spread([(0.0, 1.0)], lambda x: oscillator(0.5 * (x - 0.3917) ** 2 - 1e-5)), 1)
    assert found.verdict == REFUTED


def test_a_mode_outside_of_the_band_may_decay_slowly_but_must_not_grow():
    def rigs(slow):
        A = np.zeros((4, 4))
        A[:2, :2] = oscillator(1.0, 400.0)
        A[2:, 2:] = oscillator(slow, 1.0)
        return A

    band = (2.0, 5.0)  # Hz; the mode of 20 rad/s is in it
    inside = certify(spread([(0.001, 0.01)], rigs), 1, -0.45, band)
    assert inside.verdict == PROVED
    assert certify(spread([(-0.01, 0.01)], rigs), 1, -0.45, band).verdict == REFUTED
    assert certify(spread([(0.001, 0.01)], rigs), 1, -0.55, band).verdict == REFUTED


def test_a_static_mode_that_becomes_unstable_far_from_the_band():
    rigs = spread([(-0.1, 1.0)], lambda k: oscillator(0.5, k))
    assert certify(rigs, 1, -0.1, (2.0, 5.0)).verdict == REFUTED


def test_double_eigenvalues_at_the_middle_of_the_box():
    for coupling in (0.0, 1.0):  # semisimple, and defective: one eigenvector

        def rigs(x, coupling=coupling):
            return np.array([[-1.0 + x, coupling], [0.0, -1.0 + x]])

        found = certify(spread([(-0.5, 0.5)], rigs), 1)
        assert found.verdict == PROVED
        assert certify(spread([(-0.5, 1.2)], rigs), 1).verdict == REFUTED


def test_a_mode_without_growth_is_no_growth():
    def rigs(damping):
        A = np.zeros((3, 3))
        A[:2, :2] = oscillator(damping)
        return A  # the third state stays where it is

    assert certify(spread([(0.1, 0.2)], rigs), 1).verdict == PROVED


def test_a_sampled_loop_is_judged_on_its_circle():
    def rigs(radius, angle):
        return radius * np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])

    period = 1e-3
    ranges = [(0.95, 0.99), (0.5, 0.7)]
    truth = np.log(0.99) / period
    assert certify(spread(ranges, rigs), 2, 0.8 * truth, period=period).verdict == PROVED
    assert certify(spread(ranges, rigs), 2, 1.01 * truth, period=period).verdict == REFUTED
    assert certify(spread([(0.95, 1.001), (0.5, 0.7)], rigs), 2, period=period).verdict == REFUTED


def test_bounds_of_a_perron_root_hold_and_decide_whether_it_is_below_one():
    rng = np.random.default_rng(1)
    B = rng.random((200, 4, 4)) ** 3
    truth = 1.0 + 1e-3 * rng.standard_normal(200)
    B *= (truth / np.abs(np.linalg.eigvals(B)).max(axis=1))[:, None, None]
    below, above = perron_bounds(B)
    largest = B.max(axis=(1, 2), keepdims=True)
    raised = np.abs(np.linalg.eigvals(B + 1e-12 * largest)).max(axis=1)  # so that no entry is zero
    assert np.all((below <= raised + 1e-14) & (above >= truth))
    assert (above < 1.0).tolist() == (truth < 1.0).tolist()
    assert (below >= 1.0).tolist() == (truth >= 1.0).tolist()


def test_a_matrix_with_a_kink_is_not_judged():
    found = certify(lambda u: oscillator(0.1 + abs(u[0] - 0.3)), 1)
    assert found.verdict == UNDECIDED
    assert "no smooth function" in found.why


def test_boxes_are_limited_and_what_is_left_is_said():
    found = certify(spread([(0.1, 0.3), (1.0, 1.5)], oscillator), 2, -0.0499999, most=20)
    assert found.verdict == UNDECIDED
    assert found.boxes == 20
    assert found.left > 0
    assert 0.0 <= found.share < 1.0


def test_a_value_without_influence_changes_no_verdict():
    assert certify(lambda u: oscillator(0.1), 1).verdict == PROVED
    assert certify(lambda u: oscillator(-0.1), 1).verdict == REFUTED
    found = certify(spread([(0.0, 1.0), (0.1, 0.3)], lambda _, damping: oscillator(damping)), 2, -0.0499)
    assert found.verdict == PROVED


def test_random_boxes_are_never_judged_wrongly():
    chance = np.random.default_rng(5)
    verdicts = set()
    for _ in range(12):
        base = chance.normal(size=(4, 4)) - 2.2 * np.eye(4)
        changes = 0.4 * chance.normal(size=(2, 4, 4))

        def rigs(u, base=base, changes=changes):
            return base + (u[0] - 0.5) * changes[0] + (u[1] - 0.5) * changes[1] + u[0] * u[1] * 0.1 * changes[0]

        found = certify(rigs, 2, most=200)
        tried = [np.linalg.eigvals(rigs(u)).real.max() for u in chance.random((300, 2))]
        verdicts.add(found.verdict)
        if found.verdict == PROVED:
            assert max(tried) < 0.0
        elif found.verdict == REFUTED:
            assert np.linalg.eigvals(rigs(found.rig)).real.max() > 0.0
    assert {PROVED, REFUTED} <= verdicts


SHUNT = {"shunt.resistance": "5 ohm:300 ohm", "shunt.inductance": (3.6e-3, 59e-3), "shunt.delta": (-0.85, -0.2)}
STACK = {"friction.mu": "+-2 %", "piezo.capacitance": "+-5 %", "shunt.delta": "+-5 %", "shunt.inductance": "+-5 %"}


def shunted(resistance, inductance, delta):
    """The matrices of the brake with a shunt over the box of the stack."""
    scene = lab.load("brake_shunt", {"shunt.connected": True})
    values = box(scene, SHUNT, STACK)
    growth = Growth(scene, values, "modes.growth", (2000.0, 5000.0))
    x = values.at({"shunt.resistance": resistance, "shunt.inductance": inductance, "shunt.delta": delta})
    return growth, x


@pytest.mark.slow
def test_no_rig_of_the_robust_shunt_grows():
    growth, x = shunted(16.494, 12.40309e-3, -0.8074014)
    found = certify(lambda u: growth.matrix(x, u).A, 4, band=growth.band)
    assert found.verdict == PROVED
    assert found.boxes < 2500
    assert found.error < 1e-11


def test_the_nominally_best_shunt_is_refuted():
    growth, x = shunted(40.56493, 11.26792e-3, -0.85)
    found = certify(lambda u: growth.matrix(x, u).A, 4, band=growth.band, most=2500)
    assert found.verdict == REFUTED
    assert growth.value(x, found.rig)[0] > 0.0


def test_two_dampers_hold_for_every_contact():
    scene = lab.load("two_dof", {"spring_1.damping": 0.29823, "spring_2.damping": 0.30177, "spring_1.stiffness": 130.0})
    growth = Growth(scene, box(scene, {}, {"friction.mu": "+-20 %", "contact.stiffness": "+-20 %"}))
    x = np.zeros(0)
    found = certify(lambda u: growth.matrix(x, u).A, 2, -0.07)  # its worst rig decays with 0.140 1/s
    assert found.verdict == PROVED
    assert certify(lambda u: growth.matrix(x, u).A, 2, -0.145).verdict == REFUTED
