"""Branches of cycles: known numbers, kinds of special points, going on after an interruption, what is refused."""

import json
import math
import shutil
import subprocess
import time
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import KDTree

import rig as lab
from rig.analysis.branches import Branches, Threshold, branches, curves, job
from rig.analysis.branches.begin import Start
from rig.analysis.cycles.cycle import stuck
from rig.analysis.cycles.return_map import Family
from rig.analysis.linear.modes import at_rest
from rig.analysis.map.job import RUNS
from rig.analysis.map.steady_state import STICK_SLIP
from rig.analysis.recorded.stick_speeds import upper_speed
from rig.errors import SceneError, UsageError
from rig.scenes.axis import Axis
from rig.stability.linearisation import steady

BSTAB = {
    "body.mass": "1 kg",
    "body.stiffness": "1 N/m",
    "body.damping": "0.1 N*s/m",
    "load.force": "1 N",
    "friction.mu_static": 1.0,
    "friction.mu_dynamic": 0.5,
    "friction.speed_scale": "0.5 m/s",
    "drive.speed": "1.5 m/s",
    "limits": "none",
}
"""The friction oscillator of bSTAB (Stender, Hoffmann 2022)."""
RPM = math.pi / 30.0
CLOSED = 1e-9


def followed(folder, scene, over, start=("hopf",), **changes) -> Branches:
    loaded = lab.load(scene, {"limits": "none", **changes})
    result = branches(job(loaded, over, None, start), folder)
    assert max((p.residual for *_, p in result.points()), default=0.0) <= CLOSED
    return result


@pytest.fixture(scope="module")
def bstab(tmp_path_factory) -> Branches:
    return followed(tmp_path_factory.mktemp("bstab"), "belt", "drive.speed=0.1 m/s:2.5 m/s", **BSTAB)


def test_hopf_point_and_grazing_fold_of_a_known_oscillator_from_both_sides(bstab, tmp_path):
    assert bstab.special("hopf") == [pytest.approx(0.5 * math.log(10.0), abs=1e-12)]
    assert bstab.special("grazing") == [pytest.approx(1.836600972198, abs=1e-8)]
    from_stick = followed(tmp_path, "belt", "drive.speed=0.5 m/s:2.5 m/s", (0.7,), **BSTAB)
    assert from_stick.special("grazing") == [pytest.approx(1.836600972198, abs=1e-8)]
    assert all(special.turns for special in (*bstab.specials, *from_stick.specials) if special.kind == "grazing")
    slip = [p for *_, p in bstab.points() if p.stick == 0.0 and p.period == p.period]
    stick = [p for *_, p in bstab.points() if p.stick > 0.0]
    assert not any(p.stable for p in slip)
    assert all(p.stable for p in stick)


def test_multipliers_are_those_of_the_variational_equation(bstab):
    """exp of the integral of the divergence over the unstable cycle, which an independent integrator computes."""
    from scipy.integrate import solve_ivp

    for number, _, point in bstab.points():
        if number == 1 and point.value > 1.3:
            V = point.value

            def rate(_, y, V=V):
                slope = -math.exp(-(V - y[1]) / 0.5)
                return [y[1], -y[0] - 0.1 * y[1] + 0.5 + 0.5 * math.exp(-(V - y[1]) / 0.5), -0.1 - slope]

            start = [point.state["x"], point.state["x'"], 0.0]
            run = solve_ivp(rate, (0.0, point.period), start, method="DOP853", rtol=1e-12, atol=1e-13)
            assert run.y[:2, -1] == pytest.approx(start[:2], abs=1e-8)
            assert point.multipliers[0].real == pytest.approx(math.exp(run.y[2, -1]), abs=1e-8)


def test_stick_slip_without_damping_agrees_with_its_closed_form_over_three_decades(tmp_path):
    result = followed(tmp_path, "belt_c", "drive.speed=0.0026 m/s:2 m/s", (0.06,))
    drop, omega = (0.4 - 0.25) * 20.0 / 2500.0, math.sqrt(2500.0 / 5.0)
    points = [p for *_, p in result.points() if p.stick]
    assert {min(p.value for p in points), max(p.value for p in points)} == {0.0026, 2.0}
    for p in points:
        period = 2.0 * drop / p.value + 2.0 / omega * (math.pi - math.atan(omega * drop / p.value))
        assert p.period == pytest.approx(period, rel=1e-10)


@pytest.mark.parametrize(
    ("scene", "over", "start", "kind", "values", "within"),
    [
        ("belt_c_damped", "drive.speed=0.05 m/s:0.2 m/s", 0.06, "jump", [0.0779534596], 1e-9),
        ("pendulum", "drive.speed=0.5 rad/s:5 rad/s", "hopf", "hopf", [1.0397208], 1e-7),
        ("pendulum", "drive.speed=0.5 rad/s:5 rad/s", "hopf", "grazing", [3.3751638], 1e-7),
        ("lever", "drive.speed=1.5 rpm:8 rpm", "hopf", "hopf", [2.034443 * RPM], 1e-6 * RPM),
        ("lever", "drive.speed=1.5 rpm:8 rpm", "hopf", "grazing", [5.6082372 * RPM], 1e-7 * RPM),
    ],
)
def test_special_points(tmp_path_factory, scene, over, start, kind, values, within):
    result = followed(tmp_path_factory.getbasetemp() / "shared", scene, over, (start,))
    assert result.special(kind) == pytest.approx(values, abs=within)


@pytest.mark.slow
def test_a_grazing_beside_a_steep_law_is_the_same_from_both_sides(tmp_path):
    """There the slip speed bends within a tick, and the cycles that slip have a multiplier of 434."""
    starts = (("hopf", "2 rpm"), (5.0 * RPM, "4.9 rpm"))
    for start, low in starts:
        result = followed(tmp_path, "lever", f"drive.speed={low}:9 rpm", (start,), **{"load.force": 30.0})
        assert result.special("grazing") == [pytest.approx(7.50164786 * RPM, rel=2e-10)]
        assert {special.turns for special in result.specials if special.kind == "grazing"} == {True}
        assert {branch.name for branch in result.branches} == {"sliding", "slip", "stick-slip: contact"}


def test_the_jump_of_a_tip_is_its_upper_critical_speed(tmp_path):
    scene = lab.load("tip", {"waviness": "none"})
    result = followed(tmp_path, "tip", "drive.speed=0.03 m/s:0.2 m/s", (0.05,), waviness="none")
    assert result.special("jump") == [pytest.approx(upper_speed(scene.parameters), rel=1e-9)]


def test_a_linear_rig_lifts_off_lands_and_reverses(tmp_path):
    result = followed(tmp_path, "two_dof", "friction.mu=0.3:1.15", ("hopf", 0.58))
    [hopf] = result.special("hopf")
    assert result.special("lift-off") == [pytest.approx(hopf, abs=1e-8)]
    assert result.special("begin of reversal") == [pytest.approx(1.115035365, abs=1e-8)]
    assert {event for b in result.branches for event in b.events} >= {"load opens", "load closes", "contact slip ends"}
    for _, branch, point in result.points():  # what simulation settles to
        if branch.events and 0.9 < point.value < 1.0:
            cycle = lab.limit_cycle(lab.load("two_dof", {"limits": "none", "friction.mu": point.value}))
            assert cycle.period == pytest.approx(point.period, rel=1e-8)
            break
    else:
        pytest.fail("no lift-off between 0.9 and 1")


