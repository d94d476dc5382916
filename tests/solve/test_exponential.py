"""The exponential function of the friction law that most rigs have, beside the library's."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from rig.compiled.kernel import kernel
from rig.solve.expm import exponential_factors


@kernel
def product(u):
    coarse, fine = exponential_factors(u)
    return coarse * fine


@settings(deadline=None)
@given(st.floats(-800.0, 800.0))
def test_the_factors_come_to_the_exponential_within_two_units_in_the_last_place(u):
    with np.errstate(over="ignore", under="ignore"):
        expected = float(np.exp(u))
    assert product(u) == expected or abs(product(u) - expected) <= 2.0 * np.spacing(expected)


def test_where_there_is_no_number_there_is_none():
    assert np.isnan(product(np.nan))
    assert product(np.inf) == np.inf
    assert product(-np.inf) == 0.0
