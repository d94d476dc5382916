"""The slider-on-disc rig with an L-shaped lever: tests/reference/liu_lever.json, scipy, closed forms.

Liu and Ouyang, Mechanical Systems and Signal Processing (2022). The reference tells the share of stick over a stretch
of time that is no whole number of cycles, which is wrong in the third digit; it is compared with scipy instead.
"""

import math

import numpy as np
import pytest
from reference import numbers

import rig
from rig.plants import lever

LIU = numbers("liu_lever")
RPM = math.pi / 30.0
COULOMB = {"friction.law": "coulomb", "friction.mu_static": 0.42, "friction.mu_kinetic": 0.3}
PROPERTY_2 = {"friction.mu_static": 0.38, "friction.mu_kinetic": 0.32}
LAWS = {"stribeck": {}, "coulomb": COULOMB}
CYCLES = [cycle for cycle in LIU["limit_cycles"] if cycle["rpm"] in (1.0, 3.0)]
OTHERS = [cycle for cycle in LIU["limit_cycles"] if cycle["rpm"] not in (1.0, 3.0)]


def scene(N0, rpm, law="stribeck", **changes):
    return rig.load("lever", {"load.force": N0, "drive.speed": rpm * RPM, **LAWS[law], **changes})


def name(entry):
    return f"{entry['N0']} N, {entry['rpm']} rpm, {entry['model']}"


def half(cycle, output):
    low, high = cycle.extremes[output]
    return 0.5 * (high - low)


@pytest.mark.parametrize("expected", LIU["equilibria"], ids=name)
def test_sliding_and_its_eigenvalues_are_those_of_the_reference(expected):
    found = rig.modes(scene(expected["N0"], expected["rpm"], expected["model"])).sliding
    values = [complex(mode.growth, 2.0 * math.pi * mode.frequency) for mode in found.modes]
    assert sorted(values, key=abs) == pytest.approx([complex(*value) for value in expected["eigs"]], rel=1e-6)
    outputs = {"angle": "phi", "lever_angle": "theta", "normal_force": "N"}
    for output, key in outputs.items():
        assert found.equilibrium[output] == pytest.approx(expected[key], rel=1e-6)


def exact_energy(phi, theta):
    p = LIU["params"]
    across, up = p["r1"] * np.sin(phi), 1.0 - np.cos(phi)
    d1 = np.hypot(p["l0"] + p["D1"] + across, p["r1"] * up) - p["l0"]
    tip = p["l0"] + p["D2"] - p["r3"] * np.sin(theta)
    d2 = np.hypot(np.hypot(tip, p["r2"] * np.sin(phi) + p["r3"] * (1.0 - np.cos(theta))), p["r2"] * up) - p["l0"]
    tail = p["l0"] + p["D3"] + p["rv"] * np.sin(phi) - p["r3"] * np.sin(theta)
    d3 = np.hypot(np.hypot(tail, p["rv"] * up), p["r3"] * (1.0 - np.cos(theta))) - p["l0"]
    k = p["k1"], p["k2"], p["k3"]
    return 0.5 * sum(k_i * d_i**2 for k_i, d_i in zip(k, (d1, d2, d3))) - p["m"] * lever.GRAVITY * across


@pytest.mark.parametrize("order", [2, 3, 4, 5])
def test_the_energy_is_that_of_the_geometry_up_to_its_order(order):
    """What is left out falls with the power order + 1 of the angles, at least."""
    U = lever.energy(scene(20, 1, **{"springs.order": order}).parameters)
    errors = []
    for size in (0.2, 0.1):
        errors.append(
            max(
                abs(np.polynomial.polynomial.polyval2d(size * x, size * y, U) - exact_energy(size * x, size * y))
                for x, y in ((1.0, 0.3), (0.5, 1.0), (1.0, -0.7), (-0.6, 0.8))
            )
        )
    assert math.log2(errors[0] / errors[1]) > order + 0.7
    assert errors[1] < 40.0 * 0.1 ** (order + 1)


def same_cycle(expected):
    found = rig.limit_cycle(scene(expected["N0"], expected["rpm"], expected["model"]))
    assert found.found == expected["stick_slip"], found.why
    if not found.found:
        return
    assert found.period == pytest.approx(expected["period_s"], rel=1e-5)
    assert half(found, "angle") == pytest.approx(expected["A_phi"], rel=1e-5)
    assert half(found, "lever_angle") == pytest.approx(expected["A_theta"], rel=1e-5)
    for output, low, high in (("angle", "phi_min", "phi_max"), ("normal_force", "N_min", "N_max")):
        assert found.extremes[output] == pytest.approx((expected[low], expected[high]), rel=1e-5)
    assert abs(found.energy["error"]) < 1e-6


@pytest.mark.parametrize("expected", CYCLES, ids=name)
def test_cycle_is_that_of_the_reference(expected):
    same_cycle(expected)


@pytest.mark.slow
@pytest.mark.parametrize("expected", OTHERS, ids=name)
def test_cycle_at_other_speeds_is_that_of_the_reference(expected):
    same_cycle(expected)