@pytest.mark.parametrize("damping", [0.0, 1e-6, 1e-3])
def test_the_accuracy_of_a_hopf_point_counts_the_rounding_of_its_eigenvalue(tmp_path, damping):
    """Where two eigenvalues meet, rounding moves them far. Exact: Hurwitz determinant of the two masses' equations."""
    from scipy.optimize import brentq

    changes = {"limits": "none", "spring_1.damping": damping, "spring_2.damping": damping}

    def hurwitz(mu):
        K, C = (
            -at_rest(lab.load("two_dof", {**changes, "friction.mu": mu}))[1].A[2:4, cut]
            for cut in (np.s_[:2], np.s_[2:4])
        )
        a, b = np.trace(C), np.trace(K) + np.linalg.det(C)
        c, e = K[0, 0] * C[1, 1] + K[1, 1] * C[0, 0] - K[0, 1] * C[1, 0] - K[1, 0] * C[0, 1], np.linalg.det(K)
        return a * b * c - c**2 - a**2 * e if damping else b**2 - 4.0 * e

    [hopf] = branches(job(lab.load("two_dof", changes), "friction.mu=0.3:0.5", None, ()), tmp_path).specials
    assert abs(hopf.value - brentq(hurwitz, 0.33, 0.4, xtol=1e-15)) < hopf.accuracy < 1e-9


def grazing_fold(damping, mu_dynamic, speed_scale, low, high):
    """The belt speed at which a cycle that slips touches that of the belt, by another integrator. It attracts backwards
    in time: from the contact at rest on the belt to the largest velocity one period before.
    """
    from scipy.integrate import solve_ivp
    from scipy.optimize import brentq

    def rate(_, y, V):
        mu = mu_dynamic + (0.5 - mu_dynamic) * math.exp(-(V - y[1]) / speed_scale)
        return [y[1], (20.0 * mu - damping * y[1] - 2500.0 * y[0]) / 5.0]

    def highest(t, y, V):
        return rate(t, y, V)[1]

    def slip(V):
        tight = {"method": "DOP853", "args": (V,), "rtol": 3e-14, "atol": 1e-18, "max_step": 1e-3}
        start = solve_ivp(rate, (0.0, -0.02), [(10.0 - damping * V) / 2500.0, V], **tight).y[:, -1]
        run = solve_ivp(rate, (-0.02, -0.35), start, events=highest, **tight)
        return V - run.y_events[0][np.abs(run.t_events[0] + 0.284).argmin()][1]

    return brentq(slip, low, high, xtol=1e-15, rtol=1e-14)


@pytest.mark.parametrize(
    ("damping", "mu_dynamic", "speed_scale", "multiplier"),
    [
        (5.0, 0.3, 0.002, 1e3),
        pytest.param(12.0, 0.3, 0.001, 1e8, marks=pytest.mark.slow),
        (10.0, 0.3, 0.0007, 1e10),
        pytest.param(1.4853763, 0.2266738, 0.0019961, 3e2, marks=pytest.mark.slow),
        pytest.param(11.4, 0.231, 0.001982, 1e3, marks=pytest.mark.slow),
        (1.54, 0.407, 0.005922, 1.0),
        pytest.param(1.3, 0.204, 0.003134, 1.0, marks=pytest.mark.slow),
    ],
)
def test_a_grazing_fold_is_passed_whatever_its_multiplier(tmp_path, damping, mu_dynamic, speed_scale, multiplier):
    """Its value, with the accuracy that is stated, is that of an independent integration."""
    changes = {"friction.mu_dynamic": mu_dynamic, "friction.speed_scale": speed_scale, "body.damping": damping}
    result = followed(tmp_path, "belt", "drive.speed=0.002 m/s:0.8 m/s", ("hopf", 0.02), **changes)
    assert [branch.name for branch in result.branches] == ["sliding", "slip", "stick-slip: contact"]
    assert {p.largest_multiplier for *_, p in result.points() if p.stick} == {0.0}
    assert max(p.largest_multiplier for *_, p in result.points() if p.period == p.period) > multiplier
    [fold] = [special for special in result.specials if special.kind == "grazing"]
    assert fold.turns
    exact = grazing_fold(damping, mu_dynamic, speed_scale, 0.997 * fold.value, 1.003 * fold.value)
    assert abs(fold.value - exact) < fold.accuracy < 1e-8 * exact


def test_multipliers_hold_where_the_return_map_bends(tmp_path):
    """Of cycles that touch nearly the speed of the belt, beside the integral of the divergence."""
    from scipy.integrate import solve_ivp

    changes = {"friction.mu_dynamic": 0.3, "friction.speed_scale": 0.003, "body.damping": 5.0}
    result = followed(tmp_path, "belt", "drive.speed=0.05 m/s:0.8 m/s", **changes)
    points = [p for *_, p in result.points() if p.period == p.period and not p.stick]
    for p in points[-6:]:

        def rate(_, y, V=p.value):
            fall = 0.2 * math.exp(-(V - y[1]) / 0.003)
            force = 20.0 * (0.3 + fall) - 5.0 * y[1] - 2500.0 * y[0]
            return [y[1], force / 5.0, (20.0 * fall / 0.003 - 5.0) / 5.0]

        start = [p.state["x"], p.state["x'"], 0.0]
        tight = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-16}
        closed = solve_ivp(rate, (p.period, 0.0), start, **tight).y[:2, -1]
        run = solve_ivp(rate, (p.period, 0.0), [*closed, 0.0], **tight)
        assert p.multipliers[0].real == pytest.approx(math.exp(-run.y[2, -1]), rel=p.multiplier_accuracy)
        assert p.multiplier_accuracy < 1e-8


def test_multipliers_are_those_of_the_cycle_where_a_run_leaves_it(tmp_path):
    """A motion that misses its start by 1e-10 and departs a thousandfold is not the cycle, which backwards attracts."""
    from scipy.integrate import solve_ivp

    mass, stiffness, damping, load, static, kinetic, decay = 3.43, 1676.0, 4.85, 16.0, 0.766, 0.281, 220.0
    friction = {"law": "exponential", "mu_static": static, "mu_kinetic": kinetic, "decay": decay}
    changes = {"body.mass": mass, "body.stiffness": stiffness, "body.damping": damping, "load.force": load}
    result = followed(tmp_path, "belt", "drive.speed=0.02 m/s:0.3 m/s", ("hopf",), friction=friction, **changes)
    points = [p for *_, p in result.points() if p.period == p.period and not p.stick]
    assert max(p.largest_multiplier for p in points) > 1e4
    for p in points[::3]:

        def rate(_, y, V=p.value):
            fall = load * (static - kinetic) * math.exp(-decay * (V - y[1]))
            force = load * kinetic + fall - damping * y[1] - stiffness * y[0]
            return [y[1], force / mass, (fall * decay - damping) / mass]

        run = [p.state["x"], p.state["x'"], 0.0]
        for _ in range(2):
            back = solve_ivp(rate, (p.period, 0.0), [*run[:2], 0.0], method="DOP853", rtol=2.3e-14, atol=1e-18)
            run = back.y[:, -1]
        away = abs(p.multipliers[0].real / math.exp(-run[2]) - 1.0)
        assert away < min(p.multiplier_accuracy, 1e-9)


