"""The benchmark of studies: its works can be carried out, and a point that computes nothing costs next to nothing."""

from benchmarks.studies import overhead_ms


def test_a_point_costs_less_than_a_millisecond():
    assert overhead_ms(1_000) < 1.0
