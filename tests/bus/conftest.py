"""A private directory of runs for each test, and one bus that is Zenoh or its twin."""

import os
import shutil
import subprocess
import sys
import tempfile
import threading
from contextlib import ExitStack
from pathlib import Path

import pytest

from rig import bus
from rig.bus.twin import Twin


@pytest.fixture
def runs(monkeypatch):
    """A directory of live runs that belongs to this test alone; short, for socket paths are."""
    here = tempfile.mkdtemp(prefix="rig-")
    monkeypatch.setenv("XDG_RUNTIME_DIR", here)
    yield Path(here)
    shutil.rmtree(here)


class Wire:
    """A plant's session and as many others as a test wants."""

    def __init__(self, stack: ExitStack, twin: bool) -> None:
        self._stack = stack
        self._twin = Twin("test") if twin else None
        self.plant = stack.enter_context(self._twin.open("plant", "plant") if self._twin else bus.host("test"))

    def join(self, role="controller", name="one"):
        return self._stack.enter_context(
            self._twin.open(role, name) if self._twin else bus.join("test", role=role, name=name)
        )


@pytest.fixture(params=["twin", "zenoh"])
def wire(request, runs):
    with ExitStack() as stack:
        yield Wire(stack, request.param == "twin")


@pytest.fixture
def script(runs):
    """Starts Python code in a process of its own; each is gone after 25 s, or after the test."""
    started = []

    def start(code, *args):
        process = subprocess.Popen(
            [sys.executable, "-c", code, *map(str, args)],
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
        )
        started.append((process, threading.Timer(25.0, process.kill)))
        started[-1][1].start()
        return process

    yield start
    for process, deadline in started:
        deadline.cancel()
        process.kill()
        process.communicate()
