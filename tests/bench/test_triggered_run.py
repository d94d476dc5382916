"""A run of which only windows are recorded: what of them can be verified, and what the run says of them."""

import numpy as np
import pytest

import rig as lab
from rig import scenes
from rig.bench.again.verify import verify
from rig.bench.live import supervise
from rig.bench.live.plant_process import warm
from rig.record.windows import Trigger, condition

SCENE = "belt_normal_force"


@pytest.fixture(scope="module")
def windows(tmp_path_factory):
    """Recordings of a lockstep run of 2.5 s whose mass slides backwards faster than 50 mm/s once in a period."""
    folder = tmp_path_factory.mktemp("w")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", str(folder))
        patch.setenv("XDG_STATE_HOME", str(folder))
        scene = scenes.load(SCENE, {"controllers.nf.enable_at": "1 s"})
        warm(scene)
        wanted = Trigger(condition("vibrometer < -50 mm/s"), before=0.5, after=0.3, most=2)
        outcome = supervise.run(scene, pace=None, duration=2.5, out=folder / "w.mcap", trigger=wanted.options())
    return outcome, [folder / "w-001.mcap", folder / "w-002.mcap"]


def test_the_run_says_what_was_recorded(windows):
    outcome, paths = windows
    assert outcome.exit_code == 0, outcome.text()
    assert all(path.exists() for path in paths)
    assert "w-001.mcap to w-002.mcap: 2 recordings of vibrometer < -50 mm/s (--most: " in outcome.account
    assert "none lost" in outcome.account


def test_the_messages_of_a_run_are_kept_for_a_bug_report(windows):
    outcome, paths = windows
    kept = (paths[0].parent / "friction-rig" / "last_run.log").read_text()
    assert f"run {outcome.summary['run']}" in kept
    assert outcome.text() in kept


def test_a_window_from_the_begin_on_is_simulated_again_bit_by_bit(windows):
    found = verify(windows[1][0])
    assert lab.open(windows[1][0]).begin_ns == 0
    assert found.passed, found.text()
    assert found.simulated
    assert found.identical
    assert found.compared > 1000


def test_a_later_window_is_proved_by_checksums_and_says_what_is_not(windows, rig):
    code, out, err = rig("verify", windows[1][1])
    run = lab.open(windows[1][1])
    assert (code, err) == (0, "")
    assert run.begin_ns > 0
    assert "undamaged, but not simulated again" in out
    assert f"t = {run.begin_ns * 1e-9:.3f} to " in out
    assert "vibrometer < -50 mm/s held at t = " in out
    before, ticks = lab.open(windows[1][0]).commands["nf"].tick, run.commands["nf"].tick
    assert np.array_equal(ticks, np.arange(before[-1] + 1, ticks[-1] + 1))  # neither a gap nor an overlap
    held = float(out.partition("held at t = ")[2].split()[0])
    assert ticks[-1] >= round((held + 0.3) / 1e-3) - 1  # however late they arrive
    assert np.nanmin(run.measurements["vibrometer"].v) < -0.05


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        (("live", "record", "--before", "1"), "--before: needs --trigger"),
        (("run", "belt", "--trigger", "vibrometr > 0.1 m/s"), "did you mean vibrometer"),
        (("run", "belt", "--trigger", "velocity > 1 m/s", "--figure", "f.png"), "--figure: draws the recording of"),
        (("live", "record", "--trigger", "x > 1 m", "--after", "-1"), "--after -1: must be 0 to"),
    ],
)
def test_options_that_make_no_sense_are_refused_before_anything_starts(rig, arguments, fault, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, _, err = rig(*arguments)
    assert code == 2
    assert fault in err
    assert not list(tmp_path.iterdir())
