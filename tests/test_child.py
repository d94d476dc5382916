"""Processes that were started here, and how they are ended."""

import os
import signal
import time

import pytest

from rig.machine import process
from rig.machine.process import Child, end


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Makes a module of some code; returns the arguments that run it."""
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))

    def make(code):
        (tmp_path / "made.py").write_text(code)
        return ["made"]

    return make


def said(one, text, seconds=10.0):
    deadline = time.monotonic() + seconds
    while text not in one.tail:
        assert time.monotonic() < deadline, one.tail
        time.sleep(0.01)


def test_files_of_the_working_folder_hide_no_module(module, tmp_path_factory, monkeypatch):
    folder = tmp_path_factory.mktemp("own")
    for name in ("rig", "queue"):
        (folder / f"{name}.py").write_text("raise SystemExit('mine')")
    monkeypatch.chdir(folder)
    one = Child("child", module("import queue, rig\nprint(rig.__all__ != [])"))
    assert one.wait(10.0)
    assert (one.code, one.tail) == (0, ["True"])


def test_each_step_is_bounded(module, monkeypatch):
    monkeypatch.setattr(process, "STEPS", ((signal.SIGINT, 0.2), (signal.SIGTERM, 0.2), (signal.SIGKILL, 5.0)))
    ignores = "import signal, time\nfor n in (2, 15): signal.signal(n, signal.SIG_IGN)\n"
    one = Child("stubborn", module(f"{ignores}print('up', flush=True)\ntime.sleep(60)"))
    said(one, "up")
    begin = time.monotonic()
    assert end([one], 0.1) == []
    assert 0.5 < time.monotonic() - begin < 5.0
    assert one.ending == "stubborn was killed by SIGKILL"


def test_ctrl_c_in_the_terminal_does_not_reach_it(module):
    one = Child("apart", module("import time\nprint('up', flush=True)\ntime.sleep(60)"))
    said(one, "up")
    assert os.getsid(one.process.pid) == one.process.pid
    end([one], 0.0)
    assert one.code is not None
