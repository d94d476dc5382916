"""Why frames were late: what other programs and the host took."""

import pytest

from rig.bench.live import pace
from rig.bench.live.pace import MachineLoad, advice

BUSY = {"others": 0.62, "host": 0.05}


def test_a_busy_machine_is_told_in_one_line():
    text = advice("INVALID", 0.2, BUSY)
    assert "\n" not in text
    assert "other programs took 62%" in text
    assert "the host of this machine took 5%" in text
    assert "run again" in text

    assert "host" not in advice("INVALID", 0.2, {"others": 0.62, "host": 0.001})  # rounds to nothing
    assert "not busy" in advice("DEGRADED", 0.03, {"others": 0.05, "host": 0.0})


@pytest.mark.parametrize(
    ("verdict", "late", "shares"), [("VALID", 0.005, BUSY), ("DEGRADED", 0.0, BUSY), ("INVALID", 0.2, {})]
)
def test_nothing_is_told_of_a_valid_run_of_losses_and_of_an_unknown_machine(verdict, late, shares):
    assert advice(verdict, late, shares) == ""


def test_children_that_have_ended_are_no_other_programs(monkeypatch):
    """Of 2 s on one core, children took 0.5 s, others 1 s and the host 0.25 s; the numbers of before are subtracted."""
    told = iter([(0, 10**9, 0.0, 0), (2 * 10**9, 25 * 10**8, 0.5, 250_000_000)])

    def at(row):
        wall, others, children, host = row
        monkeypatch.setattr(pace, "spent", lambda: pace.ProcessorTime(wall, others))
        monkeypatch.setattr(pace, "stolen_ns", lambda: host)
        times = type("Times", (), {"children_user": children, "children_system": 0.0})
        monkeypatch.setattr(pace.os, "times", lambda: times)

    monkeypatch.setattr(pace.os, "cpu_count", lambda: 1)
    at(next(told))
    load = MachineLoad()
    at(next(told))
    assert load.shares() == {"others": 0.5, "host": 0.125}