@pytest.mark.parametrize("expected", LIU["scipy_independent"], ids=name)
def test_cycle_of_the_exact_geometry_is_that_of_scipy(expected):
    """What order 5 leaves out of the energy has four angles more than what a spring stores."""
    for order, key in ((2, "second_order"), (5, "exact_geometry")):
        found = rig.limit_cycle(scene(expected["N0"], expected["rpm"], expected["model"], **{"springs.order": order}))
        measured = {"period_s": found.period, "A_phi": half(found, "angle"), "A_theta": half(found, "lever_angle")}
        left_out = 1e-5 * (found.extremes["angle"][1] / 0.03) ** 4 if order == 5 else 0.0
        for number, value in measured.items():
            assert value == pytest.approx(expected[key][number], rel=1e-6 + left_out), (key, number)


def test_stick_and_slip_begin_when_scipy_says(chain):
    """Every event of three seconds from the standing start, and the share of stick of the cycle."""
    p, N0, V = LIU["params"], 20.0, LIU["params"]["rd"] * RPM
    mu_s, mu_k, alpha = (LIU["prop1"][key] for key in ("mus", "muk", "alpha"))
    L2 = p["l0"] + p["D2"]

    def moments(y):
        phi, theta = y[:2]
        d1, d3 = p["D1"] + p["r1"] * phi, p["D3"] + p["rv"] * phi - p["r3"] * theta
        d2 = p["D2"] - p["r3"] * theta + p["r2"] ** 2 * phi**2 / (2.0 * L2)
        on_phi = p["k1"] * p["r1"] * d1 + p["k3"] * p["rv"] * d3 + p["k2"] * d2 * p["r2"] ** 2 * phi / L2
        on_phi += p["c1"] * y[2] - p["m"] * 9.81 * p["r1"]
        return on_phi, p["c2"] * y[3] - p["k3"] * p["r3"] * d3 - p["k2"] * p["r3"] * d2

    def normal(y):
        return N0 + p["k2"] * p["r3"] * y[1]

    def rate(stuck, t, y):
        on_phi, on_theta = moments(y)
        mu = mu_k + (mu_s - mu_k) * np.exp(-alpha * (V - p["r2"] * y[2]))
        turning = 0.0 if stuck else (p["r2"] * mu * normal(y) - on_phi) / p["J"]
        return [y[2], y[3], turning, -on_theta / p["I"]]

    def releases(t, y):
        return mu_s * normal(y) - moments(y)[0] / p["r2"]

    def lands(t, y):
        return V - p["r2"] * y[2]

    def follow(stuck, guard, t, y):
        return not stuck, np.array([y[0], y[1], V / p["r2"], y[3]])

    def guards(stuck):
        return [releases if stuck else lands]

    expected = chain(rate, guards, follow, True, [0.0, 0.0, V / p["r2"], 0.0], 3.0)
    assert len(expected) > 14
    run = rig.simulate(rig.load("lever", {"clock.tolerance": 1e-10}), 3.0)
    found = [event["t_ns"] * 1e-9 for event in run.events if event["text"].startswith("contact")]
    assert found == pytest.approx(expected, abs=5e-9)
    stick, period = expected[-1] - expected[-2], expected[-1] - expected[-3]
    cycle = rig.limit_cycle(scene(20, 1))
    if run.events[-1]["text"].endswith("slip ends"):
        stick = period - stick
    assert cycle.stick_share["contact"] == pytest.approx(stick / period, abs=1e-4)
    assert abs(run.energy["error"]) < 1e-6


@pytest.mark.parametrize("expected", LIU["critical_speeds_uniform_rpm"], ids=lambda e: f"{e['N0']} N")
def test_sliding_loses_its_stability_at_the_speed_of_the_reference(expected):
    for changes, key in (({}, "V1_prop1"), (PROPERTY_2, "V1_prop2")):
        below, above = (rig.modes(scene(expected["N0"], expected[key] + off, **changes)) for off in (-1e-4, 1e-4))
        assert below.sliding.growth > 0.0 > above.sliding.growth


def test_coulomb_sliding_is_stable_at_every_speed():
    for N0 in (10, 20, 30):
        for rpm in (0.1, 1, 3, 8):
            assert rig.modes(scene(N0, rpm, "coulomb")).sliding.stable


def test_dead_weight_lifts_the_rest_position():
    """Linear theory: another dead mass moves the rest by m g r1 / K, the rig's stiffness in phi with theta free."""
    a = rig.load("lever_free_cylinder").assemble()
    K = a.stiffness["phi", "phi"]
    assert pytest.approx(1200.0 * 0.15**2) == K
    rest = a.force["phi"]["one"] / K
    assert rest == pytest.approx((9.81 / 1200.0 - 0.004175) / 0.15, rel=1e-12)
    heavy = rig.load("lever_free_cylinder", {"cylinder.dead_mass": 1.5}).assemble()
    assert heavy.force["phi"]["one"] / K - rest == pytest.approx(0.5 * 9.81 * 0.15 / K, rel=1e-12)


@pytest.mark.parametrize(
    ("experiment", "hertz", "ratio"),
    [
        ("lever_free_cylinder", 27.7746 / (2.0 * math.pi), 0.061721),
        ("lever_free_lever", 62.3538 / (2.0 * math.pi), 0.032075),
    ],
)
def test_parts_alone_vibrate_as_worked_out_by_hand(experiment, hertz, ratio):
    """Omega^2 = k1 r1^2 / J, (k2 + k3) r3^2 / I."""
    [mode] = rig.modes(experiment).sliding.modes
    undamped = mode.frequency / math.sqrt(1.0 - mode.damping**2)
    assert undamped == pytest.approx(hertz, rel=1e-5)
    assert mode.damping == pytest.approx(ratio, rel=1e-4)
