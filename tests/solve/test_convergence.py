"""How the error falls with the step and with the tolerance: the order that each method claims."""

import numpy as np
import pytest

from rig.model import friction_law
from rig.solve import dopri5, rk4


@pytest.fixture(scope="module")
def sliding(rigs):
    """A mass that slides all the time under a falling law: smooth motion."""
    return rigs.oscillator(
        law=friction_law.stribeck(0.4, 0.25, 0.02), start={"x": 0.0025, "x'": 0.01}, vb=0.2, c=1.0
    ).system()


def order(sizes, errors):
    return np.polyfit(np.log(sizes), np.log(errors), 1)[0]


@pytest.mark.parametrize(
    ("rows", "c", "weights"),
    [
        (dopri5.A, dopri5.C, [(dopri5.B, 5), (np.subtract(dopri5.B, dopri5.E), 4)]),
        (rk4.A, (0.0, 0.5, 0.5, 1.0), [(np.array(rk4.WEIGHTS) / 6.0, 4)]),
    ],
    ids=["dopri5", "rk4"],
)
def test_the_tables_have_the_orders_of_the_book(rows, c, weights):
    c, A = np.array(c), np.array([[*row, *[0.0] * (len(rows) - len(row))] for row in rows])
    assert A.sum(axis=1) == pytest.approx(c, abs=1e-15)
    for b, order in weights:
        for power in range(order):
            assert b @ c**power == pytest.approx(1.0 / (power + 1), abs=1e-14)
            if power + 2 <= order:
                assert b @ A @ c**power == pytest.approx(1.0 / ((power + 1) * (power + 2)), abs=1e-14)


def test_the_dense_output_of_dopri5_is_of_fourth_order_everywhere():
    c, b = np.array(dopri5.C), np.array(dopri5.B)
    first, last = np.eye(7)[[0, 6]]
    for at in (0.1, 0.5, 0.8):
        bulge = first - b
        inside = at * (b + (1.0 - at) * (bulge + at * (b - last - bulge + (1.0 - at) * np.array(dopri5.D))))
        for power in range(4):
            assert inside @ c**power == pytest.approx(at ** (power + 1) / (power + 1), abs=1e-14)


def test_rk4_is_of_fourth_order_in_smooth_motion(run, sliding):
    exact = run(sliding, 1.0, 1.0, "dopri5", tolerance=1e-13)
    assert len(exact.times) == 0
    steps = [4.0, 2.0, 1.0, 0.5, 0.25]
    errors = [abs(run(sliding, h, 1.0, "rk4").states[-1, 0] - exact.states[-1, 0]) for h in steps]
    assert order(steps, errors) == pytest.approx(4.0, abs=0.1)


def test_substeps_of_rk4_are_steps(run, sliding):
    fine = run(sliding, 1.0, 1.0, "rk4").states[-1]
    within = run(sliding, 8.0, 1.0, "rk4", substeps=8).states[-1]
    assert within == pytest.approx(fine, rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("name", ["P1", "P2"])
def test_rk4_keeps_its_order_over_events(rigs, run, num, name):
    steps = [4.0, 2.0, 1.0, 0.5, 0.25]
    system = rigs.p1() if name == "P1" else rigs.p2()
    errors = [np.abs(run(system, h, 4.0, "rk4").times - num[name]["events"]).max() for h in steps]
    assert order(steps, errors) == pytest.approx(4.0, abs=0.25)


def test_steps_of_dop853_grow_as_the_eighth_root_of_the_tolerance(rigs, run):
    """And at 1e-11 they are several times as long as those of dopri5."""
    p2, tolerances = rigs.p2(), [1e-7, 1e-9, 1e-11]
    trials = [run(p2, 1.0, 4.0, "dop853", tolerance=t).motion.counts()["trial_steps"] for t in tolerances]
    assert order(tolerances, trials) == pytest.approx(-0.125, abs=0.04)
    assert 3 * trials[-1] < run(p2, 1.0, 4.0, "dopri5", tolerance=1e-11).motion.counts()["trial_steps"]


def test_error_of_dopri5_is_proportional_to_its_tolerance(rigs, run, num):
    tolerances = 10.0 ** -np.arange(4.0, 11.0)
    found = [run(rigs.p2(), 1.0, 4.0, "dopri5", tolerance=t) for t in tolerances]
    errors = [np.abs(f.times - num["P2"]["events"]).max() / num["P2"]["period"] for f in found]
    assert order(tolerances, errors) == pytest.approx(1.0, abs=0.15)
    assert np.all(errors < 10.0 * tolerances)


def test_steps_of_dopri5_grow_as_the_fifth_root_of_the_tolerance(rigs, run):
    trials = [
        run(rigs.p2(), 1.0, 4.0, "dopri5", tolerance=t).motion.counts()["trial_steps"] for t in (1e-7, 1e-9, 1e-11)
    ]
    assert order([1e-7, 1e-9, 1e-11], trials) == pytest.approx(-0.2, abs=0.03)


def test_dopri5_gives_the_same_between_any_ticks(rigs, run):
    """Steps are not cut at ticks: a fine sample step costs nothing but its output."""
    coarse, fine = run(rigs.p2(), 20.0, 4.0, "dopri5"), run(rigs.p2(), 0.02, 4.0, "dopri5")
    assert fine.motion.counts()["trial_steps"] <= coarse.motion.counts()["trial_steps"] + 5
    assert fine.states[999::1000] == pytest.approx(coarse.states, abs=2e-7)
