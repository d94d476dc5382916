"""Every result has a figure and an HTML form, made in one way."""

import ast
import csv
import html
import inspect
import io
import math
import os
import re
import subprocess
import sys
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

import rig
from rig import results
from rig.analysis import recorded
from rig.analysis.cycles.motion_measures import Setting
from rig.analysis.robust import design
from rig.cli import app
from rig.errors import RigError, SceneError, UsageError
from rig.printable import with_unit
from rig.qualify.cost.report import CostReport
from rig.qualify.cost.table import Row, Table
from rig.qualify.cost.timing import Cost, Spread
from rig.results import Column, Result
from rig.view.palette import encoded

GOLDEN = Path(__file__).parents[1] / "recordings" / "golden"
NO_RESULTS = {"Path", "StateSpace", "Distribution"}


def golden(name):
    return rig.open(GOLDEN / f"{name}.mcap")


def regions(folder):
    from rig.analysis.map import chart, regions_job

    return chart(regions_job(rig.load("belt"), "drive.speed=0.05:0.4:4", "load.force=10:20:2"), folder, 1)


def loop_report(folder):
    from rig.analysis.linear import loop_check
    from rig.analysis.linear import loop_report as room

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(loop_check, "RUNS", 1)
        patch.setattr(room, "POINTS", 3)
        return room.report(rig.load("belt_normal_force"), "nf")


def identified(folder):
    from rig.analysis.identification.lever import experiment

    return experiment(rig.load("lever_free_lever"))


def sound(folder):
    from rig.analysis.recorded.sound import hear

    return hear(golden("brake_shunt"), "vibrometer")


def cost_report(folder):
    def row(tolerance, error, time):
        spread = Spread(time, 0.9 * time, 1.1 * time)
        cost = Cost(spread, spread, Spread(1e3 / time, 900.0 / time, 1100.0 / time), spread)
        return Row(Setting("dopri5", tolerance), {"period": error}, {"period": 1e-11}, cost, 1e-3 * time, 10)

    rows = [row(1e-4, 1e-4, 1.0), row(1e-6, 1e-6, 2.0), row(1e-8, 1e-8, 4.0)]
    machine = dict.fromkeys(("processor", "cores", "python", "numba", "date"), "1")
    return CostReport(Table("belt", "Mass on a belt", "", "cycle", 1.0, 1e-3, 1e-3, machine, {}, rows=rows))


def imported(folder):
    paper = GOLDEN.parent / "stick_slip_paper" / "k168Nm_v4300.mat"
    return rig.import_(paper, folder / "x.mcap", {"Fnorm": "force, 0.301 N"}, time="t, s")


def compared(folder):
    return rig.diff(rig.simulate("belt", 0.5), rig.simulate(rig.load("belt", {"load.force": "15 N"}), 0.5))


def robust(folder):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(design, "AUDIT", 300)  # of 10,000 rigs
        return rig.optimise("belt", None, "modes.growth", against={"drive.speed": "+-5 %"}, out=folder, workers=1)


MADE = {
    "Scene": lambda folder: rig.load("pendulum"),
    "Run": lambda folder: golden("pendulum"),
    "Modes": lambda folder: rig.modes("belt"),
    "Sweep": lambda folder: rig.sweep("belt", "drive.speed", np.linspace(0.05, 0.4, 9)),
    "Loop": lambda folder: rig.loop("belt_normal_force", "nf"),
    "LoopReport": loop_report,
    "Cycle": lambda folder: rig.limit_cycle("belt"),
    "Branches": lambda folder: rig.branches("belt", "drive.speed=0.1 m/s:0.4 m/s", start=["hopf"], out=folder),
    "Curves": lambda folder: rig.branches(
        "belt", "drive.speed=0.1 m/s:0.8 m/s", start=["hopf"], out=folder, second="load.force=10 N:20 N:2"
    ),
    "Map": lambda folder: rig.map("belt", "drive.speed=0.05:0.4:3", out=folder, workers=1),
    "Boundary": lambda folder: rig.map(
        "two_dof_dither", "dither.frequency=16:32:2", "dither.amplitude=5 N:80 N:2", out=folder, workers=1
    ),
    "Regions": regions,
    "StudyResult": lambda folder: rig.study(
        "belt", {"load.force": [10, 20]}, ["cycle.amplitude"], out=folder, workers=1
    ),
    "SearchResult": lambda folder: rig.optimise(
        "belt", {"load.force": (10, 30)}, "cycle.amplitude", evaluations=15, out=folder, workers=1
    ),
    "RobustResult": robust,
    "Compared": compared,
    "AgainstScene": lambda folder: rig.diff(
        golden("belt"),
        "belt",
        pair={"vibrometer": "velocity", "friction_force": "friction_force"},
        stick={"velocity": "vibrometer", "drive": 0.06, "friction": "friction_force"},
    ),
    "Amplitudes": lambda folder: recorded.amplitudes(golden("tip_knock")),
    "Identified": identified,
    "Hysteresis": lambda folder: recorded.hysteresis(golden("lever")),
    "Spectrum": lambda folder: recorded.spectrum(golden("pendulum")),
    "Orders": lambda folder: recorded.orders(golden("lever")),
    "Pressure": lambda folder: recorded.pressure(golden("plate"), []),
    "Response": lambda folder: recorded.response(golden("belt"), "friction_force", "velocity"),
    "Portrait": lambda folder: recorded.portrait(golden("belt")),
    "Sound": sound,
    "Events": lambda folder: rig.events(rig.simulate("two_dof"), over="two_dof"),
    "StickSlip": lambda folder: recorded.stick_slip(golden("belt"), "velocity", drive="surface_speed"),
    "Imported": imported,
    "CostReport": cost_report,
}
"""Class -> a small result of it."""


