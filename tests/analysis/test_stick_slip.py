"""Stick and slip in recordings: against limit cycles, a published detector, and a law that is known."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

import rig as lab
from rig.analysis.recorded.stick_slip import stick_slip
from rig.analysis.recorded.trend import trend
from rig.errors import UsageError
from rig.record.run import Run, Samples

PAPER = Path(__file__).parents[2] / "recordings" / "stick_slip_paper"


def measured(rate=2000.0, **channels):
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


@pytest.fixture(scope="module")
def cycles():
    scene = lab.load("belt")
    return lab.limit_cycle(scene), lab.simulate(scene, duration=12.0)


def test_times_are_those_of_the_limit_cycle(cycles):
    """With the true velocity as well as with that of the vibrometer, to a sample."""
    cycle, run = cycles
    for velocity, rate in (("velocity", 1000.0), ("vibrometer", 1000.0)):
        found = stick_slip(run, velocity, drive="surface_speed", first=6.0, threshold=1e-5)
        assert len(found.slips) > 10
        assert found.median("stick")[0] == pytest.approx(cycle.stick_time["contact"], abs=1.5 / rate)
        period = np.median(np.diff([slip.begin for slip in found.slips]))
        assert period == pytest.approx(cycle.period, abs=1.0 / rate)
        assert found.share == pytest.approx(cycle.stick_time["contact"] / cycle.period, abs=3e-3)


def reference(force, speed, stiffness, threshold):
    """The published detector as its authors describe it, sample by sample."""
    v = speed - np.diff(force) * 2000.0 / stiffness
    above = v >= 10.0 * threshold
    v = v.tolist()
    spans = []
    for i in (np.flatnonzero(above[1:] & ~above[:-1]) + 1).tolist():
        a = b = i
        while a > 0 and v[a] > threshold:
            a -= 1
        while b < len(v) - 1 and v[b] > threshold:
            b += 1
        if v[a] <= threshold and v[b] <= threshold and (a, b) not in spans:
            spans.append((a, b))
    return spans


@pytest.mark.parametrize("path", sorted(PAPER.glob("*.mat")), ids=lambda path: path.stem)
@pytest.mark.parametrize("smooth", [0.0, 0.05, 0.24])
def test_slips_of_paper_are_those_of_the_published_detector(path, smooth):
    force = loadmat(path)["Fnorm"].ravel() * 0.301167
    stiffness, speed = (float(part) for part in path.stem.removeprefix("k").split("Nm_v"))
    found = stick_slip(
        measured(force=(force, "N")),
        friction="force",
        stiffness=stiffness,
        drive=speed * 1e-6,
        threshold=40e-6,
        smooth=smooth,
    )
    spans = reference(found.force, speed * 1e-6, stiffness, 40e-6)
    assert [(round(2000 * slip.begin), round(2000 * slip.end)) for slip in found.slips] == spans
    assert found.spikes < 0.02 * force.size


def test_the_smoothing_solves_its_problem():
    """The optimality conditions: v - y = s D' z with |z| <= 1, and z = sign(D y) where D y is not 0."""
    rng = np.random.default_rng(1)
    t = np.arange(2000)
    clean = np.interp(t, [0, 700, 730, 1500, 1999], [0.0, 1.0, 0.2, 0.9, 0.3])
    v, s = clean + 0.02 * rng.standard_normal(t.size), 5.0
    y = trend(v, s)
    z = np.cumsum(np.cumsum(v - y))[:-2] / s
    bend = np.diff(y, 2)
    assert np.abs(z).max() < 1.0 + 1e-3
    assert np.abs(z[np.abs(bend) > 1e-4] - np.sign(bend[np.abs(bend) > 1e-4])).max() < 0.02
    assert np.std(y - clean) < 0.3 * 0.02
    assert np.abs(trend(0.3 * t + 1.0, s) - (0.3 * t + 1.0)).max() < 1e-6


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_friction_over_speed_is_that_of_a_sweep(noise):
    """A drive runs up and down over a body at rest; friction falls with the speed, and is 5 % less on the way down."""
    rng = np.random.default_rng(2)
    t = np.arange(40_000) / 2000.0
    v = 0.1 * np.minimum(t, 20.0 - t) / 10.0 + 1e-3
    mu = 0.3 + 0.2 * np.exp(-v / 0.03)
    load = 20.0 + np.sin(3.0 * t)
    force = mu * load * np.where(t < 10.0, 1.0, 0.95)
    v = v + 0.05 * noise * rng.standard_normal(t.size)
    run = measured(speed=(v, "m/s"), gauge=(force + noise * 10.0 * rng.standard_normal(t.size), "N"), load=(load, "N"))
    found = stick_slip(run, "speed", "gauge", load="load", threshold=1e-3)
    for curve, share in ((found.up, 1.0), (found.down, 0.95)):
        assert curve.speed.size >= 8
        wanted = share * (0.3 + 0.2 * np.exp(-curve.speed / 0.03))
        assert np.abs(curve.friction / wanted - 1.0).max() < 0.02
    assert found.law().startswith('[friction]\nlaw = "table"\nspeeds = [0.0, ')


