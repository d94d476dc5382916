"""The figure of a run, and the story that it tells."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import rig
from rig.errors import UsageError
from rig.record.run import Commands, Run, Samples
from rig.scenes import shipped
from rig.view import contact, curves
from rig.view.curves import thinned
from rig.view.palette import put


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
    who = {"source": "plant", "data": {"controller": "c"}}
    events = [{"t_ns": t * 10**9, "tick": t * 1000, "kind": kind, "text": text} | who for t, kind, text in told_at]
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


@pytest.mark.parametrize("kind", ["simulated", "empty", "stopped"])
def test_any_run_can_be_drawn(kind, run, tmp_path):
    runs = {
        "simulated": lambda: run,
        "empty": lambda: Run("", 1_000_000, 1_000_000, np.empty(0), {}, {}),
        "stopped": lambda: made_up(2.5, 1_000_000, fault="diverged\n at t = 2.5 s", summary={"verdict": "INVALID"}),
    }
    put(runs[kind]().plot(), tmp_path / "run.png")
    width, height, share = ink(tmp_path / "run.png")
    assert width == 1600
    assert kind != "simulated" or (900 <= height <= 1200 and 0.05 < share < 0.8)


@settings(max_examples=30)
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
    [span] = curves.circuits(run, contact.system_of(run.scene))
    assert (span.begin, span.end) == pytest.approx((4e-3, 8e-3), abs=2.1e-5)
    assert span.text == "shunt connected"
    assert curves.circuits(run, None) == []
    put(run.plot(), tmp_path / "run.png")
    assert ink(tmp_path / "run.png")[2] > 0.03


def live(seconds=2.0, rate=10_000.0, motion=lambda t: np.sin(20 * t), noise=0.0):
    """A live run of the belt as it is recorded, with states at 200 Hz; its vibrometer is ideal but for the noise."""
    run = rig.simulate("belt", 0.1)
    t = np.arange(0.0, seconds, 0.005)
    fine = np.arange(0.0, seconds, 1.0 / rate)
    measured = motion(fine) + noise * np.random.default_rng(1).standard_normal(fine.size)
    return replace(
        run,
        time=t,
        mode=np.full(t.size, run.mode[-1]),
        signals={name: motion(t) for name in run.signals},
        measurements={"vibrometer": Samples(np.rint(1e9 * fine).astype(np.int64), measured)} if rate else {},
    )


def test_a_live_run_shows_no_vibration_that_there_was_not(tmp_path):
    squeal = live(motion=lambda t: 0.02 * np.sin(2 * np.pi * 601.0 * t))  # an alias of 1 Hz in the states
    put(squeal.plot(), tmp_path / "run.png")
    velocity, forces, portrait, close_up = (
        axes for axes in squeal.plot().axes if axes.get_ylabel() in ("velocity [mm/s]", "forces [mN]")
    )
    [line] = [one for one in velocity.get_lines() if len(one.get_xdata()) > 9]
    assert line.get_label() == "vibrometer (measured)"
    for axes in (forces, portrait):
        assert not [one for one in axes.get_lines() if len(one.get_xdata()) > 9]
        assert "200 samples per second" in axes.texts[0].get_text()
    crossings = np.diff(np.sign(close_up.get_lines()[-1].get_ydata())) > 0
    assert 3 <= crossings.sum() <= 5


@pytest.mark.parametrize(
    ("scene", "only", "labels"),
    [
        ("brake_shunt_listener", ["microphone", "truth/stack_voltage"], ["stack voltage [mV]", "microphone [mPa]"]),
    ],
)
def test_any_sensor_and_output_can_be_drawn_alone(scene, only, labels, tmp_path):
    run = rig.simulate(scene, 0.02)
    figure = run.plot(only)
    put(figure, tmp_path / "run.png")
    assert [axes.get_ylabel() for axes in figure.axes[: len(labels)]] == labels
    drawn = [line.get_label() for axes in figure.axes[: len(labels)] for line in axes.get_lines()]
    names = {name.removeprefix("truth/").replace("_", " ") for name in only}
    assert {label.removesuffix(" (measured)") for label in drawn if not label.startswith("_")} == names
    with pytest.raises(UsageError, match="no 'microphon' in this run"):
        run.plot(["microphon"])


def test_every_contact_has_its_strip_and_its_name(tmp_path):
    run = rig.simulate("brake", 0.01)
    put(run.plot(), tmp_path / "run.png")
    [strip] = [axes for axes in run.plot().axes if axes.images]
    names = ["inner left", "inner right", "outer left", "outer right"]
    assert [tick.get_text() for tick in strip.get_yticklabels()] == names
    assert strip.images[0].get_array().shape[0] == len(names)


def test_no_text_of_the_protocol_or_of_an_event_is_cut(tmp_path):
    run = made_up(3.0, 1_000_000)
    marks = [(t, f"mark {t:.2f} s, of which there is more to say than its time") for t in np.arange(0.1, 2.9, 0.2)]
    long = " ".join(["the reason, in many words, for which a run has stopped"] * 5)
    for texts in (marks, [(1.5, long), (2.99, "at the end")]):
        events = [
            {"t_ns": int(t * 1e9), "tick": 0, "source": "plant", "kind": "mark", "text": text, "data": {}}
            for t, text in texts
        ]
        marked = replace(run, events=[*run.events, *events])
        put(marked.plot(), tmp_path / "run.png")  # which judges its texts
        header = next(axes for axes in marked.plot().axes if any("hold" in one.get_text() for one in axes.texts))
        said = [one.get_text() for one in header.texts if one.get_text()]
        left_out = sum(int(one.split()[1]) for one in said if one.startswith("and "))
        whole = " ".join(reversed(said))
        assert sum(text in whole for _, text in texts) == len(texts) - left_out
        assert (left_out > 0) == (texts is marks)


def test_the_friction_figure_shows_steady_slip_under_the_load_of_the_contact():
    """Heat depends on the load: under 1 N the coefficient at 0.06 m/s would be 0.338."""
    scene = rig.load("belt_contact_temperature")
    [axes] = scene.plot().axes
    curve = axes.get_lines()[0]
    sliding = rig.modes(scene).sliding.equilibrium
    drawn = np.interp(0.06, *curve.get_data())
    assert drawn == pytest.approx(sliding["friction_force"] / sliding["normal_force"], rel=1e-4)
    assert "steady slip under 20 N" in curve.get_label()


def test_the_friction_figure_shows_no_static_coefficient_of_a_contact_that_does_not_stick():
    for name, dots in (("belt_lugre", 0), ("belt_stick_time", 1)):
        [axes] = rig.load(name).plot().axes
        assert sum(line.get_marker() == "o" for line in axes.get_lines()) == dots
