"""Laws with memory as formulas: their slopes, their energy, what does not drift."""

import math
from itertools import pairwise

import friction_oracles as oracles
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rig.compiled.c_functions import converted
from rig.compiled.kernel import as_python
from rig.laws import LAWS

LUGRE = {"mu_static": 0.5, "mu_kinetic": 0.3, "speed_scale": 2e-3, "sigma0": 1e5, "sigma1": 30.0, "sigma2": 0.4}
RATE = {"mu_reference": 0.6, "speed": 1e-6, "a": 0.01, "b": 0.015, "distance": 1e-5}
HEAT = {"mu_cold": 0.5, "mu_hot": 0.3, "temperature_scale": 40.0, "capacity": 2.0, "cooling": 0.5, "share": 0.7}
LAW = {
    "lugre": LUGRE,
    "lugre of exponent 1": LUGRE | {"exponent": 1.0},
    "lugre of exponent 1.5": LUGRE | {"exponent": 1.5, "load": 20.0, "sigma0": 2e6},
    "elasto_plastic": LUGRE | {"elastic": 0.6},
    "dahl": {"mu_kinetic": 0.4, "sigma0": 1e5},
    "dahl of exponent 2.5": {"mu_kinetic": 0.4, "sigma0": 1e5, "exponent": 2.5},
    "maxwell_slip": {
        "mu_static": 0.5,
        "mu_kinetic": 0.3,
        "speed_scale": 2e-3,
        "viscous": 0.1,
        "transition": 0.1,
        "stiffness": [1e5, 4e4, 1e4],
        "shares": [0.5, 0.3, 0.2],
    },
    "rate_state": RATE,
    "rate_state with the slip law": RATE | {"evolution": "slip"},
    "stick_time": {"mu_kinetic": 0.3, "viscous": 0.2, "rise": 0.2, "time": 2.0, "distance": 1e-4},
    "stick_time, logarithmic": {
        "mu_kinetic": 0.3,
        "rise": 0.02,
        "time": 2.0,
        "distance": 1e-4,
        "growth": "logarithmic",
    },
    "contact_temperature": HEAT | {"static_ratio": 1.4, "speed_scale": 0.02},
}


def law_of(case, **changes):
    name = case.partition(" ")[0].rstrip(",")
    return LAWS[name].model_validate({"law": name, **LAW[case], **changes})


def evaluated(law, w, load, z):
    """[mu, rates] as an array; `law` and its numbers as a pair."""
    kind, p = law
    out = np.zeros(1 + len(z))
    out[0] = kind.mu(p, w, load, z)
    kind.rates(p, w, load, z, out[1:])
    return out


@pytest.mark.parametrize("case", LAW)
def test_slopes_are_derivatives_and_formulas_compile(case):
    law = law_of(case)
    kind, p, m = type(law), law.numbers(), len(law.states)
    compiled = [converted(f, as_python) for f in (kind.mu, kind.rates, kind.slopes)]
    numbers = np.random.default_rng(1)
    sizes = {"m": 3e-6, "1": 0.1, "K": 60.0}
    for _ in range(40):
        w, load = 10.0 ** numbers.uniform(-7.0, -1.0), numbers.uniform(1.0, 30.0)
        z = np.array([numbers.uniform(-0.2, 1.5) * sizes[state.unit] for state in law.states])
        at, d = np.array([w, load, *z]), np.zeros((1 + m, 2 + m))
        kind.slopes(p, w, load, z, d)
        value = evaluated((kind, p), w, load, z)
        for j in range(2 + m):
            h = 1e-5 * abs(at[j])
            ahead, behind = at.copy(), at.copy()
            ahead[j], behind[j] = at[j] + h, at[j] - h
            ahead, behind = (evaluated((kind, p), v[0], v[1], v[2:]) for v in (ahead, behind))
            allowed = 1e-6 * (np.abs(value / at[j]) + np.abs(d[:, j])) + 1e-12
            assert np.all(np.abs((ahead - behind) / (2.0 * h) - d[:, j]) <= allowed), (j, w, z)
        out, slopes = np.zeros(m), np.zeros_like(d)
        compiled[1](p, w, load, z, out)
        compiled[2](p, w, load, z, slopes)
        np.testing.assert_allclose([compiled[0](p, w, load, z), *out], value, rtol=1e-12)
        np.testing.assert_allclose(slopes, d, rtol=1e-12)