def test_a_law_from_a_recording_is_a_law_of_a_scene(tmp_path):
    t = np.arange(4000) / 2000.0
    run = measured(speed=(0.01 + 0.1 * t, "m/s"), gauge=(8.0 - t, "N"))
    text = stick_slip(run, "speed", "gauge", load=20.0).law()
    (tmp_path / "mine.toml").write_text(f'based_on = "belt"\n{text}')
    scene = lab.load(tmp_path / "mine.toml")
    assert scene.parameters.friction.friction().mu(0.11) == pytest.approx(0.35, rel=0.02)


COULOMB = {"friction.mu_static": 0.5, "friction.mu_kinetic": 0.3, "body.damping": 2.0}


@pytest.mark.parametrize("speed", [0.06, 0.006])
def test_breakaway_is_the_largest_force_before_the_slip_however_it_is_measured(speed):
    """A gauge whose force drops, a spring, and a spring alone: 1 to 60 samples a slip, thresholds of 0.1 to 3 mm/s."""
    run = lab.simulate(lab.load("belt_c", {**COULOMB, "drive.speed": speed}), duration=30.0)
    rng = np.random.default_rng(7)
    kinds = {"friction_force": ("v",), "displacement": ("v", "")}
    for every in (4, 10, 20, 60, 120)[: 3 if speed > 0.01 else 5]:
        v = run.signals["velocity"][::every]
        one_sample = 2500.0 * speed * every / 1000.0
        noise = 2e-4
        for kind, velocities in kinds.items():
            force = run.signals[kind][::every] * (2500.0 if kind == "displacement" else 1.0)
            force = force + noise * rng.standard_normal(force.size)
            measurement = measured(1000.0 / every, v=(v, "m/s"), force=(force, "N"))
            for velocity in velocities:
                for threshold in (1e-4, 1e-3, 3e-3):
                    found = stick_slip(
                        measurement, velocity, "force", drive=speed, stiffness=2500.0, threshold=threshold
                    )
                    assert len(found.slips) > 12  # where a slip is a sample long, many are slower than ten thresholds
                    assert found.median("breakaway")[0] == pytest.approx(10.0, abs=one_sample + 4.0 * noise)
                    assert found.spikes <= 2


def test_a_law_from_a_gauge_whose_force_drops_sticks_and_slips_again(tmp_path):
    run = lab.simulate(lab.load("belt_c", COULOMB), duration=10.0)
    text = stick_slip(run, "velocity", "friction_force", drive="surface_speed", load="normal_force").law()
    (tmp_path / "mine.toml").write_text(f'based_on = "belt"\n[body]\ndamping = 2.0\n{text}')
    scene = lab.load(tmp_path / "mine.toml")
    again = lab.simulate(scene, duration=10.0)
    assert scene.parameters.friction.mu_static == pytest.approx(0.5, abs=2500.0 * 0.06 * 1e-3 / 20.0)
    assert len(again.events) == pytest.approx(len(run.events), abs=2)


def test_spikes_are_replaced_and_told():
    t = np.arange(4000) / 2000.0
    force = 5.0 + np.sin(20.0 * t)
    force[[500, 2100]] += 30.0
    found = stick_slip(measured(gauge=(force, "N"), speed=(0.01 + 0.1 * t, "m/s")), "speed", "gauge")
    assert found.spikes == 2
    assert np.abs(found.force - 5.0).max() < 1.01


