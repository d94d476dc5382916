"""Why frames were late: what other programs and the host took."""

import os
import subprocess
import sys
import time

import pytest

from rig.bench.live.pace import MachineLoad, advice

BUSY = {"others": 0.62, "host": 0.05}


def test_a_busy_machine_is_told_in_one_line():
    text = advice("INVALID", 0.2, BUSY)
    assert "\n" not in text
    assert "other programs took 62%" in text
    assert "the host of this machine took 5%" in text
    assert "run again" in text


def test_a_share_that_rounds_to_nothing_is_not_told():
    assert "host" not in advice("INVALID", 0.2, {"others": 0.62, "host": 0.001})


def test_a_free_machine_is_not_blamed():
    assert "not busy" in advice("DEGRADED", 0.03, {"others": 0.05, "host": 0.0})


@pytest.mark.parametrize(
    ("verdict", "late", "shares"), [("VALID", 0.005, BUSY), ("DEGRADED", 0.0, BUSY), ("INVALID", 0.2, {})]
)
def test_nothing_is_told_of_a_valid_run_of_losses_and_of_an_unknown_machine(verdict, late, shares):
    assert advice(verdict, late, shares) == ""


@pytest.mark.skipif(sys.platform != "linux", reason="the load is read from /proc/stat")
def test_children_that_have_ended_are_no_other_programs():
    load = MachineLoad()
    code = "import time; end = time.process_time() + 0.3\nwhile time.process_time() < end: pass"
    begin, before = time.perf_counter(), os.times()
    subprocess.run([sys.executable, "-c", code], check=True)
    own = os.times().children_user + os.times().children_system - before.children_user - before.children_system
    whole = (time.perf_counter() - begin) * (os.cpu_count() or 1)
    shares = load.shares()
    assert own >= 0.3
    assert 0.0 <= shares["others"] <= 1.0 - own / whole + 0.15  # processor time is counted in steps of 10 ms
