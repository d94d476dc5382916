"""No command overwrites a file unless it is told --force, and none leaves an empty one behind."""

import os
from pathlib import Path

import numpy as np
import pytest

import rig as laboratory
from rig.cli import app as program
from rig.errors import OutputError
from rig.record.run import Run, Samples
from rig.record.save_run import save
from rig.record.writer import opened_new


@pytest.fixture
def log(tmp_path):
    t_ns = np.arange(20_000, dtype=np.int64) * 25_000
    run = Run(
        scene='{"plant": "belt"}',
        step_ns=25_000,
        frame_ns=1_000_000,
        time=t_ns * 1e-9,
        signals={"x": np.sin(t_ns * 1e-9)},
        units={"x": "m", "meas/s": "Pa"},
        measurements={"s": Samples(t_ns, np.sin(t_ns * 1e-5))},
    )
    save(run, tmp_path / "log.mcap")
    data = (tmp_path / "log.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) // 2])
    return tmp_path / "log.mcap"


@pytest.fixture
def rig(capsys, tmp_path, monkeypatch):
    """Runs a command in this process: exit code, standard error."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))

    def call(*arguments):
        with pytest.raises(SystemExit) as left:
            program.run([str(a) for a in arguments])
        return left.value.code or 0, capsys.readouterr().err

    return call


FILES = [
    ("simulate", "belt", "--out"),
    ("simulate", "belt", "--figure"),
    ("run", "belt", "--out"),
    ("run", "belt", "--figure"),
    ("modes", "belt", "--sweep", "drive.speed=0.05:0.4:5", "--figure"),
    ("explain", "belt", "--measure", "--figure"),
    ("analyse", "sound", "log.mcap", "--signal", "s", "--out"),
    ("analyse", "sound", "log.mcap", "--signal", "s", "--figure"),
    ("analyse", "stick", "log.mcap", "--figure"),
    ("analyse", "events", "log.mcap", "--figure"),
    ("analyse", "amplitude", "log.mcap", "--figure"),
    ("cycle", "belt", "--figure"),
    ("branches", "belt", "--over", "drive.speed=0.1:0.4", "--figure"),
    ("loop", "belt_normal_force", "--figure"),
    ("identify", "lever_kinetic_friction", "--figure"),
    ("identify", "lever_kinetic_friction", "--page"),
    ("diff", "log.mcap", "log.mcap", "--figure"),
    ("analyse", "hysteresis", "log.mcap", "--figure"),
    ("analyse", "spectrum", "log.mcap", "--figure"),
    ("analyse", "pressure", "log.mcap", "--figure"),
    ("analyse", "portrait", "log.mcap", "--figure"),
    ("analyse", "response", "log.mcap", "--input", "x", "--output", "s", "--figure"),
    ("recover", "cut.mcap", "--out"),
    ("export", "log.mcap", "--to", "mat", "--out"),
    ("report", "log.mcap", "--out"),
    ("live", "record", "--wait", "0.1", "--out"),
    ("view", "--wait", "0.1", "--save"),
]


def suffix(command):
    """That of the file that the command writes, or one that the command has no opinion about."""
    if command[0] == "report" or command[-1] == "--page":
        return ".html"
    return ".mcap" if command[-1] == "--out" and {"simulate", "run", "record", "recover"} & {*command} else ".png"


@pytest.mark.usefixtures("log")
@pytest.mark.parametrize("command", FILES, ids=lambda command: f"{command[0]} {command[-1]}")
def test_a_place_that_cannot_be_written_is_refused_before_anything_starts(rig, tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("rig.bench.live.supervise.run", None)
    mine, theirs, pipe = (Path(f"{name}{suffix(command)}") for name in ("mine", "theirs", "pipe"))
    mine.write_text("mine")
    os.mkfifo(pipe)
    refused = {
        (mine,): "exists; name another file, or add --force",
        (theirs, "--force"): "another run is writing it; name another file",
        (pipe, "--force"): f"{pipe} cannot be written: it is not a regular file",
        ("",): "the name is empty",
    }
    if command[-1] == "--figure":
        refused |= {
            (name,): f"--figure {name}: the name of a figure ends in .png, .svg or .pdf" for name in ("nos", "a.txt")
        }
    with opened_new(theirs, True) as file:
        file.write(b"theirs")
        file.flush()
        before = sorted(tmp_path.iterdir())
        for given, said in refused.items():
            code, err = rig(*command, *given)
            assert code in (1, 2)
            assert said in err
            assert sorted(tmp_path.iterdir()) == before
    assert (mine.read_text(), theirs.read_text(), pipe.is_fifo()) == ("mine", "theirs", True)


@pytest.mark.parametrize(
    ("command", "name"),
    [
        (("tool", "torture", "--case", "grazing", "--out"), "matrix.json"),
        (("tool", "reproduce", "kroeger-3", "--out"), "kroeger-3.png"),
    ],
)
def test_a_folder_is_not_overwritten(rig, tmp_path, command, name):
    (tmp_path / name).write_text("mine")
    code, err = rig(*command, tmp_path)
    assert code == 2
    assert f"has {name}; name another folder, or add --force" in err
    assert (tmp_path / name).read_text() == "mine"


@pytest.mark.usefixtures("log")
@pytest.mark.parametrize(
    ("commands", "name", "said"),
    [
        (
            ("simulate belt --out", "run belt --out", "live record --out", "recover log.mcap --out"),
            "a.csv",
            "a.csv: a recording is an MCAP file, and its name ends in .mcap",
        ),
        (
            ("map belt --out", "study belt --out", "cost belt --out", "tool torture --out", "tool reproduce --out"),
            "a.csv",
            "--out a.csv: the results are a folder of several files",
        ),
        (("view log.mcap --save",), "view.txt", "must end in .rrd"),
        (("simulate belt --figure",), "new/a.png", "--figure new/a.png: there is no folder new"),
        (("simulate none --figure",), "a.png", "no scene has this name"),  # and no empty file is left
        (("simulate none --out",), "log.mcap/a.mcap", "cannot be written: "),  # before anything is computed
        (("simulate none --out",), "..", "is a folder"),
    ],
)
def test_a_name_that_does_not_fit_is_refused_and_nothing_is_left(rig, tmp_path, monkeypatch, commands, name, said):
    monkeypatch.chdir(tmp_path)
    for command in commands:
        code, err = rig(*command.split(), name)
        assert (code, said in " ".join(err.split())) == (2, True), err
        assert {path.name for path in tmp_path.iterdir()} == {"log.mcap", "cut.mcap"}


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("analyse sound log.mcap --signal s --out log.mcap", "--out log.mcap"),
        ("analyse sound --signal s --figure link.png log.mcap", "--figure link.png"),
        ("simulate belt.png --figure belt.png", "--figure belt.png"),
        ("modes --sweep drive.speed=0.05:0.4:5 --figure belt.png belt.png", "--figure belt.png"),
    ],
)
def test_no_command_overwrites_what_it_reads(rig, log, tmp_path, monkeypatch, command, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "link.png").symlink_to("log.mcap")
    (tmp_path / "belt.png").write_text("title = 'mine'")
    code, err = rig(*command.split(), "--force")
    assert code == 2
    assert f"{said}: is also the input file; name another one" in err
    assert log.stat().st_size > 1000
    assert (tmp_path / "belt.png").read_text() == "title = 'mine'"


def test_of_two_commands_that_write_one_new_file_the_second_is_refused(rig, tmp_path, monkeypatch):
    out, simulate = tmp_path / "a.mcap", laboratory.simulate

    def meanwhile(*given, **named):
        found = simulate(*given, **named)
        out.write_text("of another")
        return found

    monkeypatch.setattr(laboratory, "simulate", meanwhile)
    code, err = rig("simulate", "belt", "--duration", "0.05", "--out", out)
    assert code == 1
    assert f"{out} cannot be written: it exists; name another file, or add --force" in err
    assert out.read_text() == "of another"
    assert rig("simulate", "belt", "--duration", "0.05", "--out", out, "--force")[0] == 0
    assert out.stat().st_size > 1000


def test_a_figure_is_drawn_as_its_name_ends(rig, tmp_path):
    for name, begins in (("a.svg", b"<?xml"), ("a.PDF", b"%PDF")):
        assert rig("simulate", "belt", "--duration", "0.05", "--figure", tmp_path / name)[0] == 0
        assert (tmp_path / name).read_bytes().startswith(begins)


@pytest.mark.usefixtures("log")
@pytest.mark.parametrize(
    ("command", "drawn"),
    [
        ("explain belt --measure --figure a.png", "qualify.effects_measured.draw"),
        ("analyse sound log.mcap --signal s --figure a.png", "analysis.recorded.figures.sound_figure"),
        ("map belt --x drive.speed=0.2:0.3:2 --y load.force=10:20:2 --eigenvalues", "analysis.linear.regions.figure"),
    ],
)
def test_a_figure_that_fails_does_not_take_the_report_with_it(capsys, tmp_path, monkeypatch, command, drawn):
    def fail(*_, **__):
        raise OutputError("no figure")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(f"rig.{drawn}", fail)
    monkeypatch.setattr("rig.qualify.effects_measured.parts", lambda *_, **__: [])
    with pytest.raises(SystemExit) as left:
        program.run(command.split())
    out, err = capsys.readouterr()
    assert left.value.code == 1
    assert "no figure" in err
    assert len(out) > 100


def test_two_options_do_not_name_one_file(rig, log, tmp_path):
    (tmp_path / "a.png").write_text("mine")
    (tmp_path / "b.png").symlink_to("a.png")
    for out, figure in (("a.png", "a.png"), ("a.png", "b.png"), ("c.png", "../c.png")):
        files = ("--out", tmp_path / out, "--figure", tmp_path / figure.replace("..", f"../{tmp_path.name}"))
        code, err = rig("analyse", "sound", log, *files, "--force")
        assert code == 2
        assert f"{files[-1]}: is also the file of --out" in err
    assert (tmp_path / "a.png").read_text() == "mine"
