"""A live run of parts from files: each process gets what it needs, and strangers who join run no code unasked."""

import pytest

from rig import controllers
from rig.errors import Untrusted
from rig.record.reader import head


def test_a_live_run_with_parts_and_who_joins_it(rig, runs, folder, strangers, monkeypatch):
    monkeypatch.chdir(folder)
    log = folder / "live.mcap"
    how = ("--duration", "0.3", "--pace", "max", "--lockstep", "--out", log)
    code, out, err = rig("run", folder / "scene.toml", *how)
    assert code == 0, out + err
    assert "two_levels: 300 commands" in out
    strangers()
    setup = head(log).setup()
    with pytest.raises(Untrusted, match=r"example_controller\.py"):
        controllers.restored(setup.controllers["two_levels"])
    code, _, err = rig("replay", log, "--into", "two_levels", "--pace", "max")
    assert code == 2
    assert "--trust" in err
    code, out, err = rig("replay", log, "--into", "two_levels", "--pace", "max", "--trust")
    assert code == 0, out + err
    assert "no command differs" in out
    code, out, err = rig("verify", log, "--trust")
    assert code == 0, out + err


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
