"""Vibration events: squeals whose begin, end and growth are known, and simulated rigs whose eigenvalues are known."""

import math

import numpy as np
import pytest

import rig as lab
from rig.analysis.recorded.events import events
from rig.analysis.recorded.growth import grown
from rig.errors import SceneError, UsageError
from rig.record.run import Run, Samples

RATE = 20_000.0


def measured(rate=RATE, **channels):
    """A measurement of channels (values, unit)."""
    t_ns = np.rint(np.arange(len(next(iter(channels.values()))[0])) * 1e9 / rate).astype(np.int64)
    return Run(
        scene="",
        step_ns=1_000_000,
        frame_ns=1_000_000,
        time=np.empty(0),
        signals={},
        measured=True,
        name="m",
        units={f"meas/{name}": unit for name, (_, unit) in channels.items()},
        measurements={name: Samples(t_ns, np.asarray(v, float)) for name, (v, _) in channels.items()},
    )


def amplitude(kind, a, u, lasts=0.3, decay=80.0):
    """A growth up to 1 at u = 0 [s], sudden or as at a Hopf bifurcation, and a decay after `lasts`."""
    size = (
        np.exp(np.minimum(a * u, 0.0)) if kind == "sudden" else (1.0 + np.exp(np.clip(-2.0 * a * u, -600, 600))) ** -0.5
    )
    return size * np.exp(-decay * np.maximum(u - lasts, 0.0))


def density(db, band):
    """Density of a noise whose RMS in `band` [Hz] lies `db` below that of a sine of amplitude 1."""
    return 0.5 / 10.0 ** (db / 10.0) / band


def noise(rng, size, density):
    return rng.normal(size=size) * math.sqrt(density * RATE / 2.0)


def rates(kind, db, band, count, a=60.0, f=1800.0):
    """Growth of one squeal in `count` noises, with the ends of its interval [draw, 3]."""
    t = np.arange(int(1.6 * RATE)) / RATE
    made = []
    for seed in range(count):
        rng = np.random.default_rng(seed)
        v = amplitude(kind, a, t - 1.0) * np.cos(2.0 * np.pi * f * t + rng.uniform(0.0, 6.3))
        growth = grown(v + noise(rng, t.size, density(db, band)), RATE, f + 3.0, density(db, band), 0.97, 1.32, 500.0)
        made.append(growth[:3])
    return np.array(made)


@pytest.mark.parametrize("kind", ["sudden", "smooth"])
def test_the_growth_at_20_db_is_within_2_percent(kind):
    found = rates(kind, 20.0, 0.5 * RATE, 12)
    assert np.median(found[:, 0]) == pytest.approx(60.0, rel=0.02)
    assert np.all(np.abs(found[:, 0] / 60.0 - 1.0) < 0.1)
    assert np.sum((found[:, 1] <= 60.0) & (found[:, 2] >= 60.0)) >= 8


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["sudden", "smooth"])
@pytest.mark.parametrize(
    ("db", "band", "within"), [(20.0, 0.5 * RATE, 0.02), (20.0, 500.0, 0.05), (6.0, 0.5 * RATE, 0.1)]
)
def test_intervals_cover_the_growth(kind, db, band, within):
    found = rates(kind, db, band, 100)
    assert np.median(found[:, 0]) == pytest.approx(60.0, rel=within)
    assert 80 <= np.sum((found[:, 1] <= 60.0) & (found[:, 2] >= 60.0)) <= 98


