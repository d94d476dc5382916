"""The friction laws: values, slopes, what a stuck contact holds, what is refused."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

import rig
from rig.laws.constant import Constant
from rig.laws.coulomb import Coulomb
from rig.laws.exponential import Exponential
from rig.laws.falling import Falling
from rig.laws.strengthening import Strengthening
from rig.laws.stribeck import Stribeck
from rig.laws.stribeck_viscous import StribeckViscous
from rig.laws.table import Table

STRIBECK = Stribeck(law="stribeck", mu_static=0.5, mu_dynamic=0.18, speed_scale=0.05).friction()
FALLING = Falling(law="falling", mu_zero=0.4, slope=0.8, mu_floor=0.05).friction()
COULOMB = Coulomb(law="coulomb", mu_static=0.4, mu_kinetic=0.25).friction()
EXPONENTIAL = Exponential(law="exponential", mu_static=0.6, mu_kinetic=0.2, decay=15.0).friction()
TABLE = Table(law="table", speeds=(0.0, 0.05, 0.2, 0.6), values=(0.5, 0.3, 0.22, 0.2)).friction()
CURVE = {"law": "stribeck_viscous", "mu_static": 0.5, "mu_dynamic": 0.18, "speed_scale": 0.05}
LUBRICATED = StribeckViscous(**CURVE, exponent=1.5, viscous=0.3).friction()
RISING = Strengthening(law="strengthening", mu_static=0.3, rise=0.02, speed_scale=1e-3).friction()
LAWS = {
    "stribeck_viscous": LUBRICATED,
    "strengthening": RISING,
    "stribeck": STRIBECK,
    "falling": FALLING,
    "coulomb": COULOMB,
    "exponential": EXPONENTIAL,
    "table": TABLE,
}


def test_values_are_those_of_the_formulas():
    """Kroeger et al. (2008), characteristics A, B, C; exponential law of Liu and Ouyang."""
    for v in (0.0, 0.01, 0.06, 0.4, 2.0):
        assert STRIBECK.mu(v) == pytest.approx(0.18 + 0.32 * math.exp(-v / 0.05), rel=1e-14)
        assert FALLING.mu(v) == pytest.approx(max(0.4 - 0.8 * v, 0.05), rel=1e-14)
        assert EXPONENTIAL.mu(v) == pytest.approx(0.2 + 0.4 * math.exp(-15.0 * v), rel=1e-14)
        assert COULOMB.mu(v) == 0.25
        assert LUBRICATED.mu(v) == pytest.approx(0.18 + 0.32 * math.exp(-((v / 0.05) ** 1.5)) + 0.3 * v, rel=1e-14)
        assert RISING.mu(v) == pytest.approx(0.3 + 0.02 * math.log1p(v / 1e-3), rel=1e-14)


def test_static_coefficient_is_what_a_stuck_contact_holds():
    assert [law.static for law in LAWS.values()] == [0.5, 0.3, 0.5, 0.4, 0.4, 0.6, 0.5]
    own = Table(law="table", speeds=(0.0, 0.1), values=(0.4, 0.2), mu_static=0.7).friction()
    assert own.static == 0.7
    assert own.mu(0.0) == 0.4


def test_only_coulomb_friction_is_constant_in_slip_and_one_coefficient_is_coulomb_friction():
    assert {name for name, law in LAWS.items() if law.constant} == {"coulomb"}
    law = Constant(law="constant", mu=0.37).friction()
    assert law == Coulomb(law="coulomb", mu_static=0.37, mu_kinetic=0.37).friction()
    assert (law.static, law.mu(0.0), law.mu(3.0), law.constant) == (0.37, 0.37, 0.37, True)


@pytest.mark.parametrize("name", LAWS)
@given(v=st.floats(1e-4, 1.0))
@settings(max_examples=20)
def test_slopes_are_derivatives(name, v):
    law = LAWS[name]
    corners = {"falling": (0.4375,), "table": (0.05, 0.2, 0.6)}.get(name, ())
    assume(all(abs(v - corner) > 1e-5 for corner in corners))
    h = 1e-6
    assert law.slope(v) == pytest.approx((law.mu(v + h) - law.mu(v - h)) / (2.0 * h), abs=1e-5, rel=1e-5)


def test_slope_at_the_sliding_speed_of_the_reference(kroger):
    assert -STRIBECK.slope(0.06) == pytest.approx(kroger["cycles"]["A"]["eq"]["dmu"], rel=1e-7)
    assert -FALLING.slope(0.06) == pytest.approx(0.8, rel=1e-14)


@given(st.lists(st.integers(0, 1000).map(lambda i: i * 1e-3), min_size=2, max_size=8), st.data())
@settings(max_examples=25)
def test_a_table_goes_through_its_points_and_never_beyond_them(values, data):
    steps = data.draw(
        st.lists(st.integers(1, 500).map(lambda i: i * 1e-3), min_size=len(values) - 1, max_size=len(values) - 1)
    )
    speeds = np.concatenate([[0.0], np.cumsum(steps)])
    law = Table(law="table", speeds=tuple(speeds), values=tuple(values)).friction()
    for v, value in zip(speeds, values):
        assert law.mu(v) == pytest.approx(value, abs=1e-12)
    for i, (a, b) in enumerate(pairwise(speeds)):
        between = np.array([law.mu(v) for v in np.linspace(a, b, 30)])
        low, high = sorted((values[i], values[i + 1]))
        assert low - 1e-12 <= between.min() <= between.max() <= high + 1e-12
        rising = np.diff(between) * np.sign(values[i + 1] - values[i])
        assert rising.min() >= -1e-12
    assert law.mu(speeds[-1] + 1.0) == pytest.approx(values[-1], abs=1e-15)
    assert law.slope(speeds[-1] + 1.0) == 0.0


def test_laws_go_on_smoothly_below_zero_speed():
    """A trial step that ends a little beyond w = 0 keeps its order: no |v| in the kernel."""
    h = 1e-5
    for name in ("stribeck", "exponential", "falling", "table"):
        law = LAWS[name]
        assert law.mu(-h) == pytest.approx(law.mu(0.0) - h * law.slope(1e-12), abs=1e-6)
        assert law.mu(-h) >= law.mu(0.0)


SLIDE_FROM = {
    "c": 0.4,
    "lugre": 0.5,
    "elasto_plastic": 0.5,
    "maxwell_slip": 0.5,
    "dahl": 0.4,
    "stick_time": 0.25,
    "contact_temperature": 0.54,
    "rate_state": 0.4 + 0.01 * math.log(1e3),  # at 1e-6 m/s
}


def test_steady_slip_of_a_law_with_memory_is_that_under_its_load():
    """Steady: T = mu N w / cooling, and mu = (hot + (cold - hot) e^(-T / scale)) (1 + surplus e^(-w / v))."""
    law = rig.load("belt_contact_temperature").parameters.friction.friction()
    for load in (1.0, 20.0, 200.0):
        mu = law.mu(0.06, load)
        T = mu * load * 0.06 / 0.005
        assert mu == pytest.approx((0.15 + 0.15 * math.exp(-T / 20.0)) * (1.0 + 0.8 * math.exp(-0.06 / 0.05)), rel=1e-9)
        h = 1e-6
        assert law.slope(0.06, load) == pytest.approx(
            (law.mu(0.06 + h, load) - law.mu(0.06 - h, load)) / (2 * h), rel=1e-6
        )
    assert law.mu(0.06, 1.0) > 1.5 * law.mu(0.06, 20.0)
    for call in (law.mu, law.slope):
        with pytest.raises(ValueError, match="state it"):
            call(0.06)


def test_a_contact_at_rest_begins_to_slide_at_the_static_coefficient_or_the_largest_of_steady_slip():
    rest = {name: rig.load(f"belt_{name}").parameters.friction.friction().at_rest(20.0) for name in SLIDE_FROM}
    assert rest == pytest.approx(SLIDE_FROM, rel=1e-3)


def test_a_law_at_once_keeps_its_states():
    law = rig.load("belt_contact_temperature").parameters.friction.friction()
    mu, slope = law.at_once(np.array([0.0, 0.05]), 20.0, np.array([20.0]))
    warm = 0.15 + 0.15 / math.e
    assert mu == pytest.approx([1.8 * warm, warm * (1.0 + 0.8 / math.e)], rel=1e-12)
    assert slope == pytest.approx([-16.0 * warm, -16.0 * warm / math.e], rel=1e-12)


def points(speeds, values):
    return {"law": "table", "speeds": speeds, "values": values}


@pytest.mark.parametrize(
    ("section", "given", "told"),
    [
        (Coulomb, {"law": "coulomb", "mu_static": 0.2, "mu_kinetic": 0.25}, "would stick again immediately"),
        (Falling, {"law": "falling", "mu_zero": 0.1, "slope": 0.8, "mu_floor": 0.2}, "mu_floor 0.2 is above mu_zero"),
        (Table, points((0.0, 0.1, 0.2), (0.4, 0.3)), "3 speeds and 2 values"),
        (StribeckViscous, CURVE | {"mu_static": 0.1}, "mu_static 0.1 is below mu_dynamic 0.18"),
    ],
)
def test_what_is_no_law_is_refused(section, given, told):
    with pytest.raises(ValidationError, match=told):
        section(**given)


def test_the_law_of_tustin_without_a_viscous_part_is_the_stribeck_law(move):
    """A formula that kernels call by its address moves the rig as the law that they contain."""
    tustin = {f"friction.{key}": value for key, value in (CURVE | {"exponent": 1.0}).items()}
    a, b = (move("belt", law, duration=2.0, tolerance=1e-11) for law in (tustin, {}))
    assert a["velocity"] == pytest.approx(b["velocity"], abs=1e-10)


def test_a_table_of_a_law_moves_like_the_law(move):
    """Eighty points of characteristic A: the period to 1e-4."""
    speeds = np.concatenate([[0.0], np.geomspace(1e-4, 0.3, 80)])
    table = {
        "friction.law": "table",
        "friction.speeds": speeds.tolist(),
        "friction.values": [STRIBECK.mu(v) for v in speeds],
    }
    a, b = (move("belt", law, duration=3.0).times("contact releases +") for law in (table, {}))
    assert a[-1] - a[-2] == pytest.approx(b[-1] - b[-2], rel=1e-4)
