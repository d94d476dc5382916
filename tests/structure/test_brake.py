"""The finite element brake of the literature: full eigenvalues, flutter, and bases for all speeds and frictions.

Full eigenvalues and onsets: computed by an independent program (shift-invert, residual 2e-10).
"""

import time

import numpy as np
import pytest
from brake_fe import FRICTION, SPEED, brake

from rig.structure.basis import Reduction, build
from rig.structure.eigenvalues import complex_eigenvalues
from rig.structure.estimate import Estimator

UP_TO = 2 * np.pi * 3000.0
RANGE = {SPEED: (2 * np.pi, 8 * np.pi), FRICTION: (0.0, 3.0)}
AT_ONE = """
    -11.3658 1413.4913, -6.27347 3337.3213, -14.5417 3522.1374, -1371.78 3915.94,
    -21.0484 4047.1243, -53.5063 4918.1482, -39.2254 4924.9200, 0.00019 5130.6043, -953.29 8139.88, -45.2767 10112.9721,
    -65.1245 10257.2308, -6073.70 13015.03, -233.7608 16286.9848, -14.9910 16344.9488, -50.8237 17402.3998,
    -112.6695 17597.4429, -363.7896 17851.9572
"""
GROWING = {
    (2, 1): "",
    (8, 1): "",
    (2, 2): "1.525048 17377.26517",
    (4, 2): "2.456764 17352.85980",
    (8, 2): "3.139914 17305.60032",
    (2, 3): "73.38720 17333.0812",
    (4, 3): "74.05679 17308.9855",
    (8, 3): "74.36780 17262.4014",
    (4, 4): "2.399171 4939.92629, 6.766246 10122.19875, 163.887240 17278.62914",
    (4, 5): "13.500952 4942.47093, 22.302163 10131.40781, 266.453062 17270.33905",
    (3, 2.5): "35.58783 17341.7404",
    (6, 2): "2.86192 17329.1334",
}


def numbers(speed: float, friction: float) -> dict[str, float]:
    """The numbers of the scene: speed over pi, scale of friction."""
    return {SPEED: speed * np.pi, FRICTION: friction}


def as_printed(values, text: str) -> None:
    """Check the values against a list of `real imaginary`, to 1e-7 of the size or the last digit printed."""
    printed = [line.split() for line in text.split(",") if line.strip()]
    assert len(values) == len(printed)
    for value, pair in zip(values, printed, strict=True):
        for number, digits in zip((value.real, value.imag), pair, strict=True):
            last = 0.5000001 * 10.0 ** -len(digits.partition(".")[2])
            assert abs(number - float(digits)) <= max(last, 1e-7 * abs(value)), (value, pair)


def test_the_full_matrices_have_the_published_eigenvalues_heavily_damped_ones_among_them():
    pairs = complex_eigenvalues(*brake().pencil(numbers(4, 1)), UP_TO)
    as_printed(pairs.values, AT_ONE)
    assert pairs.residual.max() < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("point", GROWING)
def test_the_full_matrices_grow_as_published(point):
    values = complex_eigenvalues(*brake().pencil(numbers(*point)), UP_TO).values
    as_printed(values[values.real > 0.5], GROWING[point])


@pytest.mark.slow
@pytest.mark.parametrize(("speed", "onset"), [(2, 1.97543), (4, 1.96023), (8, 1.94891)])
def test_flutter_sets_in_at_the_published_friction(speed, onset):
    def growth(friction):
        values = complex_eigenvalues(*brake().pencil(numbers(speed, friction)), 17450.0, low=17200.0).values
        return values.real.max()

    low, high = onset - 1e-4, onset + 1e-4
    assert growth(low) < 0 < growth(high)


@pytest.fixture(scope="module", params=[(120, 1e-6), (220, 1e-8)], ids=["120", "220"])
def trained(request):
    """A basis that is trained for the range, the number of its vectors, its error, and the time it took [s]."""
    vectors, error = request.param
    started = time.process_time()
    reduction = Reduction("snapshots", up_to=UP_TO, over=RANGE, vectors=vectors, error=error)
    return build(brake(), reduction), vectors, error, time.process_time() - started


@pytest.mark.slow
def test_a_trained_basis_gives_all_eigenvalues_at_points_drawn_anew_and_knows_its_error(trained):
    reduced, vectors, error, seconds = trained
    assert reduced.coordinates == vectors
    assert reduced.error <= error
    assert seconds < 150
    draw = np.random.default_rng(seed=time.time_ns())
    estimator = Estimator(brake(), UP_TO, numbers(4, 1.5))
    for _ in range(4):
        point = numbers(draw.uniform(2, 8), draw.uniform(0, 3))
        exact = complex_eigenvalues(*brake().pencil(point), UP_TO).values
        estimates = estimator.at(reduced, point)
        assert estimates.values.size == exact.size, point
        true = np.abs(estimates.values - exact) / np.abs(exact)
        assert true.max() < error, point
        told = true > 1e-8
        assert np.all((estimates.relative < 2 * true) & (true < 2 * estimates.relative) | ~told), point
        assert not reduced.outside(point)


@pytest.mark.slow
def test_outside_of_the_trained_range_the_estimate_says_what_is_lost(trained):
    reduced = trained[0]
    point = numbers(4, 5)
    assert reduced.outside(point) == [
        f"{FRICTION} = 5 lies outside of the range that the basis was trained for, 0 to 3"
    ]
    exact = complex_eigenvalues(*brake().pencil(point), UP_TO).values
    estimates = Estimator(brake(), UP_TO, point).at(reduced, point)
    true = np.abs(estimates.values - exact) / np.abs(exact)
    assert true.max() > 3 * reduced.error
    assert true.max() / 2 < estimates.relative.max() < 2 * true.max()
