"""The figure of a run, and the story that it tells."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import rig
from rig.record.run import Commands, Run, Samples
from rig.scenes import shipped
from rig.view import contact, timeline
from rig.view.curves import channels_of, thinned
from rig.view.run_figure import draw

NOTHING = Samples(np.empty(0, np.int64), np.empty(0))


def ink(path):
    """Width, height and share of pixels that are not white."""
    from matplotlib.image import imread

    picture = imread(path)
    return picture.shape[1], picture.shape[0], float((picture[..., :3] < 0.97).any(axis=2).mean())


@pytest.fixture(scope="module")
def run():
    """Half a second of the belt."""
    return rig.simulate("belt", 0.5)


def made_up(seconds, step_ns, **told):
    """A run of a plant that nobody knows, with one controller."""
    time = np.arange(round(seconds * 1e9 / step_ns) + 1) * step_ns * 1e-9
    told_at = [
        (0, "step", "ramp drive.speed to 2 m/s within 1 s"),
        (1, "step", "hold for 2 s"),
        (1, "mark", "on"),
        (1, "connected", "c is connected"),
        (2, "disconnected", "c is disconnected"),
    ]
    events = [
        {
            "t_ns": t * 10**9,
            "tick": t * 1000,
            "source": "plant",
            "kind": kind,
            "text": text,
            "data": {"controller": "c"},
        }
        for t, kind, text in told_at
    ]
    at = np.arange(10, dtype=np.int64)
    return Run(
        scene='{"plant": "other"}',
        step_ns=step_ns,
        frame_ns=1_000_000,
        time=time,
        signals={"displacement": 1e-3 * np.sin(20 * time), "velocity": 0.02 * np.cos(20 * time)},
        units={"displacement": "m", "velocity": "m/s"},
        commands={"c": Commands(at, at, at * 0, np.zeros((10, 1)))},
        events=events,
        **told,
    )


def test_a_simulated_run_becomes_a_picture_of_1600_pixels(run, tmp_path):
    path = tmp_path / "new" / "belt.png"
    draw(run, path)
    width, height, share = ink(path)
    assert width == 1600
    assert 900 <= height <= 1200
    assert 0.05 < share < 0.8


@pytest.mark.parametrize("kind", ["empty", "short", "long and fine", "stopped"])
def test_any_run_can_be_drawn(kind, tmp_path):
    runs = {
        "empty": lambda: Run("", 1_000_000, 1_000_000, np.empty(0), {}, {}),
        "short": lambda: made_up(0.003, 1_000_000),
        "long and fine": lambda: made_up(140.0, 100_000, measurements={"laser": NOTHING}),
        "stopped": lambda: made_up(2.5, 1_000_000, fault="diverged\n at t = 2.5 s", summary={"verdict": "INVALID"}),
    }  # fmt: skip
    draw(runs[kind](), tmp_path / "run.png")
    assert ink(tmp_path / "run.png")[0] == 1600


def test_phases_marks_and_controllers_are_told_in_spans():
    run = made_up(3.0, 1_000_000)
    assert timeline.phases(run) == [(0.0, 1.0, "drive.speed to 2 m/s"), (1.0, 3.0, "hold")]
    assert timeline.marks(run) == [(1.0, "on")]
    assert timeline.controlled(run) == [(1.0, 2.0, "c")]
    assert [section.text for section in timeline.sections(run)] == ["free", "c", "free"]


def test_only_the_plant_tells_what_happened_and_a_controller_of_its_own_parameters():
    run = made_up(3.0, 1_000_000)
    kinds = ("step", "mark", "limit", "connected", "disconnected", "parameter")
    said = [
        {"t_ns": 2 * 10**9, "tick": 2000, "kind": kind, "text": kind, "data": {"controller": "c"}} for kind in kinds
    ]
    run.events += [event | {"source": source} for source in ("guest", "c") for event in said]
    assert timeline.phases(run) == [(0.0, 1.0, "drive.speed to 2 m/s"), (1.0, 3.0, "hold")]
    assert timeline.marks(run) == [(1.0, "on"), (2.0, "parameter")]
    assert timeline.controlled(run) == [(1.0, 2.0, "c")]


def test_a_controller_without_a_protocol_works_from_when_it_is_enabled():
    run = made_up(3.0, 1_000_000)
    run.events = []
    run.scene = json.dumps({"controllers": {"c": {"enable_at": 2.0}}})
    assert timeline.controlled(run) == [(2.0, 3.0, "c")]


@settings(max_examples=30, deadline=None)
@given(arrays(np.float64, st.integers(50, 400), elements=st.floats(-1e6, 1e6)), st.integers(2, 10))
def test_a_thinned_line_keeps_its_extremes(v, columns):
    t = np.arange(v.size) * 1.0
    size = -(-v.size // columns)
    whole = v[: v.size // size * size] if v.size > 4 * columns else v
    at, drawn = thinned(t, v, columns)
    assert (drawn.min(), drawn.max()) == (whole.min(), whole.max())
    assert np.all(np.diff(at) >= 0.0)
    assert at.size <= max(4 * columns, 2 * columns)


def test_a_circuit_is_closed_from_switch_to_switch(tmp_path):
    hold = 'step = "hold"\ntime = "4 ms"'
    steps = [hold, *(f'step = "set"\ntarget = "shunt.connected"\nto = {to}\n[[protocol]]\n{hold}' for to in (1, 0))]
    text = shipped.path("brake_shunt").read_text().partition("[[protocol]]")[0]
    (tmp_path / "ours.toml").write_text("\n[[protocol]]\n".join([text, *steps]))
    run = rig.simulate(str(tmp_path / "ours.toml"))
    [span] = timeline.circuits(run, contact.system_of(run.scene))
    assert (span.begin, span.end) == pytest.approx((4e-3, 8e-3), abs=2.1e-5)
    assert span.text == "shunt connected"
    assert timeline.circuits(run, None) == []
    draw(run, tmp_path / "run.png")
    assert ink(tmp_path / "run.png")[2] > 0.03


def test_a_surface_far_faster_than_the_body_does_not_flatten_its_curve(run):
    from matplotlib.figure import Figure

    from rig.view import run_figure

    slow = replace(run, signals={**run.signals, "surface_speed": np.full(run.time.size, 20.0)})
    for one, below in ((run, True), (slow, False)):
        axes = Figure().subplots()
        channels = channels_of(one)
        run_figure.draw_panel(axes, one, channels, channels.panel_of("velocity"))
        drawn = {line.get_label(): line.get_color() for line in axes.get_lines()}
        assert ("surface speed" in drawn) is below
        assert drawn["velocity"] == channels.colours["velocity"]
        assert axes.get_ylim()[1] < 1.0


def test_a_window_of_a_longer_run_fills_the_figure(run):
    first = int(np.searchsorted(run.time, 0.6 * run.time[-1]))
    window = replace(
        run,
        time=run.time[first:],
        signals={name: v[first:] for name, v in run.signals.items()},
        mode=run.mode[first:],
    )
    limits = {axes.get_xlim() for axes in window.plot().axes[:3]}
    assert limits == {(window.time[0], window.time[-1])}
