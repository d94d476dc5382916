"""Phase portraits and Poincare sections against closed forms, and against the limit cycle of a rig."""

import csv
import json
import math

import numpy as np
import pytest

import rig as laboratory
from rig.analysis.recorded import portrait
from rig.errors import UsageError
from rig.record.run import Run, Samples
from rig.record.save_run import save

SCENE = laboratory.load("belt").to_json()


def run_of(x, v, rate=1000.0, **more):
    return Run(
        scene=SCENE,
        step_ns=round(1e9 / rate),
        frame_ns=round(1e9 / rate),
        time=np.arange(x.size) / rate,
        signals={"displacement": x, "velocity": v, **more},
        units={"displacement": "m", "velocity": "m/s"},
    )


def circle(hertz, rate, seconds=20.0):
    t = np.arange(round(seconds * rate)) / rate
    return np.sin(2.0 * math.pi * hertz * t), np.cos(2.0 * math.pi * hertz * t)


def test_crossings_of_a_circle_are_located_in_fourth_order():
    """x rises through 0.3 at asin(0.3) / (2 pi f), and v is sqrt(1 - 0.09) there."""
    off = []
    for rate in (100.0, 200.0, 400.0):
        x, v = circle(math.pi, rate)
        found = portrait(run_of(x, v, rate), section=("displacement", 0.3)).section
        exact = math.asin(0.3) / (2.0 * math.pi**2) + np.arange(found.t.size) / math.pi
        off.append((np.abs(found.t - exact).max(), np.abs(found.y - math.sqrt(0.91)).max()))
        assert found.period == pytest.approx(1.0 / math.pi, abs=1e-6)
        assert found.x == pytest.approx(0.3, abs=1e-12)
    orders = np.log2(np.array(off)[:-1] / np.array(off)[1:])
    assert orders == pytest.approx(4.0, abs=0.5)
    assert off[-1][0] < 1e-8


def test_a_limit_cycle_has_one_point_and_the_period_of_the_search():
    run = laboratory.simulate("belt", 20.0)
    cycle = laboratory.limit_cycle("belt")
    found = portrait(run, section=("velocity", 0.0), first=10.0).section
    assert found.returns == 1
    assert found.period == pytest.approx(cycle.period, rel=1e-8)
    assert found.x == pytest.approx(cycle.extremes["displacement"][0], rel=1e-6)  # at rest where it turns
    assert found.spread < 1e-8


def test_a_motion_of_period_three_has_three_points():
    t = np.arange(30_000) / 1000.0
    x = np.sin(2.0 * math.pi * 3.0 * t) + 0.3 * np.sin(2.0 * math.pi * t)
    found = portrait(run_of(x, np.gradient(x, t)), section=("displacement", 0.1)).section
    assert found.returns == 3
    assert found.period == pytest.approx(1.0, abs=1e-9)
    assert len(np.unique(found.y.round(4))) == 3


def test_a_transient_and_a_quasi_periodic_motion_do_not_repeat():
    x, v = circle(1.0, 1000.0)
    fade = np.exp(-0.05 * np.arange(x.size) / 1000.0)
    found = portrait(run_of(fade * x, fade * v), section=("displacement", 0.1))
    assert found.section.returns == 0
    assert "no repetition to 0.001 of the range within 10 crossings: a transient" in found.text()
    t = np.arange(30_000) / 1000.0
    x = np.sin(2.0 * math.pi * 3.0 * t) + 0.3 * np.sin(2.0 * math.pi * math.sqrt(2.0) * t)
    found = portrait(run_of(x, np.gradient(x, t)), section=("displacement", 0.1)).section
    assert found.returns == 0
    assert math.isnan(found.period)


def test_crossings_in_gaps_are_not_invented():
    x, v = circle(1.0, 1000.0)
    x[4999:5002] = np.nan  # over the crossing at 5 s
    v[7000] = np.nan  # beside that at 7 s
    found = portrait(run_of(x, v), section=("displacement", 0.0))
    assert found.section.t.size == 17  # 1 s to 19 s without those two; at 0 s there is no sample before
    assert found.section.lost == 1
    assert "1 crossings beside a missing sample or an end" in found.text()
    assert "3 of 20000 samples of displacement are missing" in found.text()


def test_channels_of_different_rates():
    t = np.arange(5000) / 1000.0
    fast = np.arange(50_000) / 10_000.0
    run = run_of(np.sin(6.0 * t), np.cos(6.0 * t))
    run.measurements["laser"] = Samples(np.rint(fast * 1e9).astype(np.int64), np.sin(6.0 * fast))
    found = portrait(run, "laser", "velocity", ("laser", 0.0))
    assert found.x**2 + found.y**2 == pytest.approx(1.0, abs=1e-3)
    assert found.section.period == pytest.approx(2.0 * math.pi / 6.0, rel=1e-6)


def test_what_cannot_be_is_told():
    x, v = circle(1.0, 1000.0)
    with pytest.raises(UsageError, match=r"section: displacement never crosses 2 m; it stays from -1 to 1 m"):
        portrait(run_of(x, v), section=("displacement", 2.0))
    with pytest.raises(UsageError, match=r"x and y are both velocity; name two channels \(--x, --y\)"):
        portrait(run_of(x, v), "velocity", "truth/velocity")
    run = run_of(x, v)
    run.signals = {"speed": v}
    with pytest.raises(UsageError, match="no displacement with a velocity; name both channels"):
        portrait(run)


def test_the_command(tmp_path, rig):
    log, table = tmp_path / "run.mcap", tmp_path / "points.csv"
    save(run_of(*circle(2.0, 1000.0)), log)
    picture = tmp_path / "portrait.svg"
    code, out, err = rig("analyse", "portrait", log, "--section", "displacement = 100 mm", "--figure", picture)
    assert code == 0, err
    assert picture.read_bytes().startswith(b"<?xml")
    assert "the motion repeats after every crossing: period 0.5" in out
    code, out, _ = rig("analyse", "portrait", log, "--section", "displacement=0.1", "--csv", table, "--json")
    told = json.loads(out)
    assert told["section"]["returns"] == 1
    assert told["section"]["period"] == pytest.approx(0.5, rel=1e-9)
    with table.open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["velocity [m/s]"]) for row in rows] == pytest.approx(told["section"]["y"], rel=1e-8)
    for given, said in (("displacement", "expected NAME = VALUE"), ("displacement = 1 N", "--section displacement =")):
        code, out, err = rig("analyse", "portrait", log, "--section", given)
        assert (code, out, said in err) == (2, "", True)