@pytest.mark.slow
def test_multipliers_beside_a_canard_hold_to_the_accuracy_that_is_stated(tmp_path):
    """Cycles whose parameter is the same to seven digits, and whose multiplier grows a thousandfold."""
    from scipy.integrate import solve_ivp

    mass, stiffness, damping, load, static, dynamic, scale = 1.16, 1690.0, 195.3, 39.33, 0.8808, 0.5835, 0.02412
    changes = {"body.mass": mass, "body.stiffness": stiffness, "body.damping": damping, "load.force": load}
    changes |= {"friction.mu_static": static, "friction.mu_dynamic": dynamic, "friction.speed_scale": scale}
    result = followed(tmp_path, "belt", "drive.speed=0.0066 m/s:0.13 m/s", **changes)
    points = [p for *_, p in result.points() if p.period == p.period and not p.stick]
    assert max(p.largest_multiplier for p in points) > 3e3
    for p in points:

        def rate(_, y, V=p.value):
            fall = load * (static - dynamic) * math.exp(-(V - y[1]) / scale)
            force = load * dynamic + fall - damping * y[1] - stiffness * y[0]
            return [y[1], force / mass, (fall / scale - damping) / mass]

        ends = (p.period, 0.0) if p.largest_multiplier > 1.0 else (0.0, p.period)
        start = [p.state["x"], p.state["x'"], 0.0]
        run = solve_ivp(rate, ends, start, method="DOP853", rtol=2.3e-14, atol=1e-18)
        multiplier = math.exp(run.y[2, -1] if ends[0] == 0.0 else -run.y[2, -1])
        away = abs(p.multipliers[0].real - multiplier) / max(1.0, multiplier)
        assert away < p.multiplier_accuracy < 1e-7
        assert away < 1e-8


def test_multipliers_hold_where_a_motion_is_small_beside_the_mean_of_its_states(tmp_path):
    """Beside a Hopf point, of a drawn rig: rounding of the states is a large part of small differences."""
    from scipy.integrate import solve_ivp

    mass, stiffness, load, static, dynamic, scale = 1.12, 864.0, 29.4, 0.476, 0.266, 0.0572
    hopf = 0.713 * scale
    damping = load * (static - dynamic) / scale * math.exp(-hopf / scale)
    changes = {"body.mass": mass, "body.stiffness": stiffness, "body.damping": damping, "load.force": load}
    changes |= {"friction.mu_static": static, "friction.mu_dynamic": dynamic, "friction.speed_scale": scale}
    result = followed(tmp_path, "belt", f"drive.speed={0.3 * hopf} m/s:{6.0 * hopf} m/s", **changes)
    points = [p for *_, p in result.points() if p.period == p.period and not p.stick]
    assert len(points) > 20
    for p in points:

        def rate(_, y, V=p.value):
            fall = load * (static - dynamic) * math.exp(-(V - y[1]) / scale)
            force = load * dynamic + fall - damping * y[1] - stiffness * y[0]
            return [y[1], force / mass, (fall / scale - damping) / mass]

        start = [p.state["x"], p.state["x'"], 0.0]
        run = solve_ivp(rate, (0.0, p.period), start, method="DOP853", rtol=1e-13, atol=1e-17)
        assert p.multipliers[0].real == pytest.approx(math.exp(run.y[2, -1]), rel=5e-9)
        assert p.multiplier_accuracy < 1e-8


@pytest.mark.parametrize("seed", range(4))
def test_a_rig_that_is_nearly_linear_has_no_fold_beside_its_hopf_point(tmp_path, seed):
    """Of drawn rigs, cycles of all sizes up to the grazing one have parameters that are equal to many digits."""
    chance = np.random.default_rng(seed)
    scale, hopf = 10.0 ** chance.uniform(0.5, 1.5), 10.0 ** chance.uniform(-1.5, -0.5)
    drop = chance.uniform(0.4, 0.7)
    changes = {"friction.mu_static": 0.3 + drop, "friction.mu_dynamic": 0.3, "friction.speed_scale": scale}
    changes["body.damping"] = 20.0 * drop / scale * math.exp(-hopf / scale)
    result = followed(tmp_path, "belt", f"drive.speed={0.5 * hopf} m/s:{2.0 * hopf} m/s", **changes)
    assert [special.kind for special in result.specials] == ["hopf", "grazing"]


def test_cycles_between_two_hopf_points_are_followed_once(tmp_path):
    """Where friction falls within a range of speeds alone; each special point is told once."""
    friction = {"law": "stribeck_viscous", "mu_static": 0.8, "mu_dynamic": 0.3, "speed_scale": 0.4}
    result = followed(
        tmp_path, "belt", "drive.speed=0.1 m/s:0.6 m/s", ("hopf",), friction=friction, **{"body.damping": 17.0}
    )
    assert [branch.name for branch in result.branches] == ["sliding", "slip", "stick-slip: contact", "slip"]
    assert [special.kind for special in result.specials] == ["hopf", "grazing", "grazing", "hopf"]
    hopf = result.special("hopf")
    for value in hopf:  # the damping is N times the slope of the law
        assert 20.0 * 0.5 * 2.0 * value / 0.16 * math.exp(-((value / 0.4) ** 2)) == pytest.approx(17.0, rel=1e-10)
    again = replace(result.branches[-1].end, value=hopf[0] * (1.0 + 1e-10), accuracy=1e-9)
    twice = replace(result, branches=(*result.branches, replace(result.branches[1], end=again)))
    assert len(twice.specials) == 4


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("recorded") / "belt.mcap"
    lab.simulate(lab.load("belt", {"limits": "none"}), 2.0).save(path)
    return path


@pytest.mark.parametrize("begin", ["recording", "folder of a map", "map"])
def test_branches_begin_from_recordings_and_maps(tmp_path, recording, begin):
    start = recording
    if begin != "recording":
        lab_map = lab.map("belt", "drive.speed=0.3:0.4:2", runs=("far",), out=tmp_path / "maps", workers=1)
        (lab_map.folder / "map.csv").write_text(lab_map.csv())  # as the command does
        start = lab_map if begin == "map" else lab_map.folder
    lowest = "0.06" if begin == "recording" else "0.25"  # the recorded speed is the end of the range
    result = followed(tmp_path, "belt", f"drive.speed={lowest} m/s:0.8 m/s", (start,))
    assert result.special("grazing") == [pytest.approx(0.675032752, abs=1e-8)]
    assert {branch.name for branch in result.branches} == {"sliding", "stick-slip: contact", "slip"}
    assert not result.notes
    assert min(len(branch.points) for branch in result.branches) > 2, "a branch leaves the range at once"


@pytest.mark.parametrize(
    ("scene", "changes", "over", "words"),
    [
        ("lever", {}, "drive.speed=1:8 rpm", "is of belt with the plant belt, and lever has lever"),
        ("belt", {"load.force": 15.0}, "drive.speed=0.05:0.8 m/s", "load.force = 20.0 there, 15.0 here"),
        ("belt", {}, "drive.speed=0.1:0.8 m/s", "outside of the range"),
    ],
)
def test_recordings_of_other_rigs_are_refused(recording, scene, changes, over, words):
    with pytest.raises(UsageError, match=words):
        job(lab.load(scene, changes), over, None, (recording,))


def test_an_interrupted_computation_goes_on_from_its_last_point(tmp_path, monkeypatch):
    import rig.analysis.branches.compute as compute

    todo = job(lab.load("belt_c", {"limits": "none"}), "drive.speed=0.03 m/s:0.3 m/s", None, (0.06,))
    whole = branches(todo, tmp_path / "whole")
    monkeypatch.setattr(compute, "SAVE", 0.0)
    said: list[str] = []

    def stop(text):
        said.append(text)
        if len(said) == 12:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        branches(todo, tmp_path / "parts", stop)
    again: list[str] = []
    result = branches(todo, tmp_path / "parts", again.append)
    assert len(again) < len(list(whole.points()))
    for (_, a, p), (_, b, q) in zip(whole.points(), result.points(), strict=True):
        assert (a.kind, a.events) == (b.kind, b.events)
        assert p.value == pytest.approx(q.value, rel=1e-6)
    assert branches(todo, tmp_path / "parts", again.append).to_json()["specials"] == result.to_json()["specials"]


