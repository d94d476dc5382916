"""Progress of long commands where standard error is no terminal."""

from types import SimpleNamespace

import pytest

from rig.cli import printing


@pytest.fixture
def clock(monkeypatch):
    """The time that the progress reads [s]."""
    time = SimpleNamespace(now=0.0)
    monkeypatch.setattr(printing.time, "monotonic", lambda: time.now)
    return time


def test_without_a_terminal_progress_is_a_line_now_and_then_with_rate_and_remaining_time(capsys, clock):
    """Ten rows were there before: they count for nothing in the rate."""
    with printing.bar("rows") as show:
        for clock.now, done in ((0.0, 10), (1.0, 11), (5.5, 21), (6.0, 30), (11.0, 32), (12.0, 40)):
            show(done, 40)
    told = ["rows: 21 of 40, 2/s, about 10 s left", "rows: 32 of 40, 2/s, about 4 s left", "rows: 40 of 40"]
    assert capsys.readouterr() == ("", "".join(f"{line}\n" for line in told))


def test_a_slow_work_is_told_in_parts_per_minute_and_without_a_rate_nothing_is_estimated(capsys, clock):
    with printing.bar("rows") as show:
        for clock.now, done in ((0.0, 0), (6.0, 0), (120.0, 2)):
            show(done, 400)
    assert capsys.readouterr().err == "rows: 0 of 400\nrows: 2 of 400, 1/min, about 7 h left\n"


def test_short_work_prints_no_progress(capsys):
    with printing.bar("rows") as show:
        show(1, 1)
    assert capsys.readouterr() == ("", "")