def record(seed, seconds=10.0, number=6):
    """Squeals with harmonics at 20 dB in 500 Hz; begin and end, between which they exceed the noise, and frequency."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * RATE)) / RATE
    v, truth = noise(rng, t.size, density(20.0, 500.0)), []
    for slot in np.arange(number) * seconds / number:
        a, f, begin = rng.uniform(30.0, 120.0), rng.uniform(600.0, 6000.0), slot + rng.uniform(0.35, 0.5)
        size = amplitude(("sudden", "smooth")[seed % 2], a, t - begin, rng.uniform(0.1, 0.8), rng.uniform(40.0, 200.0))
        phase = 2.0 * np.pi * f * t + rng.uniform(0.0, 6.3)
        v += size * np.cos(phase) + 0.2 * size**2 * np.cos(2.0 * phase) + 0.1 * size**3 * np.cos(3.0 * phase)
        loud = t[size > 0.1]
        truth.append((loud[0], loud[-1], f))
    return v, truth


def score(seeds):
    """F1: an event is found if both intervals share at least half."""
    hits = found = known = 0
    for seed in seeds:
        v, truth = record(seed)
        listed = events(measured(vibrometer=(v, "m/s"))).events
        for begin, end, f in truth:
            hits += any(
                min(end, e.end) - max(begin, e.begin) >= 0.5 * max(end - begin, e.end - e.begin)
                and abs(e.frequency - f) < 5.0
                for e in listed
            )
        found, known = found + len(listed), known + len(truth)
    return 2.0 * hits / (found + known)


def test_squeals_are_found_once_with_their_begin_and_end():
    assert score([0]) >= 0.98


@pytest.mark.slow
def test_squeals_of_many_recordings_are_found():
    assert score(range(1, 17)) >= 0.98


def test_a_tone_that_is_too_slow_for_the_recording_is_named():
    t = np.arange(2000) / 1000.0
    result = events(measured(1000.0, laser=(np.cos(2.0 * np.pi * 3.0 * t), "m")))
    assert "3 Hz is stronger, but needs windows of 2.67 s" in result.text()


def test_a_constant_channel_contains_no_event():
    assert not events(measured(v=(np.full(40_000, 3.0), "m/s")), "v").events


@pytest.mark.parametrize("size", [2, 3, 100])
def test_a_few_samples_are_refused(size):
    with pytest.raises(UsageError, match=f"{size} samples .*too few"):
        events(measured(v=(np.arange(float(size)), "m/s")), "v")


def test_noise_contains_no_event():
    v = noise(np.random.default_rng(3), int(20 * RATE), 1.0)
    result = events(measured(accelerometer=(v, "m/s^2")))
    assert not result.events
    assert "no tone rises out of the noise" in result.text()
    assert result.plot() is not None


def test_a_resonance_and_a_hum_are_no_squeals():
    """Noise in a narrow line is no event; a hum is one that both ends cut, and its growth is not known."""
    from scipy.signal import lfilter

    rng = np.random.default_rng(4)
    t = np.arange(int(10 * RATE)) / RATE
    pole = np.exp(complex(-2.0 * np.pi * 10.0, 2.0 * np.pi * 2000.0) / RATE)
    resonance = lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], rng.normal(size=t.size))
    v = resonance / resonance.std() + 0.1 * rng.normal(size=t.size) + np.cos(2.0 * np.pi * 400.0 * t)
    listed = events(measured(accelerometer=(v, "m/s^2"))).events
    assert [round(event.frequency) for event in listed] == [400]
    assert listed[0].cut == "both"
    assert not math.isfinite(listed[0].growth)


def test_an_event_is_cut_at_the_ends_and_at_gaps():
    rng = np.random.default_rng(5)
    t = np.arange(int(4 * RATE)) / RATE
    size = np.where((t < 0.6) | (t > 3.2), 1.0, amplitude("sudden", 60.0, t - 1.6, 0.5))
    v = size * np.cos(2.0 * np.pi * 1000.0 * t) + noise(rng, t.size, density(20.0, 500.0))
    v[int(1.9 * RATE) : int(2.4 * RATE)] = np.nan
    result = events(measured(vibrometer=(v, "m/s")))
    assert [event.cut for event in result.events] == ["begin", "end", "end"]
    assert result.events[1].growth == pytest.approx(60.0, rel=0.3)
    assert result.events[1].end == pytest.approx(1.9, abs=0.05)
    assert "missing" in result.text()


@pytest.mark.parametrize(
    ("scene", "seconds", "within"), [("two_dof", None, 0.015), ("brake", 0.4, 0.005)], ids=lambda value: str(value)
)
def test_the_growth_of_a_simulated_rig_is_that_of_its_eigenvalue(scene, seconds, within):
    run = lab.simulate(scene, seconds)
    truth = lab.modes(scene).sliding.growth
    (event,) = lab.events(run, over=scene).events
    assert event.growth == pytest.approx(truth, rel=within)
    assert event.low <= truth <= event.high
    assert event.decay != event.decay  # the run ends before


def test_events_lie_over_the_eigenvalues_of_a_scene():
    run = lab.simulate("two_dof")
    result = lab.events(run, over="two_dof", key="load.force", at=["normal_force"])
    f, growth = result.eigenvalue(result.events[0])
    assert result.events[0].growing == pytest.approx(f, rel=2e-3)
    assert growth == pytest.approx(0.18, rel=1e-3)
    assert result.to_json()["events"][0]["at"]["normal_force"] == pytest.approx(0.5, rel=0.02)
    assert "scene 1/s" in result.text()
    with pytest.raises(UsageError, match="name it"):
        lab.events(run, over="two_dof", key="load.force", at=["surface_speed"])
    with pytest.raises(SceneError, match="did you mean"):
        lab.events(run, over="two_dof", key="load.forc")


def test_squeals_that_begin_with_a_jump_have_the_growth_of_their_eigenvalues():
    """Three runs behind each other, between them noise; each begins with a disturbance and grows from there."""
    rng, parts, truth = np.random.default_rng(1), [], []
    for mu in (0.42, 0.46, 0.5):
        scene = lab.load("two_dof", {"friction.mu": mu})
        truth.append(lab.modes(scene).sliding.growth)
        parts += [np.zeros(12_000), lab.simulate(scene, 30.0).measurements["vibrometer"].v[:30_000]]
    v = np.concatenate(parts)
    listed = lab.events(measured(1000.0, vibrometer=(v + 1e-3 * rng.normal(size=v.size), "m/s")), window=4.0).events
    assert [event.growth for event in listed] == pytest.approx(truth, rel=0.03)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"name": "vibro"}, "vibrometer"),
        ({"window": 0.5}, "too few.*--window"),
        ({"window": 1e-4}, "too few.*higher rate"),
        ({"at": ["speed"]}, "speed"),
        ({"key": "load.force"}, "--over SCENE"),
    ],
)
def test_what_cannot_be_evaluated_is_named(given, message):
    run = measured(vibrometer=(np.random.default_rng(1).normal(size=4000), "m/s"))
    with pytest.raises(UsageError, match=message):
        events(run, **given)
