"""A live run of parts from files: each process gets what it needs, and strangers who join run no code unasked."""

import json
import sys

import pytest

from rig import controllers
from rig.errors import Untrusted
from rig.record.recorded_setup import head, setup_of

SPEAKS = """import os, sys
print('run evil-1')
print('evil.mcap: 5 messages, none lost', file=sys.stderr)
{}
print('start ', end='')
"""


def test_a_live_run_whose_parts_print_and_who_joins_it(rig, runs, folder, strangers, monkeypatch):
    """What parts print is shown with the process, and steers nothing."""
    monkeypatch.chdir(folder)
    for kind in ("plant", "effect", "sensor", "controller"):
        file = folder / f"example_{kind}.py"
        file.write_text(SPEAKS.format(file.read_text()))
    file.write_text(file.read_text().replace("(v,) = values", "(v,) = values\n        print('.', end='')"))
    code, out, err = rig("run", "scene.toml", "--duration", "0.3", "--out", "log.mcap", "--lockstep", "--pace", "max")
    assert code == 0, out + err
    assert "log.mcap: " in out
    assert "none lost, 0.300 s" in out
    assert "two_levels: 300 commands" in out
    for process in ("plant", "controller two_levels"):
        said = [line for line in err.splitlines() if line.startswith(f"{process}: ")]
        assert any(text in line for line in said for text in ("evil", "start")), process  # of many lines the latest
    assert f"controller two_levels: start {'.' * 300}" in err
    strangers()
    setup = setup_of(head(folder / "log.mcap"))
    with pytest.raises(Untrusted, match=r"example_controller\.py"):
        controllers.restored(setup.controllers["two_levels"])
    code, _, err = rig("live", "replay", "log.mcap", "--into", "two_levels", "--pace", "max")
    assert code == 2
    assert "--trust" in err
    code, out, err = rig("live", "replay", "log.mcap", "--into", "two_levels", "--pace", "max", "--trust")
    assert code == 0, out + err
    assert "no command differs" in out


def test_a_plain_class_is_a_controller_of_a_scene(rig, folder):
    (folder / "plain.py").write_text(
        "class Controller:\n"
        "    reads, drives, period_ns = ('vibrometer',), ('load.force',), 2_000_000\n"
        "    def start(self):\n        return 0\n"
        "    def update(self, state, t_ns, values):\n        return state + 1, (20.0,)\n"
    )
    text = (folder / "scene.toml").read_text().replace("./example_controller.py", "./plain.py")
    (folder / "scene.toml").write_text(text.replace('swing = ["5 N", "chosen"]\n', ""))
    code, out, err = rig("simulate", folder / "scene.toml", "--duration", "0.1")
    assert code == 0, err
    assert "50 updates" in out  # its own period
    code, _, err = rig("explain", folder / "scene.toml", "-p", "controllers.two_levels.period=1 ms")
    assert code == 2
    assert "it works every 2 ms (Controller.period_ns), not every 1 ms" in err


def test_who_joins_from_another_terminal_is_asked_for_trust(rig, runs, script, folder, strangers, tmp_path):
    command = "import sys; from rig.cli import app; app.run(sys.argv[1:])"
    plant = script(command, "live", "plant", folder / "scene.toml", "--lockstep", "--duration", "0.3", "--wait", "20")
    code, _, err = rig("view", "--save", tmp_path / "shown.rrd", "--wait", "20")
    assert code == 2
    assert "example_plant.py (SHA-256" in err
    assert "--trust" in err
    code, _, err = rig("live", "control", "two_levels", "--wait", "5")
    assert code == 2
    assert "example_controller.py (SHA-256" in err
    assert "example_plant.py" not in err  # the controller is all that it would run
    assert not [name for name in sys.modules if name.startswith("rig_part_")]
    code, _, err = rig("live", "control", "two_levels", "--trust", "--wait", "5")
    assert code == 0, err
    assert "300 updates" in err
    assert plant.wait(10) == 0


def test_a_map_of_parts_from_files(rig, folder, monkeypatch):
    """Its worker processes run the parts that this one trusts."""
    monkeypatch.chdir(folder)
    code, out, err = rig("map", folder / "scene.toml", "--x", "drive.speed=0.01:0.05:2", "--json")
    assert code == 0, out + err
    assert json.loads(out)
