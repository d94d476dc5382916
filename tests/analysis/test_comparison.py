"""Two recordings are compared: scenes, signals, measures."""

import dataclasses
import json
import math

import numpy as np
import pytest

import rig as lab
from rig.analysis.recorded import compare
from rig.errors import UsageError
from rig.record.run import Run, Samples

STICKS = {"friction.mu_static": "0.45"}


@pytest.fixture(scope="module")
def runs():
    """A run with stick-slip, and one with a faster belt."""
    return [lab.simulate(lab.load("belt", {**STICKS, "drive.speed": speed}), 4.0) for speed in (0.06, 0.07)]


@pytest.fixture(scope="module")
def logs(runs, tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    for name, run in zip("ab", runs):
        run.save(folder / f"{name}.mcap")
    return folder / "a.mcap", folder / "b.mcap"


def bent(run, size):
    """The run with one sample of the velocity moved by `size` of its range."""
    v = run.signals["velocity"].copy()
    v[700] += size * np.ptp(v)
    return dataclasses.replace(run, signals={**run.signals, "velocity": v})


def test_a_run_is_equal_to_itself(runs):
    found = compare(runs[0], runs[0])
    assert found.agree
    assert found.signals.identical
    assert not found.values
    assert all(one.same for one in found.measures)
    assert {found.outcome(one) for one in found.signals.signals} == {"equal"}


def test_a_channel_with_another_unit_is_named(runs):
    other = dataclasses.replace(runs[0], units={**runs[0].units, "velocity": "mm/s"})
    assert compare(runs[0], runs[0]).notes == ()
    [note] = compare(runs[0], other).notes
    assert note == "velocity is in m/s in A and in mm/s in B: what is told of it compares other quantities"


def test_a_deviation_is_judged_by_the_range_of_its_signal(runs):
    other = bent(runs[0], 1e-3)
    (one,) = (one for one in compare(runs[0], other).signals.signals if one.differing)
    assert one.topic == "velocity"
    assert one.deviation == pytest.approx(1e-3)
    assert (one.time, one.worst, one.differing) == (pytest.approx(0.7), pytest.approx(0.7), 1)
    outcomes = {}
    for tolerance in (0.0, 0.9e-3, 1.1e-3):
        found = compare(runs[0], other, tolerance=tolerance)
        outcomes[tolerance] = (found.agree, found.outcome(found.signals.signals[0]))
    assert outcomes == {0.0: (False, "differs"), 0.9e-3: (False, "differs"), 1.1e-3: (True, "within tolerance")}
    assert compare(runs[0], other, end=0.699).signals.identical
    assert compare(runs[0], other, begin=0.701).signals.identical


def test_measures_are_those_of_the_motion(runs):
    """Against numbers that do not come from these functions."""
    assert [tuple(one) for one in lab.diff(*runs).values] == [("drive.speed", "0.06", "0.07")]
    found = {(one.channel, one.name): one for one in compare(*runs, 1.0).measures}
    for which, speed in enumerate((0.06, 0.07)):
        cycle = lab.limit_cycle(lab.load("belt", {**STICKS, "drive.speed": speed}))
        assert found["displacement", "period"][3 + which] == pytest.approx(cycle.period, rel=2e-3)
        assert found["contact", "stick share"][3 + which] == pytest.approx(cycle.stick_share["contact"], abs=0.03)
        assert found["contact", "events"][3 + which] == pytest.approx(2.0 / cycle.period, rel=0.1)
        assert found["surface_speed", "mean"][3 + which] == pytest.approx(speed, rel=1e-12)
        assert found["surface_speed", "RMS"][3 + which] < 1e-15
        v = runs[which].signals["velocity"][1000:]
        assert found["velocity", "RMS"][3 + which] == pytest.approx(math.sqrt(np.mean(v**2) - v.mean() ** 2))
        assert found["velocity", "amplitude"][3 + which] == pytest.approx(0.5 * np.ptp(v), rel=1e-3)
    assert found["surface_speed", "mean"].percent == pytest.approx(100.0 / 6.0)
    assert math.isnan(found["velocity", "growth rate"].percent)  # neither grows


def test_actions_of_operators_are_listed(logs, runs):
    other = lab.fork(logs[0], 2.0, {"drive.speed": 0.08}, 2.0)
    found = compare(runs[0], other)
    assert found.actions == ("B: t = 2 s: continues a.mcap from 2 s", "B: t = 2 s: drive.speed = 0.08")
    assert min(one.time for one in found.signals.differences) >= 2.0


def test_runs_of_different_length_and_rate(runs):
    short = lab.simulate(lab.load("belt", STICKS), 2.0)
    found = compare(runs[0], short)
    assert not found.agree
    assert {found.outcome(one) for one in found.signals.signals} == {"other length"}
    assert (found.begin, found.end) == (0.0, 2.0)
    assert all(one.same for one in found.measures)
    assert compare(runs[0], short, end=2.0).signals.identical
    coarse = dataclasses.replace(
        short, time=short.time[::5], mode=short.mode[::5], signals={name: v[::5] for name, v in short.signals.items()}
    )
    assert compare(short, coarse).agree
    assert all(one.same for one in compare(short, coarse).measures if one.channel != "contact")
    with pytest.raises(UsageError, match="no outputs at common times"):
        compare(runs[0], short, 3.0)
    with pytest.raises(UsageError, match="tolerance -1"):
        compare(runs[0], short, tolerance=-1.0)


def test_the_command_prints_draws_and_decides(rig, logs, tmp_path):
    first, second = map(str, logs)
    picture = tmp_path / "d.png"
    code, out, _ = rig("diff", first, second, "--figure", picture)
    assert (code, "drive.speed" in out, "stick share" in out) == (1, True, True)
    assert picture.stat().st_size > 20_000
    code, out, _ = rig("diff", first, second, "--json", "--from", "1 s", "--to", "2", "--tolerance", "10")
    told = json.loads(out)
    assert (code, told["from"], told["to"], told["agree"]) == (0, 1.0, 2.0, True)


SWEEP = """
based_on = "belt"
[[protocol]]
step = "ramp"
target = "drive.speed"
to = "0.1 m/s"
over = "8 s"
[[protocol]]
step = "ramp"
target = "load.force"
to = "24 N"
over = "4 s"
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """A run of a rig as a measurement of other names, whose speed and load are known to the frame."""
    path = tmp_path_factory.mktemp("bench") / "truth.toml"
    path.write_text(SWEEP)
    truth = lab.simulate(path)
    t_ns = np.rint(truth.time * 1e9).astype(np.int64)
    channels = {"tacho": ("surface_speed", "m/s"), "cell": ("normal_force", "N"), "x": ("displacement", "m")}
    made = {name: Samples(t_ns, truth.signals[output]) for name, (output, _) in channels.items()}
    made["vibrometer"] = truth.measurements["vibrometer"]
    units = {f"meas/{name}": unit for name, (_, unit) in channels.items()} | {"meas/vibrometer": "m/s"}
    return Run("", truth.step_ns, truth.frame_ns, np.empty(0), {}, units, made, measured=True, name="bench")


WAYS = {"drive.speed": "tacho", "load.force": "cell"}


def test_a_scene_under_the_measured_speed_and_load_shows_what_differs(bench):
    stick = {"velocity": "vibrometer", "drive": "tacho", "threshold": 1e-4}
    same = lab.diff(bench, "belt", begin=1.0, follow=WAYS, stick=stick)
    assert [pair.channel for pair in same.pairs] == ["vibrometer"]
    values = {measure.name: measure for measure in same.measures}
    assert {"mean", "RMS", "period", "amplitude", "strongest frequency", "stick time", "stick share"} <= values.keys()
    assert same.within(1e-6)
    pairs = {"vibrometer": "vibrometer", "x": "laser", "cell": "normal_force"}
    other = lab.diff(bench, lab.load("belt", {"body.stiffness": "2000 N/m"}), 0.0, 1.0, follow=WAYS, pair=pairs)
    values = {(measure.channel, measure.name): measure for measure in other.measures}
    assert 5.0 < values["x", "period"].percent < 15.0  # 1 / sqrt(0.8) while it slips
    assert values["cell", "mean"].percent == pytest.approx(0.0, abs=1e-9)
    assert not other.within(0.02)
    assert len(other.plot().axes) == 6
    fixed = lab.diff(bench, "belt", pair={"x": "displacement, 2 m/m"})
    assert fixed.constant == {"drive.speed": (0.06, "m/s"), "load.force": (20.0, "N")}
    assert not fixed.followed


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"follow": {"drive.speed": "cell"}}, "cell is in N, not in m/s"),
        ({"pair": {"x": "velocity"}}, r"add a factor in \(m\)/\(m/s\)"),
        ({"pair": {"y": "velocity", "x": "speed"}}, "no 'y' in this recording(.|\n)*no 'speed' in this run"),
        ({"stick": {"velocity": "x", "drive": 0.06}}, '--pair "x = SIMULATED"'),
    ],
)
def test_what_a_scene_cannot_follow_or_pair_is_named(bench, options, words):
    with pytest.raises(UsageError, match=words):
        lab.diff(bench, "belt", **options)


def test_the_command_compares_with_a_scene_and_judges_by_the_tolerance(rig, logs):
    options = ["--pair", "vibrometer = velocity", "--velocity", "vibrometer", "--drive", "0.06 m/s", "--to", "3"]
    reports = []
    for tolerance, code in (("10", 0), ("0.001", 1)):
        left, out, _ = rig("diff", logs[0], "belt", *options, "--tolerance", tolerance, "--json")
        assert left == code
        reports.append(json.loads(out))
    assert {row["channel"] for row in reports[0]["measures"]} == {"vibrometer", "contact"}
    assert reports[0]["follows"] == {"drive.speed": "surface_speed", "load.force": "normal_force"}
    left, _, told = rig("diff", *logs, "--follow", "drive.speed = surface_speed")
    assert (left, "need a scene" in told) == (2, True)
