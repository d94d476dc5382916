"""The benchmark of studies: its works can be carried out, and a point that computes nothing costs next to nothing."""

import numpy as np
import pytest

from benchmarks import studies
from benchmarks.studies import Rate, Workers, compared, overhead_ms, points, rate, row
from rig.analysis.pool import Work


@pytest.mark.parametrize("what", ["P1", "loop"])
def test_the_works_are_studies(what):
    work = points(what, 3)
    assert [set(work.compute(k)) for k in range(work.total)] == 3 * [{"values", "units", "reason"}]


def test_a_point_costs_less_than_a_millisecond():
    assert overhead_ms(1_000) < 1.0


def test_a_rate_counts_from_the_instant_at_which_all_workers_have_finished_a_unit(monkeypatch):
    """Two workers, ten units of 1 s, the second one 2.5 s late: 6.5 units, then idle for 0.5 s of 3.5 s."""
    times = [(1.0, t, t + 1.0) for t in range(7)] + [(2.0, t + 2.5, t + 3.5) for t in range(3)]
    results = {k: {"#times": np.array(of_unit)} for k, of_unit in enumerate(times)}
    monkeypatch.setattr(studies, "carry_out", lambda *a, **kw: results)
    assert rate(Work(row, range(10)), Workers(2)).units == pytest.approx((3.5 + 2.0) / 3.5)


def test_efficiency_is_the_median_of_the_rounds():
    two = compared([Rate(19.0, 1.0), Rate(5.0, 1.0), Rate(18.0, 2.0)], [Rate(20.0, 1.0)] * 3)
    assert two["efficiency"] == pytest.approx(0.9)
    assert (two["least"], two["greatest"]) == pytest.approx((0.25, 0.95))