def test_below_its_limit_elasto_plastic_friction_does_not_drift_and_lugre_does():
    cycle = np.array([0.0, 0.1, 0.17, 0.02, 0.12])  # coefficients below 0.6 * 0.3, which the bristles carry in turn

    def slipped(law):
        """The slip over one cycle whose coefficient runs between the values of `cycle`, slowly."""
        x, p = 0.0, law.numbers()
        for begin, end in pairwise([*cycle[1:4], cycle[1]]):
            sign = math.copysign(1.0, end - begin)

            def field(f, _, sign=sign):
                rate = np.zeros(1)
                law.rates(p, 1e-12, 1.0, np.array([sign * f / law.sigma0]), rate)
                return [1e-12 / law.sigma0 / rate[0]]  # slip per change of the coefficient

            x += solve_ivp(field, (begin, end), [0.0], rtol=1e-12, atol=1e-20).y[0, -1]
        return x

    assert abs(slipped(law_of("elasto_plastic"))) < 1e-15 * cycle.max() / LUGRE["sigma0"] * 10.0
    expected = oracles.drift(0.02, 0.17, LUGRE["sigma0"], LUGRE["mu_static"])
    assert slipped(law_of("lugre")) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("case", [case for case in LAW if "slip law" not in case])
def test_no_state_within_reach_gives_energy(case):
    """Friction's power less the change of the stored energy. LuGre without sigma1, which alone makes it active."""
    law = law_of(case, **({"sigma1": 0.0} if "lugre" in case or "elasto" in case else {}))
    kind, p, load, numbers = type(law), law.numbers(), 7.0, np.random.default_rng(2)
    for _ in range(200):
        w, z = 10.0 ** numbers.uniform(-6.0, 0.0), np.zeros(len(law.states))
        for i, state in enumerate(law.states):
            stiffness = p.stiffness[i] / p.shares[i] if case == "maxwell_slip" else 1e5
            z[i] = numbers.uniform(-0.3, 0.3) / stiffness if state.unit == "m" else numbers.uniform(0.0, 0.2)
        value = evaluated((kind, p), w, load, z)
        h = 1e-4 * np.maximum(np.abs(z), 1e-12)
        change = 0.0
        for i in range(len(z)) if hasattr(kind, "stored") else ():
            ahead, behind = z.copy(), z.copy()
            ahead[i], behind[i] = z[i] + h[i], z[i] - h[i]
            change += (kind.stored(p, load, ahead) - kind.stored(p, load, behind)) / (2.0 * h[i]) * value[1 + i]
        assert value[0] * load * w - change >= -1e-9 * abs(change)


def test_coefficients_can_be_forces_under_a_load():
    table = {"law": "lugre", "mu_static": "10 N", "mu_kinetic": "6 N", "speed_scale": 1e-3, "sigma0": "2000 N/mm"}
    law = LAWS["lugre"].model_validate({**table, "sigma2": "8 N*s/m", "load": "20 N"})
    p = law.numbers()
    assert (p.sigma0, p.sigma2, p.curve.static, p.curve.kinetic) == pytest.approx((1e5, 0.4, 0.5, 0.3))
    assert LAWS["lugre"].model_validate(law.model_dump()).numbers() == p  # as a recording holds it
    with pytest.raises(ValueError, match="sigma0"):
        LAWS["lugre"].model_validate(table)  # a force without a load is no coefficient


@pytest.mark.parametrize(
    ("case", "changes", "words"),
    [
        ("lugre", {"mu_static": 0.2}, "mu_static 0.2 is below mu_kinetic 0.3"),
        ("maxwell_slip", {"stiffness": [1e5]}, "1 values of stiffness and 3 shares"),
        ("maxwell_slip", {"shares": [0.5, 0.3, 0.3]}, "the sum of the shares is 1.1"),
        ("rate_state", {"a": 1e-3}, "a 0.001 is below mu_reference / 300"),
    ],
)
def test_values_without_sense_are_refused(case, changes, words):
    with pytest.raises(ValueError, match=words):
        law_of(case, **changes)
