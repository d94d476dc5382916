"""The tread block: mode coupling with lift-off (rounded edge), stick-slip at constant load (rough surface).

Kroeger, Neubauer, Popp (2008), section 3b. Numbers: tests/reference/kroger_rigs.json, integrated with friction smoothed
by tanh over 0.2 mm/s: 2 %, of the same stretch of time from the same start. Its friction force is left out: in stick
its fixed step is beyond the stability limit of the smoothed friction (mu N h / (eps m) = 9), and the force at the
ends of its steps is not the one that acts. Event times are checked without smoothing, by scipy.
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import rig

SETS = {"tread": "TREAD1_edge_radius", "tread_rough": "TREAD2_rough"}
FINE = "eps0.0002_h1e-07"


@pytest.fixture(scope="module", params=SETS)
def block(request, rigs):
    one = rigs["tread"][SETS[request.param]]
    return request.param, one["params"], one


def test_scenes_have_the_parameters_of_the_reference(block):
    name, p, _ = block
    scene = rig.load(name).parameters
    tip, law = scene.tip, scene.friction
    assert (tip.mass, tip.tangential_stiffness, tip.normal_stiffness) == (p["m"], p["cx"], p["cz"])
    assert (tip.tangential_damping, tip.normal_damping, tip.coupling) == (p["dx"], p["dz"], p["cxz"])
    assert (law.mu_static, law.mu_dynamic, law.speed_scale) == (p["mus"], p["mud"], p["vs"])
    assert (scene.contact.stiffness, scene.load.force, scene.drive.speed) == (p["kc"], p["P"], p["vd"])


def sorted_rates(values):
    return sorted((v for v in values if v.imag >= 0.0), key=lambda v: (v.imag, v.real))


def told(sliding):
    return sorted_rates([complex(m.growth, 2.0 * math.pi * m.frequency) for m in sliding.modes])


def test_sliding_equilibrium_and_its_eigenvalues_are_those_of_the_reference(block):
    name, _, one = block
    sliding, expected = rig.modes(name).sliding, one["equilibrium"]
    assert sliding.equilibrium["normal_force"] == pytest.approx(expected["FN"], rel=1e-9)
    assert sliding.coefficient["contact"] == pytest.approx(expected["mu"], rel=1e-9)
    assert told(sliding) == pytest.approx(sorted_rates([complex(*v) for v in expected["eig"]]), rel=1e-6)
    constant = rig.load(name, {"friction.law": "constant", "friction.mu": expected["mu"]})
    rates = sorted_rates([complex(*v) for v in expected["eig_constant_mu_slope0"]])
    assert told(rig.modes(constant).sliding) == pytest.approx(rates, rel=1e-6)


@pytest.mark.parametrize(("coupling", "flutters"), [(1.5e5, True), (0.0, False)])
def test_a_rounded_edge_flutters_under_constant_friction_and_a_rough_one_does_not(coupling, flutters):
    scene = rig.load("tread", {"friction.law": "constant", "friction.mu": 1.12, "tip.coupling": coupling})
    assert (rig.modes(scene).sliding.growth > 0.0) is flutters


@pytest.fixture(scope="module")
def vibration(move):
    """A scene from the start of the reference, each 2 us from 60 to 120 ms."""
    kept = {}

    def get(name, p):
        if name not in kept:
            start = {"start.height": -p["P"] / (p["kc"] + p["cz"])}
            run = move(name, start, step_ms=0.002, duration=0.12, cap=1000, tolerance=1e-9)
            late = run.time > 0.06
            names = ("displacement", "velocity", "normal_force", "slip_speed")
            kept[name] = run, {key: run[key][late] for key in names}
        return kept[name]

    return get


def test_vibration_is_that_of_the_reference(block, vibration):
    name, p, one = block
    run, s = vibration(name, p)
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


def test_the_rounded_edge_needs_two_rounds_for_a_cycle_and_lifts_off_in_each():
    cycle = rig.limit_cycle("tread")
    assert [what for _, what in cycle.events].count("load opens") == 2
    assert 0.5 * cycle.period * 1e3 == pytest.approx(0.7707, rel=0.01)
    assert cycle.extremes["normal_force"][0] == pytest.approx(0.0, abs=1e-9)
    assert abs(cycle.energy["error"]) < 1e-8
    opening, closing = ([t for t, what in cycle.events if what == f"load {word}"] for word in ("opens", "closes"))
    apart = sum(
        (c - o) % cycle.period for o, c in zip(opening, sorted(closing, key=lambda c: (c - opening[0]) % cycle.period))
    )
    assert apart / cycle.period == pytest.approx(0.32, abs=0.005)


def chain(p, z, count):
    """The first mode set changes of a block that starts stuck, by scipy: (time, what), each phase to its own event."""
    m, P, V = p["m"], p["P"], p["vd"]

    def coefficient(w):
        return p["mud"] + (p["mus"] - p["mud"]) * math.exp(-w / p["vs"])

    def needed(y):
        return p["dx"] * V + p["cx"] * y[0] - p["cxz"] * y[1]

    def rate(mode):
        def field(_, y):
            N = 0.0 if mode == "open" else -p["kc"] * y[1]
            T = coefficient(max(V - y[2], 0.0)) * N
            ax = 0.0 if mode == "stick" else (T - p["dx"] * y[2] - p["cx"] * y[0] + p["cxz"] * y[1]) / m
            return [y[2], y[3], ax, (N - P - p["dz"] * y[3] - p["cz"] * y[1] + p["cxz"] * y[0]) / m]

        return field

    guards = {
        "stick": {"contact releases +": lambda t, y: -p["mus"] * p["kc"] * y[1] - needed(y)},
        "slip": {"contact slip ends": lambda t, y: V - y[2] if t > 1e-7 else 1.0,
                 "load opens": lambda _, y: -y[1]},
        "open": {"load closes": lambda t, y: y[1] if t > 1e-7 else 1.0},
    }  # fmt: skip
    follows = {"contact releases +": "slip", "contact slip ends": "stick", "load opens": "open", "load closes": "slip"}
    t, y, mode, out = 0.0, [0.0, z, V, 0.0], "stick", []
    for _ in range(count):
        for guard in guards[mode].values():
            guard.terminal, guard.direction = True, -1.0
        run = solve_ivp(rate(mode), (0.0, 0.01), y, "DOP853", rtol=1e-12, atol=1e-16,
                        events=list(guards[mode].values()))  # fmt: skip
        which = next(i for i, found in enumerate(run.t_events) if len(found))
        t, y = t + float(run.t_events[which][0]), run.y_events[which][0]
        what = list(guards[mode])[which]
        out.append((t, what))
        mode = follows[what]
    return out


def test_first_mode_changes_are_those_of_scipy(block, move):
    name, p, _ = block
    z = -p["P"] / (p["kc"] + p["cz"])
    expected = chain(p, z, 24 if name == "tread" else 8)
    run = move(name, {"start.height": z}, step_ms=0.02, duration=0.03, tolerance=1e-11)
    found = [((e.tick + e.place) * run.step, e.what) for e in run.motion.events()][: len(expected)]
    assert [what for _, what in found] == [what for _, what in expected]
    assert [t for t, _ in found] == pytest.approx([t for t, _ in expected], rel=1e-6)
    assert ("load opens" in [what for _, what in found]) is (name == "tread")