def test_every_form_of_the_result(bstab):
    told = json.loads(json.dumps(bstab.to_json()))
    assert [s["kind"] for s in told["specials"]] == ["hopf", "grazing"]
    assert "grazing fold (contact)" in bstab.text()
    data = bstab.to_xarray()
    assert data.sizes["point"] == len(list(bstab.points())) == len(bstab.csv().splitlines()) - 1
    assert data["drive.speed"].attrs["units"] == "m/s"
    assert bool((data.low <= data.high).all())
    assert (np.isnan(data.multiplier) == np.isnan(data.period)).all()  # eigenvalues of sliding are none
    axes = bstab.plot().get_axes()[0]
    legend = {text.get_text() for text in axes.get_legend().get_texts()}
    assert {"stable", "unstable", "steady sliding", "cycle without stick"} <= legend
    assert {"Hopf point: 1.1513 m/s", "grazing fold: 1.8366 m/s"} <= legend
    assert "<img" in bstab._repr_html_()


@pytest.mark.parametrize(
    ("scene", "changes", "over", "words"),
    [
        ("plate", {}, "drive.speed=0.1:0.2 m/s", "not defined for a film"),
        ("tip", {}, "drive.speed=0.05:0.2 m/s", "waviness=none"),
        ("lever_sector", {}, "drive.speed=1:2 rpm", "uneven"),
        ("belt", {}, "drive.speed=0.2:0.2 m/s", "the ends are the same"),
        ("belt", {}, "drive.speed=-0.1:0.2 m/s", "direction"),
        ("belt", {}, "drive.speed=0.1", "expected KEY=FROM:TO"),
        ("belt", {}, "drive.sped=0.1:0.2 m/s", "drive.speed"),
        ("lever", {}, "springs.order=2:5", "not a numeric parameter"),
        ("belt", {"clock.method": "rk4"}, "drive.speed=0.1:0.2 m/s", "clock.method"),
        ("belt", {}, "start.displacement=0.001:0.002 m", "start.displacement acts on no steady motion"),
        ("belt", {}, "drive.speed_max=1:1.1 m/s", "drive.speed_max acts on no steady motion"),
    ],
)
def test_what_cannot_be_followed_is_said(scene, changes, over, words):
    with pytest.raises((UsageError, SceneError), match=words):
        job(lab.load(scene, changes), over)


def test_a_rig_whose_drive_lags_has_the_branches_of_one_that_does_not(tmp_path):
    result = followed(tmp_path, "belt", "drive.speed=0.2 m/s:0.8 m/s", **{"drive.lag": "10 ms"})
    assert result.special("grazing") == [pytest.approx(0.675032752, abs=1e-8)]


def test_a_law_with_memory_is_followed(tmp_path):
    """The cycles of bristles slip in both directions and never stick."""
    result = followed(tmp_path, "belt_lugre", "drive.speed=0.2 m/s:0.22 m/s", ("hopf", 0.215))
    assert {branch.name for branch in result.branches} == {"sliding", "slip", "reversal: contact"}
    cycle = lab.limit_cycle(lab.load("belt_lugre", {"limits": "none", "drive.speed": 0.2}))
    [point] = [p for *_, p in result.points() if p.stable and p.value == 0.2 and p.period == p.period]
    assert point.period == pytest.approx(cycle.period, rel=1e-8)


def test_the_old_name_points_to_both_new_ones():
    with pytest.raises(AttributeError, match=r"rig\.fork.*rig\.branches"):
        lab.branch("run.mcap")


def test_rest_in_stick_is_an_interval(tmp_path):
    result = followed(tmp_path, "belt_c", "load.force=10 N:30 N", (), **{"drive.speed": 0.0, "start.velocity": 0.0})
    [rest] = [branch for branch in result.branches if branch.kind == "rest in stick"]
    for point in rest.points:
        assert np.array([point.low, point.high]) == pytest.approx(np.array([-1.0, 1.0]) * 0.4 * point.value / 2500.0)


def distance(curve, start):
    """The distance of a start from a closed curve of chords."""
    a = curve[:-1]
    chords = np.diff(curve, axis=0)
    share = np.clip(np.sum((start - a) * chords, axis=1) / np.sum(chords**2, axis=1), 0.0, 1.0)
    return np.linalg.norm(a + share[:, None] * chords - start, axis=1).min()


def test_the_unstable_cycle_divides_the_starts(bstab):
    """1 start in 100 is simulated, and the nearest to the threshold: only within 1e-6 of it may both differ."""
    edge = Threshold(bstab, 1.5)
    starts = edge.drawn({"x": (-2.0, 2.0), "x'": (0.0, 2.0)}, 4000)
    begin = time.process_time()
    inside = edge.inside(starts)
    assert time.process_time() - begin < 2.0
    size = np.ptp(edge.curve, axis=0)
    nearest = KDTree(edge.curve / size).query(starts / size)[0].argsort()[:8]
    for i in {*range(0, 4000, 100), *nearest.tolist()}:
        assert edge.slides(starts[i]) == inside[i] or distance(edge.curve / size, starts[i] / size) < 1e-6
    there, back = edge.knocks()
    assert there.confirmed
    assert back.confirmed
    assert (there.back, back.back) == (False, True)


@pytest.mark.parametrize(
    ("speed", "published"),
    [
        (1.175, 0.0126),
        (1.25, 0.0838),
        (1.325, 0.1378),
        (1.4, 0.211),
        (1.475, 0.2824),
        (1.5, 0.312),
        (1.55, 0.3636),
        (1.625, 0.4336),
        (1.7, 0.4912),
        (1.775, 0.5552),
    ],
)
def test_shares_of_starts_are_those_of_others(bstab, speed, published):
    """bSTAB, 4000 starts each: intervals of 99.9 % of the difference of two draws."""
    share = Threshold(bstab, speed).share({"x": (-2.0, 2.0), "x'": (0.0, 2.0)}, 4000)
    error = math.sqrt(published * (1.0 - published) / 4000 + share.slides * (1.0 - share.slides) / 4000)
    assert abs(share.slides - published) < 3.29 * error


def test_a_study_of_random_starts_gives_the_share_that_comes_to_slide(bstab, tmp_path):
    """Start by start as the threshold says; all at the speeds at which only one motion attracts."""
    over = {"start.displacement": lab.uniform(-2.0, 2.0), "start.velocity": lab.uniform(0.0, 2.0)}
    for speed, least, most in ((1.1, 0.0, 0.0), (1.5, 0.1, 0.6), (1.85, 1.0, 1.0)):
        scene = lab.load("belt", {**BSTAB, "drive.speed": speed})
        study = lab.study(scene, over, ["motion.slides"], samples=30, out=tmp_path, workers=1)
        slides = study.values_of("motion.slides")
        assert least <= slides.mean() <= most
        assert f"{100.0 * slides.mean():.4g} % of 30 points come to slide" in study.text()
        if speed == 1.5:
            assert Threshold(bstab, 1.5).inside(study.points).tolist() == slides.astype(bool).tolist()