@pytest.mark.parametrize("kind", ["nan", "held"])
def test_drop_outs_of_a_laser_hide_slips_and_make_none(kind):
    """Sticks of 0.1 s and slips of 0.1 s; short gaps are bridged, a long one in a slip or a stick leaves these out."""
    rate, period = 2000.0, 400
    t = np.arange(20 * period) / rate
    phase = (np.arange(t.size) % period) / period
    slip = np.where(phase > 0.5, 0.02 * np.sin(2.0 * np.pi * (phase - 0.5)), 0.0)
    clean = stick_slip(measured(v=(0.05 - slip, "m/s")), "v", drive=0.05, threshold=1e-4)
    assert len(clean.slips) == 19  # the last one is cut by the end
    v = 0.05 - slip
    short, in_slip = [(2, 250, 254), (5, 290, 293)], [(8, 240, 260), (12, 330, 350)]
    in_stick = [(15, 60, 90)] if kind == "nan" else []
    for row, a, b in (*short, *in_slip, *in_stick):
        part = slice(row * period + a, row * period + b)
        v[part] = math.nan if kind == "nan" else v[part.start - 1]
    found = stick_slip(measured(v=(v, "m/s")), "v", drive=0.05, threshold=1e-4)
    begins = [slip.begin for slip in clean.slips if round(slip.begin * rate) // period not in (8, 12)]
    assert [slip.begin for slip in found.slips] == begins
    assert found.median("motion")[0] == clean.median("motion")[0]
    assert sum(math.isnan(slip.stick) for slip in found.slips) == 3 + len(in_stick)
    assert found.share == pytest.approx(clean.share, abs=2e-3)
    counts = (0, 7, 70, 5) if kind == "nan" else (44, 4, 40, 5)
    assert (found.held, found.bridged, found.missing, found.cut) == counts
    assert f"{found.missing} samples missing in longer gaps, 5 slips cut by an end or a gap" in found.text()


def test_slips_that_are_noise_are_told():
    """40 slips; the threshold that is named finds them again."""
    rng = np.random.default_rng(1)
    phase = np.arange(20_000) / 500.0 % 1.0
    slip = np.where(phase < 0.3, 0.05 * np.sin(math.pi * np.minimum(phase, 0.3) / 0.3) ** 2, 0.0)
    run = measured(v=(slip + 1e-3 * rng.standard_normal(slip.size), "m/s"))
    noisy = stick_slip(run, "v", threshold=2e-4)
    assert len(noisy.slips) > 100
    assert noisy.noise == pytest.approx(1e-3, rel=0.1)
    told = re.search(r"some of the slips may be noise: .* take a threshold above ([\d.e-]+) m/s", noisy.text())
    found = stick_slip(run, "v", threshold=float(told[1]))
    assert len(found.slips) == 40
    assert "noise" not in found.text()


def waves(slip, stick, noise, seed=3):
    """Speed [m/s] and force [N] of 200 slips of a contact that last `slip` and rest `stick` samples of 1 ms."""
    phase = np.arange(int(200 * (slip + stick))) % (slip + stick) - stick
    peak = 0.05 * 0.5 * math.pi * (slip + stick) / slip
    v = np.where(phase >= 0.0, peak * np.sin(math.pi * phase / slip), 0.0)
    force = np.where(phase >= 0.0, 6.0, 10.0 + 0.125 * phase)
    rng = np.random.default_rng(seed)
    return v + noise * rng.standard_normal(v.size), force


@pytest.mark.parametrize("noise", [0.0, 5e-4])
@pytest.mark.parametrize("threshold", [1e-4, 3e-3])
@pytest.mark.parametrize(
    ("slip", "stick"), [(1.37, 0.3), (1.37, 20.0), (5.37, 0.7), (20.37, 1.5), (50.37, 0.3), (50.37, 40.0)]
)
def test_sticks_that_are_shorter_than_the_samples_are_told_and_give_no_law(slip, stick, threshold, noise):
    v, force = waves(slip, stick, noise)
    run = measured(1000.0, v=(v, "m/s"), force=(force, "N"))
    found = stick_slip(run, "v", "force", load=20.0, threshold=threshold)
    if not found.doubts:
        assert len(found.slips) == pytest.approx(199, abs=3)
        assert found.median("breakaway")[0] * 20.0 == pytest.approx(10.0, abs=0.13)
    else:
        assert stick < 3.0 or 50.0 * noise > threshold
        assert found.doubts[0] in found.text()
        with pytest.raises(UsageError, match="no law is written: "):
            found.law()


def test_a_vibration_about_rest_is_told():
    """Slips of 50 mm/s every second, or none, and a contact that trembles by 3 mm/s at 40 Hz."""
    t = np.arange(20_000) / 1000.0
    slip = np.where(t % 1.0 < 0.1, 0.05 * np.sin(math.pi * (t % 1.0) / 0.1), 0.0)
    tremble = 0.003 * np.sin(80.0 * math.pi * t)
    for v in (slip + tremble, 1e-5 + tremble):
        found = stick_slip(measured(1000.0, v=(v, "m/s")), "v", threshold=2e-4)
        assert any("a vibration or noise about rest" in doubt for doubt in found.doubts)
        assert f"{found.against} times" in found.text()
    assert len(stick_slip(measured(1000.0, v=(slip + tremble, "m/s")), "v", threshold=1e-3).slips) == 20
    assert not stick_slip(measured(1000.0, v=(slip + tremble, "m/s")), "v", threshold=1e-3).doubts


def test_a_constant_speed_is_not_taken_for_a_held_one():
    t = np.arange(8000) / 2000.0
    v = np.interp(t, [1.0, 1.1, 2.0, 2.1], [0.01, 0.03, 0.03, 0.01])  # steady sliding at two speeds, without noise
    assert stick_slip(measured(v=(v, "m/s")), "v", threshold=5e-4).held == 0


def test_what_is_missing_is_asked_for():
    run = measured(gauge=(np.ones(100), "N"))
    with pytest.raises(UsageError, match="--velocity"):
        stick_slip(run, friction="gauge")
    found = stick_slip(run, friction="gauge", stiffness=100.0, drive=0.0011)
    assert (len(found.slips), found.share) == (0, 0.0)
    assert math.isnan(found.median("stick")[0])
    with pytest.raises(UsageError, match="coefficient over at least two speeds"):
        found.law()
