"""The tread block: mode coupling with lift-off (rounded edge), stick-slip at constant load (rough surface).

Kroeger, Neubauer, Popp (2008), section 3b. Numbers: tests/reference/kroger_rigs.json, integrated with friction smoothed
by tanh over 0.2 mm/s: 2 %, of the same stretch of time from the same start. Its friction force is left out: in stick
its fixed step is beyond the stability limit of the smoothed friction (mu N h / (eps m) = 9), and the force at the
ends of its steps is not the one that acts. The reference's block with a rounded edge is stiffer than that of the
scene, not passive, and its friction falls. Events are checked without smoothing, by scipy.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from reference import in_order, rates

import rig
from rig.laws.constant import Constant

SETS = {"tread": "TREAD1_edge_radius", "tread_rough": "TREAD2_rough"}
FINE = "eps0.0002_h1e-07"


@pytest.fixture(scope="module", params=SETS)
def block(request, rigs):
    """Scene, parameters and results of the reference, and the changes that give the scene these parameters."""
    one = rigs["tread"][SETS[request.param]]
    p = one["params"]
    changes = {
        "tip.mass": p["m"],
        "tip.tangential_stiffness": p["cx"],
        "tip.normal_stiffness": p["cz"],
        "tip.tangential_damping": p["dx"],
        "tip.normal_damping": p["dz"],
        "tip.coupling": p["cxz"],
        "contact.stiffness": p["kc"],
        "load.force": p["P"],
        "friction.law": "stribeck",
        "friction.mu_static": p["mus"],
        "friction.mu_dynamic": p["mud"],
        "friction.speed_scale": p["vs"],
    }
    if request.param == "tread":
        return request.param, p, one, changes
    scene = rig.load("tread_rough")  # has these parameters
    assert {key: scene.values()[key][0] for key in changes} == changes
    return request.param, p, one, {}


def test_sliding_equilibrium_and_its_eigenvalues_are_those_of_the_reference(block):
    name, _, one, changes = block
    sliding, expected = rig.modes(rig.load(name, changes)).sliding, one["equilibrium"]
    assert sliding.equilibrium["normal_force"] == pytest.approx(expected["FN"], rel=1e-9)
    assert sliding.coefficient["contact"] == pytest.approx(expected["mu"], rel=1e-9)
    assert rates(sliding) == pytest.approx(in_order([complex(*v) for v in expected["eig"]]), rel=1e-6)
    constant = rig.load(name, changes)
    constant = replace(
        constant,
        parameters=constant.parameters.model_copy(update={"friction": Constant(law="constant", mu=expected["mu"])}),
    )
    expected = in_order([complex(*v) for v in expected["eig_constant_mu_slope0"]])
    assert rates(rig.modes(constant).sliding) == pytest.approx(expected, rel=1e-6)


def test_the_block_of_the_scene_is_passive_and_flutters_by_its_coupling_alone():
    tip = rig.load("tread").parameters.tip
    assert tip.tangential_stiffness * tip.normal_stiffness > 1.05 * tip.coupling**2
    [flutter, other] = rig.modes("tread").sliding.modes
    assert flutter.growth > 20.0
    assert flutter.frequency > 100.0
    assert other.growth < 0.0
    assert rig.modes(rig.load("tread", {"tip.coupling": 0.0})).sliding.growth < 0.0


@pytest.fixture(scope="module")
def vibration(move):
    """A scene from the start of the reference, each 2 us from 60 to 120 ms."""
    kept = {}

    def get(name, p, changes):
        if name not in kept:
            start = changes | {"start.height": -p["P"] / (p["kc"] + p["cz"])}
            run = move(name, start, step_ms=0.002, duration=0.12, cap=1000, tolerance=1e-9)
            late = run.time > 0.06
            names = ("displacement", "velocity", "normal_force", "slip_speed")
            kept[name] = run, {key: run[key][late] for key in names}
        return kept[name]

    return get


def test_vibration_is_that_of_the_reference(block, vibration):
    name, p, one, changes = block
    run, s = vibration(name, p, changes)
    expected = one["sim"][FINE]
    x, v, N = 1e3 * s["displacement"], s["velocity"], s["normal_force"]
    assert [x.min(), x.max()] == pytest.approx([expected["x_min_mm"], expected["x_max_mm"]], abs=0.02 * np.ptp(x))
    assert [v.min(), v.max()] == pytest.approx([expected["v_min"], expected["v_max"]], abs=0.02 * np.ptp(v))
    assert [N.min(), N.max()] == pytest.approx([expected["FN_min"], expected["FN_max"]], rel=0.02)
    assert N.mean() == pytest.approx(expected["FN_mean"], rel=0.02)
    assert np.mean(N == 0.0) == pytest.approx(expected["sep_frac"], rel=0.02)
    sticks = run.times("contact releases +")
    assert np.diff(sticks[sticks > 0.06]).mean() * 1e3 == pytest.approx(expected["period_ms"], rel=0.02)


def test_the_rough_block_keeps_its_normal_force_and_sticks(rigs):
    cycle = rig.limit_cycle("tread_rough")
    assert cycle.extremes["normal_force"] == pytest.approx((56.0, 56.0), rel=1e-9)
    assert cycle.extremes["friction_force"][1] == pytest.approx(0.9 * 56.0, rel=1e-9)
    smoothed = [rigs["tread"]["TREAD2_rough"]["sim"][key]["period_ms"] for key in ("eps0.0005_h2e-07", FINE)]
    assert smoothed[0] < smoothed[1] < 1e3 * cycle.period < 1.003 * smoothed[1]


def test_the_rounded_edge_sticks_slips_and_lifts_off_once_in_a_cycle():
    cycle = rig.limit_cycle("tread")
    assert [what for _, what in cycle.events].count("load opens") == 1
    assert cycle.extremes["normal_force"][0] == pytest.approx(0.0, abs=1e-9)
    assert abs(cycle.energy["error"]) < 1e-8
    low, high = cycle.extremes["displacement"]
    assert 1e3 * (high - low) == pytest.approx(0.15, rel=0.1)  # the paper's axis


def phases(p, told):
    """Tip and contact, for scipy; parameters as in the reference. `told` receives what happens at each event."""

    def slip(y):
        return p["vd"] - y[2]

    def needed(y):
        return p["dx"] * p["vd"] + p["cx"] * y[0] - p["cxz"] * y[1]

    def rate(mode, t, y):
        side = {"slip+": 1.0, "slip-": -1.0}.get(mode, 0.0)
        N = 0.0 if mode == "open" else -p["kc"] * y[1]
        T = side * (p["mud"] + (p["mus"] - p["mud"]) * math.exp(-max(side * slip(y), 0.0) / p["vs"])) * N
        ax = 0.0 if mode == "stick" else (T - p["dx"] * y[2] - p["cx"] * y[0] + p["cxz"] * y[1]) / p["m"]
        return [y[2], y[3], ax, (N - p["P"] - p["dz"] * y[3] - p["cz"] * y[1] + p["cxz"] * y[0]) / p["m"]]

    def events(mode):
        if mode == "open":
            return {"load closes": lambda t, y: y[1]}
        if mode == "stick":
            return {
                f"contact releases {sign}": lambda t, y, side=side: -p["mus"] * p["kc"] * y[1] - side * needed(y)
                for sign, side in (("+", 1.0), ("-", -1.0))
            }
        side = 1.0 if mode == "slip+" else -1.0
        return {"contact slip ends": lambda t, y: side * slip(y), "load opens": lambda t, y: -y[1]}

    def follow(mode, which, t, y):
        what = [*events(mode)][which]
        told.append(what)
        if what == "contact slip ends":
            sticks = abs(needed(y)) <= -p["mus"] * p["kc"] * y[1]
            return ("stick" if sticks else "slip+" if needed(y) > 0.0 else "slip-"), y
        way = "+" if slip(y) > 0.0 else "-"
        return {"load opens": "open", "load closes": f"slip{way}"}.get(what, f"slip{what[-1]}"), y

    return rate, lambda mode: events(mode).values(), follow


def compared(p, duration, name, changes, move, chain):
    height, told = -p["P"] / (p["kc"] + p["cz"]), []
    times = chain(*phases(p, told), "stick", [0.0, height, p["vd"], 0.0], duration)
    run = move(name, changes | {"start.height": height}, step_ms=0.02, duration=duration, tolerance=1e-11)
    found = [((e.tick + e.place) * run.step, e.what) for e in run.motion.events()][: len(told)]
    assert [what for _, what in found] == told
    assert [t for t, _ in found] == pytest.approx(list(times), rel=1e-6)
    return told


def test_first_mode_changes_are_those_of_scipy(block, move, chain):
    name, p, _, changes = block
    found = compared(p, 0.02 if name == "tread" else 3e-3, name, changes, move, chain)
    assert len(found) >= 8
    assert ("load opens" in found) is (name == "tread")