@pytest.mark.parametrize(
    ("extra", "ratio"),
    [
        pytest.param(40.0, 0.0516059, marks=pytest.mark.slow),
        (10.0, 0.0112147),
        pytest.param(5.0, 0.0055443, marks=pytest.mark.slow),
    ],
)
def test_largest_damping_with_stick_slip_of_an_example_of_others(tmp_path, extra, ratio):
    """Mass, spring and belt of exudyn's example; damping ratios by independent integration."""
    changes = {
        "body.mass": "0.5 kg",
        "body.stiffness": "400 N/m",
        "load.force": "40 N",
        "friction.mu_dynamic": 1.0,
        "friction.mu_static": 1.0 + extra / 40.0,
        "friction.speed_scale": "0.1 m/s",
        "drive.speed": "4 m/s",
        "start.velocity": "4 m/s",
    }
    critical = 2.0 * math.sqrt(400.0 * 0.5)
    low, high = 0.5 * ratio * critical, 2.0 * ratio * critical
    changes["body.damping"] = f"{low} N*s/m"
    result = followed(tmp_path, "belt", f"body.damping={low}:{high} N*s/m", (low,), **changes)
    assert result.special("grazing")[0] / critical == pytest.approx(ratio, abs=1e-6)


def test_curves_of_special_points_over_two_parameters(tmp_path):
    loaded = lab.load("belt", {**BSTAB, "limits": "none"})
    over, loads = "drive.speed=0.2 m/s:4 m/s", "load.force=0.5 N:2 N:4"
    todo, second = job(loaded, over), Axis.parse(loads, loaded)

    def stop(done, total):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        curves(todo, second, tmp_path, stop)
    again: list[int] = []
    curves(todo, second, tmp_path, lambda done, total: again.append(done))
    assert (min(again), max(again)) == (3, 4)
    result = lab.branches(loaded, over, second=loads, out=tmp_path)
    hopf, grazing = result.curves
    assert hopf.first == pytest.approx([0.5 * math.log(N / 0.1) for N in hopf.second], abs=1e-10)
    assert (grazing.first[0], grazing.first[-1]) == pytest.approx((1.06527413, 3.01258884), abs=2e-8)
    assert "grazing fold" in result.text()
    assert len(result.plot().get_axes()[0].get_lines()) == 2
    chart = lab.map(loaded, "drive.speed=1:3:2", "load.force=0.5:2:2", longest=20.0, out=tmp_path, workers=1)
    labels = {line.get_label() for line in result.over(chart).get_axes()[0].get_lines()}
    assert {"Hopf point", "grazing fold (contact)"} <= labels


@pytest.mark.parametrize("second", ["start.displacement=1 mm:2 mm:2", "drive.speed_max=1 m/s:1.1 m/s:2"])
def test_a_second_parameter_that_changes_no_motion_is_refused(tmp_path, second):
    with pytest.raises(UsageError, match=rf"--second: {second.partition('=')[0]} acts on no steady motion"):
        lab.branches("belt", "drive.speed=0.2 m/s:0.8 m/s", second=second, out=tmp_path)
    assert not [*tmp_path.iterdir()]


def test_a_threshold_beyond_the_largest_number_of_points_is_not_known(tmp_path):
    result = branches(
        job(lab.load("belt", {"limits": "none"}), "drive.speed=0.2 m/s:0.8 m/s", None, ("hopf",), 8), tmp_path
    )
    with pytest.raises(UsageError, match=r"at drive\.speed = 0.3 m/s is not known: .*\(8 points\); raise --points"):
        Threshold(result, 0.3)
    with pytest.raises(UsageError, match=r"there is no unstable cycle at drive\.speed = 0.2 m/s beside stable sliding"):
        Threshold(result, 0.2)
    with pytest.raises(UsageError, match=r"drive\.speed = 0.9 m/s lies outside of the range that is followed"):
        Threshold(result, 0.9)


def test_curves_begin_where_the_starts_say(tmp_path):
    """This stick-slip begins at no Hopf point. Under Coulomb friction motions scale with the load, so its end does."""
    loaded = lab.load("belt_c_damped", {"limits": "none"})
    over, second = "drive.speed=0.05 m/s:0.2 m/s", Axis.parse("load.force=20 N:24 N:2", loaded)
    with pytest.raises(UsageError, match="no special point lies in this range"):
        curves(job(loaded, over, None, ("hopf",)), second, tmp_path)
    [jump] = curves(job(loaded, over, None, (0.06,)), second, tmp_path).curves
    assert jump.first == pytest.approx([0.0779534596 * force / 20.0 for force in jump.second], rel=1e-8)
    assert jump.second == second.values


def test_least_knocks_are_confirmed_where_a_tick_is_a_large_part_of_a_period(tmp_path):
    result = followed(tmp_path, "belt", "drive.speed=0.2 m/s:0.8 m/s")
    there, back = Threshold(result, 0.4).knocks()
    assert there.confirmed
    assert back.confirmed
    assert abs(there.size) == pytest.approx(1.762059, rel=1e-5)
    [pulse] = Threshold(result, 0.4, "load.force 50 ms").knocks()  # no such change ends the stick-slip
    assert pulse.confirmed
    assert (pulse.size, pulse.unit) == (pytest.approx(200.45486, rel=1e-5), "N")
    for ends in ((math.nan, 1.0), (1.0, -1.0), (0.0, math.inf)):
        with pytest.raises(UsageError, match="two finite numbers, the smaller one first"):
            Threshold(result, 0.4).share({"x": ends})
    assert "no knock back" in Threshold(result, 0.675).text()  # too near to the fold
    for wrong in ("load.forc 50 ms", "load.force 50 m", "load.force", "load.force -1 s", "load.force 100 s"):
        with pytest.raises(UsageError, match=r"knock load\.forc"):
            Threshold(result, 0.4, wrong)


def test_a_threshold_in_four_dimensions_is_that_of_a_protocol_with_a_knock(tmp_path):
    """Little less leads back to sliding, little more to stick-slip: a run with its sensors and commands."""
    friction = {"law": "stribeck", "mu_static": 0.5, "mu_dynamic": 0.18, "speed_scale": 0.05}
    result = followed(tmp_path, "belt_tuned_mass", "drive.speed=0.05 m/s:0.6 m/s", friction=friction)
    edge = Threshold(result, 0.2)
    there, back = edge.knocks()
    assert not edge.planar
    assert (there.confirmed, back.confirmed, back.back) == (True, True, True)
    at_rest = edge.sliding.x[edge.rig.system.names.index("x")]
    for share, vibrates in ((0.999, False), (1.001, True)):
        (tmp_path / "knock.toml").write_text(
            'format = 1\ntitle = "A knock"\nbased_on = "belt_tuned_mass"\ndrive = { speed = "0.2 m/s" }\n'
            'friction = { law = "stribeck", mu_static = 0.5, mu_dynamic = 0.18, speed_scale = "0.05 m/s" }\n'
            f'start = {{ displacement = "{at_rest} m" }}\n[[protocol]]\nstep = "knock"\n'
            f'impulse = "{share * there.size} N*s"\n[[protocol]]\nstep = "hold"\ntime = "40 s"\n'
        )
        run = lab.simulate(lab.load(tmp_path / "knock.toml"), 40.0)
        assert bool(np.ptp(run.signals["velocity"][run.time > 35.0]) > 0.3) is vibrates


