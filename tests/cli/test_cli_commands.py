"""The commands as a user meets them: help with an example, exit codes, faults in words, reports as JSON."""

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rig import scenes
from rig.analysis.recorded.amplitude import index
from rig.bench.live.outcome import Job, Outcome
from rig.bench.live.plant_process import carry_out
from rig.cli import printing
from rig.cli.app import every, program
from rig.errors import ExitCode
from rig.record.reader import open as open_recording
from rig.scenes import shipped

COMMANDS = sorted(every())
PROMISED = {
    "": "demo list web run simulate explain new lesson fmu modes cycle branches map loop identify study optimise cost "
    "runs report verify diff export import note recover view",
    "analyse ": "amplitude events hysteresis portrait pressure response sound spectrum stick",
    "live ": "tune connect disconnect knock pause step resume stop plant control record replay bridge",
    "live topic ": "ls hz echo",
    "tool ": "device doctor warmup clean torture reproduce",
}


def test_the_commands_that_are_promised_are_there(rig):
    assert COMMANDS == sorted(f"{group}{name}" for group, names in PROMISED.items() for name in names.split())
    code, out, _ = rig("--help")
    assert code == 0
    assert all(f" {name} " in out for name in program.commands)
    assert len(program.commands) <= 30
    assert len(out.splitlines()) <= 50
    assert re.findall(r"^. (\w+) {2,}", out, re.MULTILINE)[:5] == ["demo", "list", "web", "run", "simulate"]


@pytest.mark.parametrize("name", COMMANDS)
def test_help_shows_an_example(rig, name):
    code, out, _ = rig(*name.split(), "--help")
    assert code == 0
    assert f"Example:  rig {name}" in out


@pytest.mark.parametrize(
    ("command", "heavy"),
    [
        ("--help", "numpy numba pydantic pint zenoh rerun matplotlib control scipy mcap"),
        ("list", "numpy numba pint"),
        ("simulate pendulum --duration 0.1", "google.protobuf zenoh pint scipy.linalg numba.np.arraymath"),
        ("simulate pendulum --duration 100ms -p drive.speed=2rpm -p load.force=0.02kN", "pint typer._adapters"),
        ("live control nf --run nobody --wait 0", "numba scipy pint typer._adapters"),
        ("live record --run nobody --wait 0", "numba scipy pint typer._adapters"),
    ],
)
def test_a_command_imports_what_it_needs(command, heavy):
    """Kernels that are kept are called without all that numba compiles with."""
    ends = "import sys; print(*sorted(sys.modules))"
    code = f"from rig.cli.app import run\ntry:\n    run({command.split()})\nfinally:\n    {ends}"
    for _ in range(2):  # the first one may have to compile
        out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=_environment())
        assert out.returncode in (0, 2), out.stderr  # there is no run called nobody
        if not (loaded := {*heavy.split()} & {*out.stdout.splitlines()[-1].split()}):
            break
    assert not loaded


def _environment():
    return {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}


def test_list_begins_with_the_scene_to_start_from_and_names_every_scene_in_one_group(rig):
    code, out, _ = rig("list")
    assert code == 0
    assert out.startswith("start with pendulum: rig run pendulum --view\n\nstick-slip\n  pendulum ")
    listed = [line.split()[0] for line in out.splitlines() if line.startswith("  ")]
    assert sorted(listed) == list(scenes.names())
    code, out, _ = rig("list", "--json")
    cards = json.loads(out)
    assert [card["name"] for card in cards] == list(scenes.names())
    assert {card["group"] for card in cards} == set(shipped.GROUPS)


def test_explain_shows_effects_and_origins(rig):
    code, out, _ = rig("explain", "belt_dither", "-p", "load.force=25 N")
    assert code == 0
    assert "dither.sin, dither.cos" in out
    assert "absent" in out
    assert re.search(r"^  load\.force +25 N +user +given with -p$", out, re.MULTILINE)
    code, out, _ = rig("explain", "pendulum", "--json")
    told = json.loads(out)
    assert told["duration_s"] == 21.0
    assert {value["key"]: value["origin"] for value in told["values"]}["load.force"] == "calibrated"


