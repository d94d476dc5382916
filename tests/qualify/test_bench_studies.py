"""The benchmark of studies: its works can be carried out, and a point that computes nothing costs next to nothing."""

import pytest

from rig.qualify.benchmarks.rates import rate
from rig.qualify.benchmarks.studies import Empty, points


@pytest.mark.parametrize("what", ["P1", "loop"])
def test_the_works_are_studies(what):
    work = points(what, 3)
    assert work.total == 3
    assert all(work.scene_of(k) for k in range(3))


def test_a_point_costs_less_than_a_millisecond():
    assert rate(Empty(4_000), 1).units > 1_000.0
