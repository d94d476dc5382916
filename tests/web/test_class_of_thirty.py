"""Thirty watchers for a minute, and who disturbs a class: the plant does not notice."""

import pytest

pytest.importorskip("cryptography")


@pytest.mark.slow
@pytest.mark.parametrize("disturbed", [False, True])
def test_thirty_watch_and_the_plant_does_not_notice(runs, disturbed):
    from benchmarks.classroom import classroom

    told = classroom(60.0, disturbed)
    assert told["verdict"] == "VALID", told
    assert told["pictures_per_s"] >= 8.0
    assert told["delay_s"]["p99"] <= 0.25
    assert told["memory_MB"] <= 3.0
