"""What tests of several rooms share."""

import ctypes
import gc
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from importlib import import_module
from pathlib import Path

import figure_rules
import numpy as np
import psutil
import pytest
from hypothesis import HealthCheck, settings
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

from rig import scenes
from rig.cli import app

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # a shell started the tests in the background
    signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile(
    "same",
    deadline=None,  # an example is slow when the machine is busy
    derandomize=True,  # the same on every machine
    suppress_health_check=[HealthCheck.too_slow],  # that is the load of the machine
)
settings.load_profile("same")


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Without the garbage collector, which would search half a million objects again and again; they all stay."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(100_000)  # new objects, as in the processes of a run: a twentieth of the time of all tests
        gc.enable()


def chain(rate, guards, follow, mode, y, duration):
    """Event times by scipy's DOP853, phase by phase: the solver's independent witness, good to about 1e-12 s.

    rate(mode, t, y) -> y'; guards(mode): functions g(t, y), positive while the mode holds; follow(mode, guard, t, y) ->
    mode and y after the event.
    """
    how = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-15}
    t, times = 0.0, []
    while True:

        def flow(t, y, mode=mode):
            return rate(mode, t, y)

        events = list(guards(mode))
        for event in events:
            event.terminal, event.direction = True, -1.0
        shortly = min(t + 1e-9, duration)  # a guard that has just begun at zero is positive then
        y = solve_ivp(flow, (t, shortly), y, **how).y[:, -1]
        part = solve_ivp(flow, (shortly, duration), y, events=events, max_step=duration / 100.0, **how)
        if part.status != 1:
            return np.array(times)
        which = next(i for i, found in enumerate(part.t_events) if len(found))
        t, y = part.t_events[which][0], part.y_events[which][0]
        times.append(t)
        mode, y = follow(mode, which, t, y)


@pytest.fixture(scope="session", name="chain")
def chain_fixture():
    return chain


@pytest.fixture(scope="session", autouse=True)
def _one_worker():
    """Studies compute in this process unless a test asks for workers: the tests themselves take all cores."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(import_module("rig.analysis.pool.carry_out"), "cores", lambda: 1)
        yield


_return_unused = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
_PROCESS = psutil.Process()
_MUCH = 100_000_000  # bytes


class _Memory:
    """Returns memory to the system, before a process of the tests has taken gigabytes."""

    def __init__(self):
        self._left = 0

    def free(self):
        gc.collect()
        if _return_unused:  # glibc keeps what is free between objects in use: up to 0.5 GB
            _return_unused(0)
        self._left = _PROCESS.memory_info().rss

    def free_much(self):
        if _PROCESS.memory_info().rss > self._left + _MUCH:
            self.free()


@pytest.fixture(scope="module", autouse=True)
def _memory():
    """What stays from earlier modules is not searched again: each run begins with a collection of garbage."""
    memory = _Memory()
    memory.free()  # garbage that is frozen is never freed
    gc.freeze()
    return memory


@pytest.fixture(autouse=True)
def _freed(_memory):
    """A test that took much memory gives it back before the next one begins."""
    yield
    _memory.free_much()


@pytest.fixture(scope="session")
def _figures():
    """Faults of the figures that tests save, until the test that drew them has read them."""
    found, save = [], Figure.savefig

    def watched(figure, *arguments, **options):
        save(figure, *arguments, **options)
        if options.get("format") != "png":  # its layout was made for the resolution of the file
            figure.draw_without_rendering()
        found.extend(figure_rules.faults(figure))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", watched)
        yield found


@pytest.fixture(autouse=True)
def _figures_can_be_read(_figures):
    """Every figure that a test saves satisfies the rules of figure_rules.py."""
    yield
    found = list(dict.fromkeys(_figures))
    _figures.clear()
    assert not found, "\n".join(found)


@pytest.fixture
def rig(capsys):
    """Runs a command in this process: exit code, standard output, standard error."""

    def call(*arguments):
        with pytest.raises(SystemExit) as left:
            app.run([str(a) for a in arguments])
        said = capsys.readouterr()
        return left.value.code or 0, said.out, said.err

    return call


@pytest.fixture(scope="session")
def shipped():
    """All shipped scenes, loaded once."""
    return tuple(map(scenes.load, scenes.names()))


@pytest.fixture
def runs(monkeypatch):
    """A directory of live runs that belongs to this test alone; short, for socket paths are."""
    here = tempfile.mkdtemp(prefix="rig-")
    monkeypatch.setenv("XDG_RUNTIME_DIR", here)
    monkeypatch.setenv("XDG_STATE_HOME", here)  # the messages of the last run
    yield Path(here)
    shutil.rmtree(here)


@pytest.fixture
def script(runs):
    """Starts Python code in a process of its own; each is gone after two minutes, or after the test."""
    started = []

    def start(code, *args):
        process = subprocess.Popen(
            [sys.executable, "-c", code, *map(str, args)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])},
        )
        started.append((process, threading.Timer(120.0, process.kill)))
        started[-1][1].start()
        return process

    yield start
    for process, deadline in started:
        deadline.cancel()
        process.kill()
        process.communicate()
