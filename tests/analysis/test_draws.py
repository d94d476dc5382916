"""Draws of values that the data hardly tell: what their weights say of a density that is known in closed form."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from rig.analysis.identification.fit import Solution
from rig.analysis.identification.proposals import Proposal, Space

LOW, HIGH = np.log([0.05, 0.05, 0.001]), np.log([2.0, 2.0, 1.0])


def fitted(covariance, middle):
    """Two coefficients and a mass, with the solution of a fit."""
    free = [SimpleNamespace(log=True, unit=unit) for unit in ("", "", "kg")]
    fit = SimpleNamespace(free=free, low=LOW, high=HIGH, logs=np.ones(3, dtype=bool))
    solution = Solution(np.array(middle), 0.0, [], [], np.zeros(3), [], covariance=np.array(covariance))
    return Space.of(fit, solution), solution


ALIKE = [[0.25, 0.2499, 0.0], [0.2499, 0.25, 0.0], [0.0, 0.0, 0.04]]
MIDDLE = np.log([0.33, 0.31, 0.03])


@pytest.mark.parametrize("anywhere", [[False, False, False], [True, False, False]])
def test_weights_of_draws_give_a_volume_and_the_mean_of_a_normal_distribution(anywhere):
    space, solution = fitted(ALIKE, MIDDLE)
    centre = space.straight(MIDDLE[None])
    proposal = Proposal(space, centre, np.ones(1), space.covariance(solution), np.array(anywhere), seed=3)
    u = proposal.draws(4096)
    assert space.inside(u).all()
    asked, covariance = centre[0] + 0.2, 0.7 * space.covariance(solution)
    density = multivariate_normal(asked, covariance).pdf(u)
    weights = density / proposal.density(u)
    assert weights.mean() == pytest.approx(1.0, abs=0.02)
    assert weights @ u / weights.sum() == pytest.approx(asked, abs=0.02)
    assert np.cov(u.T, aweights=weights) == pytest.approx(covariance, rel=0.1, abs=0.01)
