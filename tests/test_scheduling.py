"""Who comes first on a processor, and what that takes from the others."""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="asks Linux")

ALLOWED = """
import os
try:
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    print()
except OSError as fault:
    print(fault)
"""
FIRST = """
import os
from rig.machine.scheduling import come_first
come_first()
print(os.sched_getscheduler(0) == os.SCHED_OTHER, os.getpriority(os.PRIO_PROCESS, 0))
"""
THREADS = """
import os, resource, signal, threading, time
from rig.machine.scheduling import ahead
before = resource.getrlimit(resource.RLIMIT_RTTIME), signal.getsignal(signal.SIGXCPU)
def of_all(): return {os.sched_getscheduler(int(t)) for t in os.listdir("/proc/self/task")}
threading.Thread(target=time.sleep, args=(5,), daemon=True).start()
with ahead(7) as found:
    assert found.why == found.account == "", found.why
    assert of_all() == {os.SCHED_FIFO}
    threading.Thread(target=time.sleep, args=(5,), daemon=True).start()
    assert of_all() == {os.SCHED_FIFO}
    assert os.sched_getparam(0).sched_priority == 7
assert of_all() == {os.SCHED_OTHER}
assert before == (resource.getrlimit(resource.RLIMIT_RTTIME), signal.getsignal(signal.SIGXCPU))
print("done")
"""
HOGS = """
import os, time
from rig.machine.scheduling import ahead
told = []
with ahead(1, lambda: told.append("fell back")):
    end = time.perf_counter() + 10.0
    while not told and time.perf_counter() < end:
        pass
    print(*told, os.sched_getscheduler(0) == os.SCHED_OTHER)
"""


def said(code):
    done = subprocess.run([sys.executable, "-c", code], text=True, timeout=30, capture_output=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.fixture(scope="module")
def allowed():
    if why := said(ALLOWED):
        pytest.skip(why)


def test_to_come_first_takes_nothing_from_anybody():
    assert said(FIRST).split()[0] == "True"


def test_all_threads_go_ahead_and_come_back(allowed):
    assert said(THREADS) == "done"


def test_who_leaves_no_pause_falls_back(allowed):
    assert said(HOGS) == "fell back True"