@pytest.mark.parametrize("name", ["pendulum", "belt_poor_network", "brake_shunt_listener", "lever_free_lever"])
def test_explain_begins_with_one_screen_and_fits_the_terminal(rig, monkeypatch, name):
    monkeypatch.setattr(printing, "width", lambda: 80)
    code, out, _ = rig("explain", name)
    assert code == 0
    lines = out.splitlines()
    screen = lines[: lines.index(next(line for line in lines if line.startswith("effects: ")))]
    assert [line for line in screen if line.startswith("what ")] == ["what acts", "what it does", "what is uncertain"]
    assert len(screen) <= 32
    assert re.search(r"^  stability  +\w.* is (un)?stable: ", out, re.MULTILINE)
    assert [line for line in lines if len(line.rstrip()) > 80] == []


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("explain", "pendulm"), "no scene has this name; did you mean pendulum?"),
        (("explain", "belt", "-p", "drive.sped=3", "-p", "load.force=-3 N"), "did you mean drive.speed?"),
        (("report", "recordings/golden/belt.mcap", "--out", "x.pdf"), "--out x.pdf: the name of a page ends in .html"),
        (("branches", "belt", "--over", "drive.speed=0.1:0.2", "--page", "x.pdf"), "--page x.pdf: the name of a page"),
        (("simulate", "belt", "-p", "load.force=1,500 N"), "-p load.force = 1,500 N may be 1.500 or 1500"),
        (("map", "belt", "--eigenvalues", "--x", "drive.speed=0.1:0.2:3"), "--eigenvalues: needs --y as well"),
        (("sim", "belt"), "has no command 'sim': did you mean simulate?"),
    ],
)
def test_a_mistake_ends_with_words_and_code_2(rig, arguments, told):
    code, out, err = rig(*arguments)
    assert code == 2
    assert told in err
    assert "Traceback" not in err + out


def test_modes_of_a_rig_that_gives_way_name_the_limit_and_leave_with_4(rig):
    code, out, err = rig("modes", "brake_shunt", "-p", "shunt.delta=-0.98")
    assert code == 4
    assert "flutter" in out
    assert "with delta -0.98 the stack is statically unstable, stiffness left -4.49" in err
    assert "delta above -0.97" in err
    assert rig("modes", "brake_shunt", "-p", "shunt.delta=-0.98", "-p", "clock.unstable=run")[0] == 0
    assert rig("modes", "brake_shunt")[0] == 0  # flutter is what the scene is there for


def test_simulate_modes_and_cycle_report_in_json(rig, tmp_path):
    log, figure = tmp_path / "run.mcap", tmp_path / "run.png"
    code, out, err = rig("simulate", "belt_c", "--duration", "0.5", "--json", "--out", log, "--figure", figure)
    assert code == 0, err
    told = json.loads(out)
    assert told["plant"]["method"] == "exact"
    assert told["fault"] == ""
    assert log.stat().st_size > 1000
    assert figure.read_bytes().startswith(b"\x89PNG")
    code, out, _ = rig("diff", log, log)
    assert code == 0
    code, out, _ = rig("modes", "belt", "--json")
    assert code == 0
    assert json.loads(out)["modes"][0]["growth"] == pytest.approx(3.6552859, rel=1e-6)
    code, out, _ = rig("cycle", "belt_c", "--json")
    assert code == 0
    assert json.loads(out)["period"] == pytest.approx(0.28337885481892366, rel=1e-9)


@pytest.mark.parametrize("command", ["run", "simulate"])
def test_what_cannot_be_drawn_is_refused_before_the_run(rig, command):
    for more, said in (
        ((), "--only: chooses what --figure draws"),
        (("--figure", "a.png"), "no 'vibrometr' in this scene: did you mean vibrometer"),
    ):
        code, _, err = rig(command, "belt", "--only", "velocity,vibrometr", *more)
        assert (code, said in err) == (2, True)


def test_a_scene_that_is_too_slow_for_the_clock_is_refused_with_what_works(rig):
    code, _, err = rig("run", "brake_disc_modes")
    assert code == 2
    assert all(text in err for text in ("1 to 2 ms", "rig simulate", "--lockstep", "--pace 0.5"))
    code, out, _ = rig("list")
    assert "  brake_disc_modes  Disc brake whose disc bends (real-time factor up to 0.5)\n" in out


def test_reports_are_json_even_where_a_number_is_none(capsys):
    printing.report({"a": float("nan"), "b": np.float64(2.0), "c": np.array([1.0, np.inf]), "d": (True, None)})
    assert json.loads(capsys.readouterr().out) == {"a": None, "b": 2.0, "c": [1.0, None], "d": [True, None]}


def test_map_tells_regions_and_leaves_figure_and_table(rig, tmp_path):
    asked = ("map", "belt", "--x", "drive.speed=0.15:0.25 m/s:2", "--runs", "near", "--out", str(tmp_path))
    code, out, _ = rig(*asked, "--workers", "2")
    assert code == 0
    assert re.search(r"I +sliding, no vibration found +1$", out, re.MULTILINE)
    assert "I: no vibration found from near sliding\n" in out
    assert "0.207944154" in out
    [folder] = tmp_path.iterdir()
    assert {"map.png", "map.csv"} <= {path.name for path in folder.iterdir()}
    assert (
        (folder / "map.csv").read_text().startswith("drive.speed [m/s],region,growth [1/s],frequency [Hz],near_state")
    )
    rows = (folder / "map.csv").read_text().splitlines()[1:]
    assert [row.split(",")[4] for row in rows] == ["stick-slip", "sliding"]


