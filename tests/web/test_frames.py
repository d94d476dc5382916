"""What the curves of the page show: the extremes of all steps and samples, and gaps where nothing is known."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

import rig
from rig.bench.run.plant_truth import Bands
from rig.bench.run.runner import PlantRunner
from rig.bus import encode, messages
from rig.view import contact
from rig.web.frames import SAMPLES, STEPS, Frames

FRAMES = 100


def told(topic, kind, payload, t_ns=0):
    return SimpleNamespace(topic=topic, said=messages.TYPES[kind].FromString(payload), t_ns=t_ns)


@pytest.fixture(scope="module", params=["brake_shunt", "plate"])
def run(request):
    """A rig in vibration: its outputs and mode sets at every step, its messages `band` of 5 ms, and `Frames` for it."""
    scene = rig.load(request.param)
    runner, other = PlantRunner(scene, truthful=True), PlantRunner(scene)
    sent = []
    other.bands = Bands(
        len(other.outputs), other.step_ns, other.pair, lambda *given: sent.append(given), other.frame_ns
    )
    for k in range(FRAMES):
        runner.frame()
        other.frame()
        if k % 5 == 4:
            other.bands.put()
    runner.hand_over(runner.truth)
    values, keys = runner.truth.outputs()
    bands = [told("band", "Band", make(*given), t_ns) for t_ns, make, *given in sent]
    setup = SimpleNamespace(outputs=runner.units, paced=True, run="run", sensors={"vibrometer": ("m/s", 20_000)})
    return runner, values, keys, bands, lambda: Frames(setup, runner.motion.system)


def taken(frames, arrived):
    frames.add(arrived)
    return json.loads(frames.take().text)


def spans(rows):
    """Begin and end [s] of each span, and its place in the columns; those of which nothing is known are left out."""
    begins = [rows["from"], *rows["t"][:-1]]
    return [
        (begin, end, i)
        for i, (begin, end) in enumerate(zip(begins, rows["t"]))
        if rows["contacts"] == [] or rows["contacts"][0][i]
    ]


def test_every_span_has_the_extremes_and_the_contacts_of_all_its_steps(run):
    runner, values, keys, bands, new = run
    contacts = contact.Contacts(runner.motion.system).indices(keys)
    frames, end = new(), 0.0
    for k in range(0, len(bands), 10):
        rows = taken(frames, bands[k : k + 10])["rows"]
        assert rows["from"] == pytest.approx(end)
        assert len(rows["t"]) <= 25
        for begin, end, i in spans(rows):
            steps = slice(*(round(t * 1e9 / runner.step_ns) + 1 for t in (begin, end)))
            for name in ("low", "high"):
                by = np.min if name == "low" else np.max
                assert [column[i] for column in rows[name]] == pytest.approx(by(values[:, steps], axis=1), rel=1e-6)
            wanted = [sum(1 << one for one in {*lane[steps].tolist()}) for lane in contacts]
            assert [lane[i] for lane in rows["contacts"]] == wanted
    assert end == pytest.approx(FRAMES * 1e-3)


def test_what_was_lost_is_a_gap_within_a_frame_and_between_two(run):
    _, _, _, bands, new = run
    frames = new()
    rows = taken(frames, [*bands[:4], *bands[6:8]])["rows"]
    gap = rows["t"].index(pytest.approx(0.03))
    assert rows["t"][gap - 1] == pytest.approx(0.02)
    assert {column[gap] for name in ("low", "high") for column in rows[name]} == {None}
    assert None not in {column[i] for i in (gap - 1, gap + 1) for column in rows["low"]}
    assert taken(frames, bands[12:14])["rows"]["from"] == pytest.approx(0.06)


def test_the_phase_portrait_is_one_stretch_of_all_steps(run):
    runner, values, _, bands, new = run
    if not runner.pair:
        assert "portrait" not in taken(new(), bands)
        return
    for arrived, longest in ((bands, STEPS), ([*bands[:10], *bands[14:]], STEPS), (bands[-1:], 5 * runner.steps)):
        found = taken(new(), arrived)["portrait"]
        count = len(found["x"])
        assert count == min(longest, STEPS, (30 if len(arrived) == 16 else FRAMES) * runner.steps)
        begin = round(found["from"] / found["step"])
        assert begin + count == FRAMES * runner.steps
        for name, place in zip(("x", "v"), runner.pair):
            assert found[name] == pytest.approx(values[place, begin + 1 :], rel=1e-6)


@pytest.mark.parametrize("count", [20, 2250])
def test_samples_of_a_sensor_are_joined_to_extremes_and_lost_ones_leave_a_gap(run, count):
    *_, new = run
    frames, period = new(), 20_000
    v = np.sin(2.0 * np.pi * 3400.0 * np.arange(3 * count) * period * 1e-9)
    blocks = [encode.block(0, k * period, period, v[k : k + count]) for k in (0, 2 * count)]
    rows = taken(frames, [told("meas/vibrometer", "Block", block) for block in blocks])["meas"]["vibrometer"]
    gap = rows["low"].index(None)
    assert rows["high"][gap] is None
    assert rows["t"][gap] == pytest.approx((2 * count - 1) * period * 1e-9)
    assert len(rows["t"]) <= SAMPLES + 2
    assert min(rows["low"][:gap]) == pytest.approx(v[:count].min(), rel=1e-6)
    assert max(rows["high"][:gap]) == pytest.approx(v[:count].max(), rel=1e-6)
    if count > SAMPLES:
        assert max(rows["low"][:gap]) < 0.0 < min(rows["high"][:gap])  # each span has whole periods