def test_stick_slip_reverses_where_the_spring_is_stronger_than_static_friction(tmp_path):
    """Where the body reaches the speed of the belt, by independent integration of the slip before it."""
    from scipy.integrate import solve_ivp
    from scipy.optimize import brentq

    result = followed(tmp_path, "belt", "drive.speed=0.05 m/s:0.8 m/s", **{"load.force": 15.0})

    def excess(V):
        def rate(_, y):
            mu = 0.18 + 0.32 * math.exp(-(V - y[1]) / 0.05)
            return [y[1], (15.0 * mu - 2.0 * y[1] - 2500.0 * y[0]) / 5.0]

        def reached(_, y):
            return V - y[1]

        reached.terminal, reached.direction = True, -1
        tight = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14}
        start = solve_ivp(rate, (0.0, 1e-4), [(7.5 - 2.0 * V) / 2500.0, V - 1e-9], **tight).y[:, -1]
        x = solve_ivp(rate, (0.0, 1.0), start, events=reached, **tight).y_events[0][0][0]
        return 2500.0 * x + 2.0 * V + 7.5

    for kind, low, high in (("begin", 0.1, 0.2), ("end", 0.25, 0.4)):  # as the speed rises
        assert result.special(f"{kind} of reversal") == [pytest.approx(brentq(excess, low, high), abs=1e-7)]


def test_a_cycle_is_followed_from_which_motions_depart_by_many_orders_of_magnitude(tmp_path):
    """Beside a steep law it stays on a repelling curve (a canard). Backwards in time an independent integrator shows
    that it closes, and the integral of the divergence is its multiplier.
    """
    from scipy.integrate import solve_ivp

    loaded = lab.load("seal_p", {"limits": "none"})
    result = branches(job(loaded, "drive.speed=4 mm/s:12 mm/s", None, ("hopf",), 62), tmp_path)
    points = [p for _, b, p in result.points() if b.kind == "cycles"]
    assert max(p.residual for p in points) <= CLOSED
    assert [p.value for p in points] == sorted(p.value for p in points)

    def rate(_, y, V):
        w = V - y[1]
        force = 9.7 / (700.0 * w + 1.0) + 37.94733192202055 * math.sqrt(w + 1e-5)
        slope = 0.5 * 37.94733192202055 / math.sqrt(w + 1e-5) - 9.7 * 700.0 / (700.0 * w + 1.0) ** 2
        return [y[1], (force - 5.0 * y[1] - 2e4 * y[0]) / 0.2, -(slope + 5.0) / 0.2]

    last = points[-1]
    start = [last.state["x"], last.state["x'"], 0.0]
    run = solve_ivp(rate, (last.period, 0.0), start, method="DOP853", args=(last.value,), rtol=1e-12, atol=1e-15)
    assert run.y[:2, -1] == pytest.approx(start[:2], abs=1e-8 * last.value)
    assert math.log(last.multipliers[0].real) == pytest.approx(-run.y[2, -1], abs=1e-4)
    assert last.multipliers[0].real > 1e8


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "low", "high"), [("seal_l", 9.15, 9.4), ("seal_p", 6.98, 7.1)])
def test_stick_slip_beside_a_steep_law_ends_at_a_canard(tmp_path, scene, low, high):
    """Motions beside it depart by many orders of magnitude and then stick, so that its multiplier is zero. It ends
    where the motion from a standing start no longer sticks, by bisection, and within the bracket of a fine map.
    """
    over, low, high = f"drive.speed={low} mm/s:{high} mm/s", 1e-3 * low, 1e-3 * high
    result = followed(tmp_path, scene, over, (low * (1.0 + 1e-9),))
    [canard] = result.special("canard")
    assert {special.kind for special in result.specials} == {"canard"}
    chart = lab.map(
        scene, f"drive.speed={canard - 4.5e-8}:{canard + 4.5e-8}:10", runs=("far",), out=tmp_path, workers=1
    )
    assert (chart.state[RUNS.index("far"), 0] == STICK_SLIP).tolist() == [True] * 5 + [False] * 5
    family = Family(lab.load(scene, {"limits": "none"}), [result.axis])
    while high - low > 1e-9 * high:
        middle = 0.5 * (low + high)
        flow = family.rig((middle,))
        settled = flow.carried(stuck(flow.system, steady(flow.system, flow.key).x), 1.5).x
        low, high = (middle, high) if flow.carried(settled, 0.2).events else (low, middle)
    assert canard == pytest.approx(low, rel=1e-8)


@pytest.mark.slow
def test_a_curve_that_begins_at_a_canard_is_told_and_the_others_are_computed(tmp_path):
    loaded = lab.load("seal_l", {"limits": "none"})
    described = job(loaded, "drive.speed=6 mm/s:12 mm/s")
    result = curves(described, Axis.parse("load.force=9 N:11 N:3", loaded), tmp_path)
    hopf, grazing = result.curves
    assert len(hopf.second) == 3
    assert grazing.second == (10.0,)
    assert grazing.first == pytest.approx([9.21649143e-3], rel=1e-8)
    assert "within less than the digits of the parameter" in grazing.why
    assert "not followed from 10" in result.text()