def test_curves_of_special_points_are_written_alone_and_over_a_map(rig, tmp_path):
    range_, loads = "drive.speed=0.1 m/s:0.8 m/s", "load.force=15 N:20 N:2"
    code, out, _ = rig("branches", "belt", "--over", range_, "--second", loads, "--out", tmp_path / "a", "--json")
    assert code == 0
    alone = json.loads(out)
    assert {"curves.csv", "curves.png"} <= {path.name for path in Path(alone["folder"]).iterdir()}
    chart = ("map", "belt", "--x", f"{range_}:2", "--y", loads, "--runs", "near", "--workers", "1")
    code, out, _ = rig(*chart, "--curves", "--out", tmp_path / "b", "--json")
    assert code == 0
    assert [(c["kind"], c["contact"]) for c in json.loads(out)["curves"]] == [("hopf", ""), ("grazing fold", "contact")]
    assert json.loads(out)["curves"][1]["first"] == pytest.approx(alone["curves"][1]["first"], rel=1e-8)


def test_amplitude_of_the_golden_recording(rig, tmp_path):
    figure = tmp_path / "amplitude.svg"
    code, out, _ = rig(
        "analyse", "amplitude", "recordings/golden/pendulum.mcap", "--from", "3 s", "--json", "--figure", figure
    )
    assert code == 0
    drawn = figure.read_text()
    assert all(word in drawn for word in ("vibrometer [mm/s]", "disc speed [rad/s]", "accelerate", "feedback on"))
    [row] = [r for r in json.loads(out)["rows"] if r["sensor"] == "vibrometer" and r["stage"] == "accelerate"]
    run = open_recording("recordings/golden/pendulum.mcap")
    connected = next(e["t_ns"] for e in run.events if e["text"] == "feedback on") * 1e-9
    here = (run.time >= 3.0) & (run.time <= connected)
    truth = index(run.time[here], run.signals["velocity"][here])
    assert row["found"]["half"] == pytest.approx(truth.half, rel=0.02)
    assert row["found"]["cycles"] == truth.cycles > 5
    code, _, err = rig("analyse", "amplitude", "recordings/golden/pendulum.mcap", "--from", "60 s")
    assert code == 2
    assert "the time span is empty; the recording has 0 to 9" in err


def test_an_interrupt_ends_a_simulation_and_tells_how_far_it_came(rig, monkeypatch):
    package = __import__("rig")
    simulate = package.simulate

    def interrupted(*arguments, **more):
        os.kill(os.getpid(), signal.SIGINT)
        return simulate(*arguments, **more)

    monkeypatch.setattr(package, "simulate", interrupted)
    code, out, err = rig("simulate", "belt_c", "--duration", "1000")
    assert code == 130
    assert re.search(r"0\.1\d* s simulated .*ended: interrupted by SIGINT", out)
    assert "again to end at once" in err


def test_clean_deletes_what_is_stored_for_the_user_and_nothing_else(rig, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    for name in ("cache/friction-rig/kernels/a/b", "state/friction-rig/last_run.log", "cache/others", "run.mcap"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(bytes(2_000_000))
    code, out, _ = rig("tool", "clean")
    assert code == 0
    assert f"deleted {tmp_path / 'cache' / 'friction-rig'}: 2.0 MB" in out
    assert {path.name for path in tmp_path.rglob("*") if path.is_file()} == {"others", "run.mcap"}
    assert rig("tool", "clean")[1] == "nothing is stored\n"


ROOT = Path(__file__).parents[2]


def test_the_page_of_the_commands_states_all_codes():
    section = (ROOT / "docs" / "commands.md").read_text().partition("## Exit codes")[2].partition("\n## ")[0]
    assert [int(code) for code in re.findall(r"^\| (\d+) \|", section, re.MULTILINE)] == list(ExitCode)


@pytest.mark.parametrize("duration", [None, 60.0])
def test_an_interrupted_run_is_complete_only_if_it_has_no_end_of_its_own(tmp_path, monkeypatch, duration):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    endless = tmp_path / "endless.toml"
    endless.write_text(
        'based_on = "belt_c"\nprotocol = [{ step = "repeat", times = "forever", '
        'steps = [{ step = "hold", time = "1 s" }] }]\n'
    )
    job = Job(scenes.load(endless).to_json(), run="ends", pace=None, duration=duration)
    summary = carry_out(job, lambda _: None, lambda _: os.kill(os.getpid(), signal.SIGINT))
    outcome = Outcome(summary)
    assert summary["ended"] == "stopped by SIGINT"
    assert outcome.exit_code == (ExitCode.DONE if duration is None else ExitCode.INTERRUPTED)
    assert outcome.without_recording("the disk is full").exit_code == ExitCode.FAILED