@pytest.fixture(scope="module", params=MADE)
def made(request, tmp_path_factory):
    """The name of a class and a result of it, computed once."""
    return request.param, MADE[request.param](tmp_path_factory.mktemp("result"))


def test_a_result_has_a_figure_and_an_html_form(made, monkeypatch):
    name, result = made
    assert type(result).__name__ == name
    figure = result.plot()
    assert isinstance(figure, Figure)
    monkeypatch.setattr(type(result), "plot", lambda _: figure)  # drawn once
    page = result._repr_html_()
    assert page.count("<img ") == page.count("data:image/png;base64,") == 1
    assert page.startswith(result.html())
    printed, lines = repr(result).splitlines(), result.text().splitlines()
    assert printed[:40] == lines[:40]
    assert len(printed) == len(lines) or printed[40:] == [f"... and {len(lines) - 40} more lines: .text() returns all"]
    assert str(result) == repr(result)


def test_a_command_and_a_notebook_draw_what_plot_returns(tmp_path):
    result = rig.limit_cycle("belt")
    with pytest.raises(SystemExit) as left:
        app.run(["cycle", "belt", "--figure", str(tmp_path / "a.png")])
    assert not left.value.code
    assert (tmp_path / "a.png").read_bytes() == encoded(result.plot(), "png")
    shown, written = (imread(io.BytesIO(png)) for png in (result.plot()._repr_png_(), encoded(result.plot(), "png")))
    assert shown.shape == written.shape  # the layout is solved to rounding only
    assert np.mean(np.abs(shown - written).max(axis=2) > 0.02) < 2e-3


def test_every_class_of_results_is_tried():
    rooms = (
        "recorded recorded.against_scene recorded.sound map studies studies.search linear.regions linear.loop_report"
    )
    for room in (
        *rooms.split(),
        "linear.control_loop",
        "identification.answer",
        "linear.sweep",
        "linear.modes",
        "cycles.cycle",
        "branches",
    ):
        import_module(f"rig.analysis.{room}")

    def below(kind):
        return {one for sub in kind.__subclasses__() for one in (sub, *below(sub)) if "FIGURE" in vars(one)}

    analyses = {one for one in vars(recorded).values() if isinstance(one, type) and hasattr(one, "text")}
    assert {one.__name__ for one in below(Result) | analyses} == MADE.keys()


def test_what_a_function_of_rig_returns_is_a_result():
    functions = [getattr(rig, name) for name in rig.__all__]
    returned = [inspect.signature(one).return_annotation for one in functions if inspect.isfunction(one)]
    names = {node.id for text in returned for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Name)}
    assert names - NO_RESULTS <= MADE.keys()


def test_text_html_csv_and_json_have_the_same_tables(made):
    name, result = made
    lines = [line.split() for line in result.text().splitlines()]
    for owner, table in tables(result):
        shown = re.findall(r"<tr>(.*?)</tr>", table.html())
        rows = [[html.unescape(cell) for cell in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row)] for row in shown]
        texts = [" ".join(row).split() for row in rows]
        at = lines.index(texts[0])
        assert lines[at : at + len(texts)] == texts
        heads, *values = csv.reader(io.StringIO(table.csv()))
        assert len(values) == len(table.rows)
        places = {head_of(column): k for k, column in enumerate(table.columns)}
        for cells, row in zip(rows[1:], values):
            for head, cell in zip(rows[0], cells, strict=True):
                assert_same(table.columns[places[head]], cell, row[places[head]])
        names = [column.name for column in table.columns]
        assert heads == [with_unit(column.name, column.unit) for column in table.columns]
        if name != "Scene":  # its JSON is that of a scene
            records = owner.to_json()[table.name]
            assert len(records) == len(values)
            assert all(record.keys() >= {*names} for record in records)


def tables(result):
    """(result, table) of every table of a result and of the results that are part of it."""
    for part in result.shown():
        if isinstance(part, Result):
            yield from tables(part)
        elif isinstance(part, results.Table):
            yield result, part


def head_of(column):
    return with_unit(column.name, column.shown or column.unit)


def assert_same(column, cell, written):
    """A cell of a text and one of a CSV file: the same text, or the same number with the digits that are shown."""
    if written == cell or (written in ("", "nan") and cell in ("", "-", "none")):
        return
    shown = re.split(" to |, ", cell)
    for one, value in zip(shown, map(float, written.split()), strict=True):
        flag = {"yes": 1.0, "no": 0.0}.get(one)
        assert value == flag or one == column.cell(value)


