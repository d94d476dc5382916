"""A controller as a real process, over a private unix socket."""

import contextlib
import subprocess
import sys
import time
from pathlib import Path

import pytest
from controlled_plant import ROOT, Plant, described

from rig import bus
from rig.controllers.runtime import process


@pytest.fixture
def private(tmp_path, monkeypatch):
    """A runtime directory of this test's own."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path


@contextlib.contextmanager
def spawned(what, **given):
    """A hub in this process and the controller in one of its own."""
    with bus.host(run="here") as session:
        plant = Plant(session)
        setup = described(**given)
        server = session.serve("scene", lambda _: setup.to_json())
        door = session.serve("cmd/plant", lambda _: {})
        session.announce()
        name = Path(what).stem
        command = [sys.executable, "-m", "rig.controllers.runtime.process", what, "--run", "here"]
        with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True) as child:
            try:
                deadline = time.monotonic() + 20.0
                while ("controller", name) not in plant.watch.present and time.monotonic() < deadline:
                    server.poll(0.02)
                    door.poll()
                    plant.watch.poll()
                    if child.poll() is not None:
                        break
                yield plant, child, session
            finally:
                child.kill()


def ended(child, within):
    """Exit code of a process that must end by itself."""
    return child.wait(within)


def test_a_real_process_answers_over_a_private_socket_and_ends_with_the_plant(private):
    with spawned("feedback") as (plant, child, session):
        for tick in range(50):
            plant.send(tick, 0.05)
            act = plant.answer()
            assert (act.tick, list(act.values)) == (tick, [10.0])
        session.close()
        assert ended(child, 3.0) == 0


def test_a_fault_in_a_file_of_ones_own_is_told_with_its_trace(private, tmp_path):
    text = (ROOT / "docs" / "example_controller.py").read_text()
    path = tmp_path / "mine.py"
    path.write_text(text.replace("(v,) = values", "(v,) = values\n        1.0 / (t_ns - 2_000_000)"))
    with spawned(str(path)) as (plant, child, _):
        for tick in range(3):
            plant.send(tick, 0.05)
        assert ended(child, 3.0) == 1
        told = child.stderr.read()
        assert "controller mine failed at t = 0.002 s" in told
        assert "ZeroDivisionError" in told
        assert [plant.answer().tick for _ in range(2)] == [0, 1]
        assert [plant.event().kind, plant.event().kind] == ["fault", "left"]


def test_without_a_run_it_says_so_and_ends(private):
    assert process.main(["feedback", "--wait", "0"]) == 2
