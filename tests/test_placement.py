"""On which cores a live run works, and that nothing stays there afterwards."""

import os
import sys
import threading

import pytest

from rig import bus
from rig.machine import scheduling

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux says where a thread runs")


@pytest.fixture
def allowed():
    before = os.sched_getaffinity(0)
    if len(before) < 2:
        pytest.skip("one core")
    yield before
    os.sched_setaffinity(0, before)


def test_two_cores_of_those_that_this_process_may_use(allowed):
    own, of_bus = scheduling.choose()
    assert own != of_bus
    assert {own, of_bus} <= allowed


def test_the_thread_and_those_of_the_bus_are_placed_and_others_go_where_they_like(tmp_path, monkeypatch, allowed):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    own, of_bus = scheduling.choose()
    found = {}

    def look():
        scheduling.anywhere()
        found["other"] = os.sched_getaffinity(0)

    with bus.host("placed"):
        with scheduling.placed(own, of_bus):
            threads = scheduling.bus_threads()
            assert threads
            assert {frozenset(os.sched_getaffinity(thread)) for thread in threads} == {frozenset({of_bus})}
            assert os.sched_getaffinity(0) == {own}
            other = threading.Thread(target=look)
            other.start()
            other.join()
        assert found["other"] == allowed
        assert {frozenset(os.sched_getaffinity(thread)) for thread in [0, *threads]} == {frozenset(allowed)}