def test_a_table_has_units_scales_ranges_and_missing_values_and_nothing_in_it_is_markup():
    columns = (
        Column("<i>"),
        Column("share", "1", ".1f", "%", 0.01),
        Column("at", "m", "z.1f", "mm", 1e-3),
        Column("band", "Hz", ".3g"),
        Column("note"),
    )
    rows = [
        ("a <b>", 0.123456, -1e-5, (1.0, 2.0), ""),
        ("c", None, 0.0015, [], ""),
        ("d", math.nan, 1.0, [3.0, 4.5], ""),
    ]
    table = results.Table("places", columns, rows, 2)
    assert table.text().splitlines() == [
        "  <i>    share [%]  at [mm]  band [Hz]",
        "  a <b>       12.3      0.0     1 to 2",
        "  c              -      1.5       none",
        "  and 1 more",
    ]
    assert "<i>" not in table.html()
    assert "a &lt;b&gt;" in table.html()
    assert table.html().count("<tr>") == 3
    assert table.csv().splitlines() == [
        "<i>,share,at [m],band [Hz],note",
        "a <b>,0.123456,-1e-05,1 2,",
        "c,,0.0015,,",
        "d,nan,1,3 4.5,",
    ]
    assert table.records()[0] == {"<i>": "a <b>", "share": 0.123456, "at": -1e-5, "band": (1.0, 2.0), "note": ""}


def test_a_result_without_a_table_has_no_csv():
    with pytest.raises(UsageError, match="no table"):
        sound(None).csv()


@pytest.mark.parametrize("name", ["pendulum", "brake_shunt", "plate", "tip_knock"])
def test_the_overview_of_a_run_has_tables_of_outputs_and_sensors(name):
    run = golden(name)
    names = [table.name for _, table in tables(run)]
    assert names == ["outputs", "sensors"][: 1 + bool(run.measurements)]
    assert {record["name"] for record in run.to_json()["sensors"]} == run.measurements.keys()


SCENES = {
    "simulate": (),
    "modes": (),
    "sweep": ("drive.speed", [0.1, 0.2]),
    "loop": ("nf",),
    "state_space": (),
    "limit_cycle": (),
    "branches": ("drive.speed=0.1:0.4",),
    "map": ("drive.speed=0.1:0.4:3",),
    "study": ({"drive.speed": [0.1]}, ["run.rms"]),
    "optimise": ({"drive.speed": (0.1, 0.2)}, "run.rms"),
    "identify": ([],),
}
"""Function whose first argument is a scene -> its other arguments."""


def test_every_function_that_takes_the_name_of_a_scene_takes_overrides():
    from rig import gym

    def takes(function):
        return any("Scene" in str(one.annotation) for one in inspect.signature(function).parameters.values())

    run, box = golden("belt"), {"observe": {}, "act": {}, "reward": len}
    calls = {getattr(rig, name): ("belt_normal_force", *more) for name, more in SCENES.items()}
    assert {one for name in rig.__all__ if takes(one := getattr(rig, name))} == {*calls, rig.diff, rig.events}
    made = [partial(one, *given) for one, given in calls.items()]
    made += [partial(rig.diff, run, "belt"), partial(rig.events, run, over="belt")]
    made += [partial(gym.make, "belt", **box), partial(gym.make_vec, "belt", 2, **box)]
    for call in made:
        with pytest.raises(SceneError, match=r"load\.forse"):
            call(overrides={"load.forse": "10 N"})
    assert rig.modes("belt", overrides={"load.force": "10 N"}) == rig.modes(rig.load("belt", {"load.force": "10 N"}))
    with pytest.raises(UsageError, match=r"^overrides load\.force: the scene belt is loaded already; .* rig\.load"):
        rig.modes(rig.load("belt"), overrides={"load.force": "10 N"})


def test_a_path_where_a_run_is_needed_is_told_in_one_line():
    for call in (lambda: rig.diff("a.mcap", "b.mcap"), lambda: rig.events("a.mcap")):
        with pytest.raises(UsageError, match=r"^'a\.mcap' is no run; give what rig\.open or rig\.simulate returns$"):
            call()
    for call in (rig.open, rig.load, rig.report, rig.fork, lambda path: rig.identify("belt", path)):
        with pytest.raises(RigError, match=r"^none\.mcap.* [Nn]o such file.*$") as fault:
            call("none.mcap")
        assert "\n" not in str(fault.value)


def test_where_nothing_can_be_drawn_the_text_is_shown_with_the_reason():
    scene = rig.load("plate_free")
    with pytest.raises(UsageError, match="no contact with friction"):
        scene.plot()
    page = scene._repr_html_()
    assert "plate.density" in page
    assert page.endswith("<p>No figure: nothing to draw: the rig has no contact with friction</p>")


def test_matplotlib_is_imported_where_something_is_drawn():
    code = "import sys, rig; rig.load('belt'); rig.modes('belt').text(); assert 'matplotlib' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True, env=os.environ)