def test_two_contacts_that_stick_in_turn_are_followed(tmp_path):
    """At three points the motion from a standing start comes to the same cycle."""
    scene = lab.load("brake", {"limits": "none"})
    family = Family(scene, [Axis.parse("drive.speed=0.97 rpm:0.98 rpm", scene, count=2)])

    def settled(value):
        flow = family.rig((value,))
        x = stuck(flow.system, steady(flow.system, flow.key).x)
        return flow, flow.carried(x, 1.0).x

    flow, x = settled(0.98 * RPM)
    start = Start(0.98 * RPM, dict(zip(flow.system.names, x.tolist())), 0.00048058)
    result = followed(tmp_path, "brake", "drive.speed=0.97 rpm:0.98 rpm", (start,))
    assert result.special("lift-off") == [pytest.approx(0.97248035 * RPM, rel=1e-8)]
    points = sorted((p for b, _, p in result.points() if p.period == p.period), key=lambda p: p.value)
    assert {"inner_pad slip ends", "outer_pad slip ends"} <= {event for b in result.branches for event in b.events}
    for point in (points[0], points[len(points) // 2], points[-1]):
        flow, x = settled(point.value)
        on_cycle = np.array([point.state[name] for name in flow.system.names])
        ranges = [
            np.ptp(
                flow.carried(start, 40.0 * point.period, keep=True).states[:, : len(flow.system.coordinates)], axis=0
            )
            for start in (x, on_cycle)
        ]
        assert np.abs(ranges[0] - ranges[1]).max() < 0.01 * ranges[1].max()
        ends = [t for t, event in flow.carried(x, 40.5 * point.period).events if event.what == "inner_pad slip ends"]
        assert (ends[-1] - ends[0]) / (len(ends) - 1) == pytest.approx(point.period, rel=1e-6)


@pytest.mark.slow
def test_boundaries_of_a_forced_motion_are_the_same_from_both_sides(tmp_path):
    """A stick, a reversal and a grazing, passed upwards and downwards."""
    found = [
        followed(
            tmp_path, "belt_dither", f"drive.speed={low} m/s:{high} m/s", ("simulation",), **{"dither.enable": True}
        )
        for low, high in (("0.05", "0.17"), ("0.05", "0.0999"), ("0.0999", "0.09999"))
    ]
    expected = {"stick": 0.0998224704, "reversal": 0.0999534565, "grazing": 0.0999973793}
    for number, kind in (
        (0, "begin of stick"),
        (0, "end of reversal"),
        (0, "grazing"),
        (1, "begin of stick"),
        (2, "end of reversal"),
    ):
        assert found[number].special(kind) == [pytest.approx(expected[kind.split()[-1]], abs=1e-9)], (number, kind)


@pytest.mark.parametrize(
    ("scene", "changes", "over", "start", "kind", "within"),
    [
        ("tip", {"waviness": "none"}, "drive.speed=0.11 m/s:0.14 m/s", 0.115, "jump", -1e-3),
        ("tread", {}, "friction.mu=0.9:1.2", "hopf", "fold", 1e-3),
    ],
)
def test_the_end_of_stick_slip_lies_between_two_simulations(tmp_path, scene, changes, over, start, kind, within):
    """From the cycle beside it, 0.1 % to its one side stick-slip lives on, and 0.1 % to the other one it dies."""
    result = followed(tmp_path, scene, over, (start,), **changes)
    [end] = result.special(kind)
    family = Family(lab.load(scene, {"limits": "none", **changes}), [result.axis])
    cycle = min(
        (p for *_, p in result.points() if p.stick and p.stable and (p.value - end) * within > 0.0),
        key=lambda p: abs(p.value / end - 1.0 - within),
    )
    lives = []
    for value in (end * (1.0 + within), end * (1.0 - within)):
        flow = family.rig((value,))
        x = flow.settled.copy()
        x[flow.moving] = [cycle.state[flow.system.names[i]] for i in flow.moving]
        lives.append(bool(flow.carried(flow.carried(x, 500.0 * cycle.period).x, 20.0 * cycle.period).events))
    assert lives == [True, False]


# smooth special points of forced motions, beside other programs

ESCAPE_PLANT = """
from rig.effects import dither, drive, load
from rig.effects.dither import MassDither
from rig.effects.drive import BeltDrive
from rig.effects.load import Load
from rig.laws import Friction
from rig.model.assembly import Assembly
from rig.plants.belt import Body, contact_outputs
from rig.quantities import Section


class Parameters(Section):
    body: Body
    drive: BeltDrive
    load: Load
    friction: Friction
    dither: MassDither


def assemble(p, moved=None):
    a = Assembly(title="mass on a softening spring")
    a.coordinate("x", p.body.mass, p.body.damping, p.body.stiffness)
    a.product("xx", "x", "x")
    a.push("x", {"xx": p.body.stiffness})
    a.patch("contact", {"x": 1.0}, drive.add(a, p.drive, "m/s", moved or {}), p.friction.friction())
    a.normal("load", "contact", load.add(a, p.load, moved or {}))
    dither.add(a, p.dither, "contact", "load", "x")
    a.outputs |= contact_outputs({"x": 1.0}, a)
    return a
"""
ESCAPE = """
title = "A forced mass on a softening spring; its friction is constant"
plant = "./escape.py"
body = { mass = "1 kg", stiffness = "1 N/m", damping = "0.1 N*s/m" }
drive = { speed = "10 m/s" }
load = { force = "0.1 N" }
friction = { law = "coulomb", mu_static = 0.1, mu_kinetic = 0.1 }
dither = { on = "mass", amplitude = "0.06 N", frequency = "0.135 Hz" }
clock = { frame = "10 ms" }
"""
OMEGA = 2.0 * math.pi * 0.135


@pytest.fixture(scope="module")
def escape(tmp_path_factory) -> Branches:
    folder = tmp_path_factory.mktemp("escape")
    (folder / "escape.py").write_text(ESCAPE_PLANT)
    (folder / "escape.toml").write_text(ESCAPE)
    return branches(job(lab.load(folder / "escape.toml"), "dither.amplitude=0.02 N:0.11 N"), folder)


def critical(rate, omega, start, p, measure):
    """Newton's method for x(T) = x(0) and measure(dx(T)/dx(0)) = 0 by an independent integrator; the parameter."""
    from scipy.integrate import solve_ivp
    from scipy.optimize import root

    def end(x, p):
        span = (0.0, 2.0 * math.pi / omega)
        return solve_ivp(rate, span, x, method="DOP853", args=(p,), rtol=1e-12, atol=1e-14).y[:, -1]

    def missed(z):
        x, p, h, weights = z[:2], z[2], 1e-5, ((1, 8.0 / 12.0), (2, -1.0 / 12.0))
        J = np.array(
            [sum(w * (end(x + k * h * e, p) - end(x - k * h * e, p)) for k, w in weights) / h for e in np.eye(2)]
        ).T
        return [*(end(x, p) - x), measure(J)]

    solution = root(missed, [*start, p], tol=1e-11)
    assert solution.success
    return solution.x[2]


def test_folds_and_a_period_doubling_of_an_own_plant(escape):
    """Nothing else: in a rig with positive damping no torus begins."""

    def rate(t, y, F):
        return [y[1], -y[0] - 0.1 * y[1] + y[0] ** 2 + 0.01 + F * math.sin(OMEGA * t)]

    for kind, starts, sign in (
        ("fold", (((-0.3869, 0.1070), 0.045), ((-0.055, 0.265), 0.0617)), -1.0),
        ("period doubling", (((-0.0293, -0.5453), 0.1006),), 1.0),
    ):
        values = [
            critical(rate, OMEGA, start, p, lambda J, sign=sign: np.linalg.det(J + sign * np.eye(2)))
            for start, p in starts
        ]
        assert sorted(escape.special(kind)) == pytest.approx(values, abs=1e-9)
    assert {special.kind for special in escape.specials} == {"fold", "period doubling"}
    assert max(point.residual for *_, point in escape.points()) <= CLOSED


UNBALANCE_PLANT = (
    ESCAPE_PLANT.replace("    dither: MassDither\n", "")
    .replace(
        """    a.product("xx", "x", "x")
    a.push("x", {"xx": p.body.stiffness})
""",
        """    W = p.drive.speed / 0.05
    a.signal("unbalance.sin", {"unbalance.cos": W}, 0.0, "unbalance")
    a.signal("unbalance.cos", {"unbalance.sin": -W}, 0.01 * W**2, "unbalance")
    a.push("x", {"unbalance.sin": 1.0})
""",
    )
    .replace('    dither.add(a, p.dither, "contact", "load", "x")\n', "")
)
UNBALANCE = """
title = "A mass that a rotor with unbalance shakes while it slips"
plant = "./unbalance.py"
body = { mass = "5 kg", stiffness = "2500 N/m", damping = "20 N*s/m" }
drive = { speed = "1 m/s" }
load = { force = "20 N" }
friction = { law = "coulomb", mu_static = 0.3, mu_kinetic = 0.3 }
"""


def test_an_unbalance_of_an_own_plant_forces_motions_over_the_speed_of_its_drive(tmp_path):
    """Linear while it slips: response of the oscillator to m e W^2 sin(W t), in closed form."""
    (tmp_path / "unbalance.py").write_text(UNBALANCE_PLANT)
    (tmp_path / "unbalance.toml").write_text(UNBALANCE)
    scene = lab.load(tmp_path / "unbalance.toml")
    result = branches(job(scene, "drive.speed=0.8 m/s:1.5 m/s"), tmp_path)
    assert {branch.name for branch in result.branches} == {"slip"}
    assert result.notes == ("unbalance is on: motions with its period are followed, and no steady sliding exists",)
    assert len(list(result.points())) > 10
    for *_, p in result.points():
        W = p.value / 0.05
        amplitude = 0.01 * W**2 / math.hypot(2500.0 - 5.0 * W**2, 20.0 * W)
        assert p.residual <= CLOSED
        assert p.period == pytest.approx(2.0 * math.pi / W, rel=1e-12)
        assert np.array([p.low, p.high]) == pytest.approx(0.0024 + amplitude * np.array([-1.0, 1.0]), rel=1e-6)
        assert np.abs(p.multipliers) == pytest.approx(math.exp(-2.0 * p.period), abs=1e-8)
    with pytest.raises(UsageError, match="unbalance is on; curves over two parameters"):
        lab.branches(scene, "drive.speed=0.8 m/s:1.5 m/s", second="load.force=10 N:20 N:2", out=tmp_path)


def test_forced_motions_begin_where_the_starts_say_and_are_followed_once(tmp_path):
    over, changes = "drive.speed=0.1 m/s:0.24 m/s", {"friction.mu": 0.25}
    whole = followed(tmp_path, "belt_fluctuating_load", over, ("simulation",), **changes)
    assert [len({p.value for p in b.points}) > 2 for b in whole.branches] == [True, True]
    upwards = followed(tmp_path, "belt_fluctuating_load", over, (0.2,), **changes)
    assert [b.points[0].value for b in upwards.branches] == pytest.approx([0.2, 0.2])
    assert (
        "begins at no Hopf point" in followed(tmp_path, "belt_fluctuating_load", over, ("hopf",), **changes).notes[-1]
    )


def test_a_torus_point_of_a_forced_slip_with_falling_friction(tmp_path):
    changes = {
        "dither.on": "mass",
        "dither.amplitude": "2 N",
        "dither.frequency": "7 Hz",
        "dither.enable": True,
    }
    result = followed(tmp_path, "belt_dither", "drive.speed=0.15 m/s:0.3 m/s", ("simulation",), **changes)
    omega = 14.0 * math.pi

    def rate(t, y, V):
        mu = 0.18 + 0.32 * math.exp(-(V - y[1]) / 0.05)
        return [y[1], (20.0 * mu - 2.0 * y[1] - 2500.0 * y[0] + 2.0 * math.sin(omega * t)) / 5.0]

    value = critical(rate, omega, (0.00146, -0.01226), 0.21, lambda J: np.linalg.det(J) - 1.0)
    [torus] = [special for special in result.specials if special.kind == "torus"]
    assert abs(torus.value - value) < torus.accuracy < 1e-8


AUTO_EQUATIONS = """
      SUBROUTINE FUNC(NDIM,U,ICP,PAR,IJAC,F,DFDU,DFDP)
      INTEGER, INTENT(IN) :: NDIM, ICP(*), IJAC
      DOUBLE PRECISION, INTENT(IN) :: U(NDIM), PAR(*)
      DOUBLE PRECISION, INTENT(OUT) :: F(NDIM)
      DOUBLE PRECISION, INTENT(INOUT) :: DFDU(NDIM,NDIM), DFDP(NDIM,*)
      DOUBLE PRECISION R
      R = U(3)**2 + U(4)**2
      F(1) = U(2)
      F(2) = -0.1D0*U(2) - U(1) + U(1)**2 + 0.01D0 + PAR(1)*U(3)
      F(3) = U(3) + PAR(2)*U(4) - U(3)*R
      F(4) = U(4) - PAR(2)*U(3) - U(4)*R
      END
      SUBROUTINE STPNT(NDIM,U,PAR,T)
      INTEGER, INTENT(IN) :: NDIM
      DOUBLE PRECISION, INTENT(INOUT) :: U(NDIM), PAR(*)
      DOUBLE PRECISION, INTENT(IN) :: T
      DOUBLE PRECISION TURN
      TURN = 8*ATAN(1.0D0)
      PAR(1) = 0.0D0
      PAR(2) = TURN*0.135D0
      PAR(11) = TURN/PAR(2)
      U(1) = 0.5D0*(1.0D0 - SQRT(1.0D0 - 0.04D0))
      U(2) = 0.0D0
      U(3) = SIN(TURN*T)
      U(4) = COS(TURN*T)
      END
""" + "".join(f"      SUBROUTINE {name}\n      END\n" for name in ("BCND", "ICND", "FOPT", "PVLS"))
AUTO_CONSTANTS = """
NDIM=4, IPS=2, IRS=0, ILP=1, ISP=2, ISW=1, ICP=[1, 11], NTST=40, NCOL=4, IAD=3, NMX=60, NPR=60, MXBF=0, IID=0
ITMX=12, ITNW=7, NWTN=3, EPSL=1e-10, EPSU=1e-10, EPSS=1e-8, DS=0.01, DSMIN=1e-6, DSMAX=0.03, UZSTOP={1: 0.2}
"""


@pytest.mark.skipif(not (shutil.which("auto-07p") and shutil.which("gfortran")), reason="needs auto-07p and gfortran")
def test_smooth_special_points_are_those_of_auto(escape, tmp_path):
    (tmp_path / "escape.f90").write_text(AUTO_EQUATIONS)
    (tmp_path / "c.escape").write_text(AUTO_CONSTANTS)
    (tmp_path / "escape.auto").write_text("run('escape')\n")
    subprocess.run(["auto-07p", "escape.auto"], cwd=tmp_path, check=True, capture_output=True, timeout=120)
    rows = [line.split() for line in (tmp_path / "fort.7").read_text().splitlines()]
    values = {
        kind: sorted(float(row[4]) for row in rows if row[0] != "0" and row[2] == code)
        for kind, code in (("fold", "5"), ("period doubling", "7"))
    }
    assert (len(values["fold"]), len(values["period doubling"])) == (2, 1)
    for kind, expected in values.items():
        assert sorted(escape.special(kind)) == pytest.approx(expected, rel=1e-8), kind


def test_a_threshold_of_a_scene_with_controllers_is_that_of_the_plant_alone_if_asked_for(tmp_path):
    over, friction = "drive.speed=0.2 m/s:0.8 m/s", {"load.force": "20 N"}
    bare = followed(tmp_path / "bare", "belt", over, ("hopf",), **friction)
    result = followed(tmp_path / "with", "belt_normal_force", over, ("hopf",), **friction)
    with pytest.raises(UsageError, match=r"this scene has nf: .*--plant-alone computes"):
        Threshold(result, 0.4)
    alone, known = Threshold(result, 0.4, plant_alone=True).knocks()[0], Threshold(bare, 0.4).knocks()[0]
    assert alone.size == pytest.approx(known.size, rel=1e-6)


def test_the_command_refuses_a_threshold_of_a_scene_with_controllers(rig, tmp_path):
    over = ("branches", "belt_normal_force", "--over", "drive.speed=0.2 m/s:0.8 m/s", "--out", str(tmp_path))
    code, _, err = rig(*over, "--threshold", "0.4 m/s")
    assert (code, "belt_normal_force: a threshold is computed without controllers" in err) == (2, True)
    assert not [*tmp_path.iterdir()]
    code, _, err = rig(*over, "--plant-alone")
    assert (code, "belong to --threshold" in err) == (2, True)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--threshold", "0.9 m/s"), "outside of the range that is followed, 0.2 m/s to 0.8 m/s"),
        (("--threshold", "0.4"), "without a unit; expected m/s"),
        (("--threshold", "0.4 m/s", "--starts", "y=-2:2"), "y: is no state of the rig; known: x, x'"),
        (("--threshold", "0.4 m/s", "--starts", "x=2:-2"), "expected two finite numbers, the smaller one first"),
        (("--threshold", "0.4 m/s", "--starts", "x=2"), "expected STATE=FROM:TO"),
        (("--threshold", "0.4 m/s", "--knock", "load 20 ms"), "expected an actuator of belt"),
        (("--threshold", "0.4 m/s", "--knock", "load.force 20"), "expected ACTUATOR DURATION"),
    ],
)
def test_the_command_refuses_what_no_threshold_can_be_before_it_follows_branches(rig, tmp_path, options, words):
    code, _, err = rig("branches", "belt", "--over", "drive.speed=0.2 m/s:0.8 m/s", "--out", str(tmp_path), *options)
    assert (code, words in err) == (2, True)
    assert not [*tmp_path.iterdir()]
