"""Least squares along a direction of which the data tell nothing: small errors of responses must not tell a value."""

from types import SimpleNamespace

import numpy as np
import pytest

from rig.analysis.identification.fit import Fit, Offsets
from rig.analysis.identification.runs import Free

PHASE = np.linspace(0.0, 1.0, 200)
KEYS = ("friction.mu_static", "friction.mu_dynamic", "body.damping")
TRUE = (0.4, 0.25, 2.0)
FROM = (0.6, 0.3, 1.5)


class Model:
    """Cycles whose shape has the difference of two coefficients and a damping, and whose level an offset takes up.

    Each response has an error of its own, as the tolerance of an integration has, and `level` tells of the sum.
    """

    def __init__(self, level):
        self.level = level
        self.asked = 0

    def responses(self, points, runs):
        self.asked += len(points)
        return [[self.wave(*point) for _ in runs] for point in points]

    def wave(self, static, dynamic, damping):
        drop = static - dynamic
        error = np.random.default_rng(abs(hash((static, dynamic, damping)))).standard_normal(4)
        wave = 1e3 * (drop * np.sin(2.0 * np.pi * PHASE) + static + np.exp(-damping * PHASE))
        wave = wave + self.level * static * np.cos(4.0 * np.pi * PHASE)
        return wave * (1.0 + 3e-7 * error @ np.array([np.sin(k * np.pi * PHASE) for k in (1, 3, 5, 7)]))


def fitted(level):
    model = Model(level)
    chance = np.random.default_rng(4)
    measured = model.wave(*TRUE) + 80.0 + chance.standard_normal((40, 1)) + 0.3 * chance.standard_normal((40, 200))
    free = [Free(key, "1", 0.1 * value, 10.0 * value, value) for key, value in zip(KEYS, FROM)]
    offsets = Offsets(((0,),), ("offset of laser",), (1.0,))
    fit = Fit(free, SimpleNamespace(responses=model.responses), [0], offsets, lambda i, w, o: measured - w - o[0])
    start = np.array([parameter.coordinate(parameter.stated) for parameter in free])
    solution = fit.run(np.append(start, 0.0))
    return model, solution


def test_errors_of_responses_tell_no_value_along_a_flat_direction():
    model, solution = fitted(level=0.0)
    assert solution.converged
    assert solution.flat == (True, True, False)
    static, dynamic, damping = np.exp(solution.z[:3])
    sd = np.sqrt(np.diag(solution.covariance))
    assert min(sd[:2]) > 0.5
    assert sd[2] < 0.01
    assert abs(np.log(damping / TRUE[2])) < 4.0 * sd[2]
    assert static - dynamic == pytest.approx(TRUE[0] - TRUE[1], rel=0.01)
    assert model.asked < 200


@pytest.mark.parametrize("level", [5.0, 20.0])
def test_a_direction_of_which_little_is_told_keeps_its_interval(level):
    """The sum of squares rises along it as its derivatives say."""
    _, solution = fitted(level)
    assert solution.converged
    assert not any(solution.flat)
    sd = np.sqrt(np.diag(solution.covariance))
    for z, s, true in zip(solution.z[:3], sd, TRUE):
        assert abs(z - np.log(true)) < 4.0 * s
        assert s < 0.1
