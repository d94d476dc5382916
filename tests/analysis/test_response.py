"""Frequency responses against closed forms: of samples with a known response, and of rigs with known matrices."""

import csv
import json
import math

import control
import numpy as np
import pytest
from scipy.signal import lfilter

import rig as laboratory
from rig.analysis.recorded import response, series
from rig.errors import UsageError
from rig.record.run import Run, Samples
from rig.record.save_run import save

RATE = 1000
HERTZ, DAMPING = 40.0, 0.02
OMEGA = 2.0 * math.pi * HERTZ
OSCILLATOR = control.ss(
    [[0.0, 1.0], [-(OMEGA**2), -2.0 * DAMPING * OMEGA]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]]
)  # m/N, a mass of 1 kg


def run_of(rate=RATE, **channels):
    """A recording of sensors: by name their samples, or (samples, rate, delay of the first)."""
    found = {}
    for name, given in channels.items():
        v, hertz, delay = given if isinstance(given, tuple) else (given, rate, 0.0)
        found[name] = Samples(np.rint((delay + np.arange(v.size) / hertz) * 1e9).astype(np.int64), v)
    return Run(
        scene='{"name": "made", "plant": "belt"}',
        step_ns=1_000_000,
        frame_ns=1_000_000,
        time=np.array([0.0, max(one.t_ns[-1] for one in found.values()) * 1e-9]),
        signals={"surface_speed": np.zeros(2)},
        units={"meas/force": "N", "meas/laser": "m", "surface_speed": "m/s"},
        measurements=found,
    )


def white(seed, count=200 * RATE):
    return np.random.default_rng(seed).standard_normal(count)


def held(system, f, rate=RATE):
    """The response of a system to an input that is held between samples, at f [Hz]; and its answer to samples."""
    discrete = control.sample_system(system, 1.0 / rate, "zoh")
    b, a = (np.ravel(part[0][0]) for part in (control.tf(discrete).num, control.tf(discrete).den))
    return discrete(np.exp(2j * math.pi * f / rate)), lambda x: lfilter(np.pad(b, (a.size - b.size, 0)), a, x)


def test_the_response_of_a_filter_is_its_own_within_the_random_error():
    x = white(1)
    noise = 3.0 * white(2)
    found = response(run_of(force=x, laser=lfilter([2.0, 1.0], [1.0, -0.5], x) + noise), "force", "laser", window=2.0)
    z = np.exp(-2j * math.pi * found.f / RATE)
    exact = (2.0 + z) / (1.0 - 0.5 * z)
    off = (found.h - exact) / np.abs(exact)
    true = np.abs(exact) ** 2 / (np.abs(exact) ** 2 + 9.0)  # of white noise of variance 1 and 9
    error = np.sqrt((1.0 - true) / (2.0 * found.independent * true))
    for part in (off.real, off.imag):  # the scatter is what Bendat and Piersol say
        assert np.sqrt(np.mean((part / error) ** 2)) == pytest.approx(1.0, rel=0.08)
    scatter = np.sqrt(2.0 * true / found.independent) * (1.0 - true)
    assert np.sqrt(np.mean(((found.coherence - true) / scatter) ** 2)) == pytest.approx(1.0, rel=0.1)
    assert np.mean(found.coherence - true) == pytest.approx(0.0, abs=0.005)
    assert np.median(found.error / error) == pytest.approx(1.0, rel=0.03)
    assert (found.unit, found.windows, found.tapered) == ("m/N", 199, True)
    assert found.independent == pytest.approx(199 / (1.0 + 2.0 / 36.0), rel=1e-3)  # Hann, half overlapping: (1/6)^2


def test_noise_in_the_input_lowers_h1_and_not_h2():
    x = white(4)
    found = response(run_of(force=x + 0.5 * white(5), laser=2.0 * x), "force", "laser", window=1.0)
    assert np.abs(found.h).mean() == pytest.approx(2.0 / 1.25, rel=0.005)
    assert (np.abs(found.h) / found.coherence).mean() == pytest.approx(2.0, rel=0.005)


def test_the_pole_of_an_oscillator_is_found():
    x = white(8)
    answer = held(OSCILLATOR, np.zeros(1))[1](x)
    found = response(run_of(force=x, laser=answer), "force", "laser", window=20.0)
    [one] = found.resonances
    assert one.frequency == pytest.approx(HERTZ * math.sqrt(1.0 - DAMPING**2), rel=1e-3)
    assert one.damping == pytest.approx(DAMPING, rel=0.03)
    assert one.bandwidth == pytest.approx(2.0 * DAMPING * HERTZ, rel=0.03)
    assert one.magnitude == pytest.approx(1.0 / (2.0 * DAMPING * OMEGA**2), rel=0.03)
    coarse = response(run_of(force=x, laser=answer), "force", "laser", window=1.0)
    assert coarse.resonances[0].damping > 1.1 * DAMPING
    assert "narrower than four lines: magnitude too low, damping too high" in coarse.text()
    assert "narrower" not in found.text()


def blows(count=4, apart=5.0, last=5.0):
    """Half sines of 5 ms, `apart` [s]."""
    t = np.arange(int(RATE * (0.1 + (count - 1) * apart + last))) / RATE
    x = np.zeros(t.size)
    for i in range(count):
        since = t - 0.1 - i * apart
        x += np.where((since > 0.0) & (since < 0.005), (1.0 + i) * np.sin(math.pi * since / 0.005), 0.0)
    return x


def test_pulses_get_windows_of_their_own_without_taper():
    """A response that dies away within its window is exact: no leakage."""
    x = blows()
    answer = held(OSCILLATOR, np.zeros(1))[1](x)
    found = response(run_of(force=x, laser=answer), "force", "laser")
    exact, _ = held(OSCILLATOR, found.f)
    assert (found.windows, found.tapered) == (4, False)
    assert found.window == pytest.approx(5.0)
    lines = found.f < 200.0
    assert found.h[lines] == pytest.approx(exact[lines], rel=1e-6)
    assert found.coherence[lines] == pytest.approx(1.0, abs=1e-9)
    [one] = found.resonances
    assert one.frequency == pytest.approx(HERTZ * math.sqrt(1.0 - DAMPING**2), rel=1e-6)
    assert one.damping == pytest.approx(DAMPING, rel=1e-4)
    assert "mean of 4 windows of 5 s (from pulse to pulse), 4 independent" in found.text()
    assert found.rest < 1e-9


def test_noise_and_drift_of_the_force_between_the_pulses_do_not_count():
    x = blows(8)
    answer = held(OSCILLATOR, np.zeros(1))[1](x)
    t = np.arange(x.size) / RATE
    found = response(run_of(force=x + 0.02 * white(11, x.size) + 0.05 * t + 3.0, laser=answer), "force", "laser")
    assert (found.windows, found.tapered) == (8, False)
    lines = (found.f > 5.0) & (found.f < 150.0)
    exact, _ = held(OSCILLATOR, found.f[lines])
    assert np.abs(found.h[lines] / exact - 1.0).max() < 0.03
    assert found.resonances[0].damping == pytest.approx(DAMPING, rel=5e-3)


def test_what_is_no_pulse_gets_hann_windows():
    t = np.arange(20 * RATE) / RATE
    for x in (np.sin(40.0 * t), np.sin((1.0 + t) * t)):
        assert response(run_of(force=x, laser=2.0 * x), "force", "laser").tapered


def test_a_single_pulse_has_no_coherence_and_pulses_too_close_are_told():
    x = blows(1)
    answer = held(OSCILLATOR, np.zeros(1))[1](x)
    single = response(run_of(force=x, laser=answer), "force", "laser")
    assert np.isnan(single.coherence).all()
    assert "coherence and random error are unknown: there is a single window" in single.text()
    assert single.resonances[0].damping == pytest.approx(DAMPING, rel=1e-4)
    x = blows(4, 0.3, 0.3)
    close = response(run_of(force=x, laser=held(OSCILLATOR, np.zeros(1))[1](x)), "force", "laser")
    assert close.rest > 0.02
    assert "whose leakage falsifies the response" in close.text()


@pytest.mark.parametrize(("fast", "delay"), [(5_000, 0.00013), (1000, 0.00037)])
def test_channels_of_different_rates_are_brought_together(fast, delay):
    """Sines that both see, and one of 700 Hz that only the faster one can tell from 300 Hz."""
    rng = np.random.default_rng(9)
    f, phase = np.arange(5.0, 400.0, 0.7), rng.uniform(0.0, 2.0 * math.pi, 565)

    def seen(t, also=0.0):
        smooth = sum(np.sin(2.0 * math.pi * a * t + b) for a, b in zip(f, phase))
        return smooth + also * np.sin(2.0 * math.pi * 700.0 * t)

    slow_t, fast_t = np.arange(10 * RATE) / RATE, delay + np.arange(10 * fast) / fast
    run = run_of(force=(seen(fast_t, 30.0 * (fast > 1400)), fast, delay), laser=seen(slow_t))
    found = response(run, "force", "laser", window=2.0)
    assert found.rate == pytest.approx(RATE)
    assert found.f[-1] == pytest.approx(400.0, abs=1.0)
    inside = (found.f > 8.0) & (found.f < 396.0)
    assert found.h[inside] == pytest.approx(1.0, abs=3e-3)
    assert found.coherence[inside] == pytest.approx(1.0, abs=1e-4)


def test_gaps_are_told_and_left_out():
    x = white(10)
    y = 2.0 * x
    y[30_000:31_000] = np.nan
    y[50_000] = np.nan
    found = response(run_of(force=x, laser=y), "force", "laser", window=1.0)
    assert found.bridged == 1
    assert found.left_out in (3, 4)  # half overlapping windows that meet a gap of their own length
    assert "1001 of 200000 samples of laser are missing" in found.text()
    assert np.median(np.abs(found.h)) == pytest.approx(2.0, rel=1e-2)
    y[:] = np.where(np.arange(y.size) % 300 < 10, np.nan, y)
    with pytest.raises(UsageError, match="every window of 1 s has gaps"):
        response(run_of(force=x, laser=y), "force", "laser", window=1.0)


def test_lines_without_excitation_have_no_response():
    t = np.arange(20 * RATE) / RATE
    x = sum(np.sin(2.0 * math.pi * f * t) for f in (20.0, 50.0))
    found = response(run_of(force=x, laser=3.0 * x), "force", "laser", window=1.0)
    known = np.isfinite(found.h)
    assert {20.0, 50.0} <= set(found.f[known]) <= {*range(18, 23), *range(48, 53)}
    assert found.h[known] == pytest.approx(3.0, rel=1e-6)
    assert "in which the input has no power" in found.text()
    told = found.to_json()
    assert told["excited"] == {
        "lowest": found.f[known].min(),
        "highest": found.f[known].max(),
        "lines_without": np.isnan(found.h).sum(),
    }
    assert (told["coherence_median"], told["error_median"]) == (
        np.nanmedian(found.coherence),
        np.nanmedian(found.error),
    )


def test_what_cannot_be_is_told():
    run = run_of(force=white(1, 5000), laser=white(2, 5000), still=np.full(5000, 2.0))
    with pytest.raises(UsageError, match="input and output are both laser: its response to itself is 1"):
        response(run, "laser", "meas/laser")
    with pytest.raises(UsageError, match=r"input: still is constant \(2 \); a response needs an input that moves"):
        response(run, "still", "laser")
    with pytest.raises(UsageError, match=r"window 9 s: must be 0.032 s \(32 samples at 1000 Hz\) to 5 s \(the time"):
        response(run, "force", "laser", window=9.0)
    empty = run_of(force=np.where(np.arange(5000) < 2000, white(1, 5000), np.nan), laser=(white(2, 3000), RATE, 2.5))
    with pytest.raises(UsageError, match="input: force has no sample in the time span that input and output share"):
        response(empty, "force", "laser")
    apart = run_of(force=white(1, 5000), laser=(white(2, 5000), RATE, 8.0))
    with pytest.raises(UsageError, match="the time that they share is too short"):
        response(apart, "force", "laser")


@pytest.fixture(scope="module")
def shaken():
    """A mass that slides on a belt, with Coulomb friction, too weakly shaken to stick: linear."""
    changes = {"noise.force": 0.1, "body.damping": 20.0, "start.displacement": 0.002, "start.velocity": 0.0}
    scene = laboratory.load("belt_c", changes)
    run = laboratory.simulate(scene, 400.0)
    assert run.signals["slip_speed"].min() > 0.0
    return scene, run


def test_a_sliding_rig_has_the_response_of_its_matrices(shaken):
    scene, run = shaken
    system = scene.assemble().system()
    mass = np.linalg.inv(system.mass)
    none, one = np.zeros((1, 1)), np.eye(1)
    plant = control.ss(
        np.block([[none, one], [-mass @ system.stiffness, -mass @ system.damping]]),
        np.vstack([none, mass @ system.strike[:, None]]),
        [[1.0, 0.0]],
        [[0.0]],
    )
    found = response(run, "noise_force", "displacement")
    exact = held(plant, found.f)[0] * np.exp(2j * math.pi * found.f / RATE)  # a row has the force of the step before it
    off = np.abs(found.h - exact) / np.abs(exact)
    assert np.sqrt(np.mean((off / found.error) ** 2) / 2.0) < 1.1  # real and imaginary part: random error, no more
    assert np.median(off) < 1e-3
    assert found.coherence[found.f < 450.0].min() > 0.99
    [one] = found.resonances
    [mode] = laboratory.modes(scene).sliding.modes
    assert one.frequency == pytest.approx(mode.frequency, rel=2e-3)
    assert one.damping == pytest.approx(mode.damping, rel=0.03)


def test_a_command_is_a_channel_held_from_frame_to_frame():
    """F_N = F_0 - K v: from the vibrometer to the command of normal-force feedback the response is -K."""
    run = laboratory.simulate("belt_normal_force", 8.0)
    found = response(run, "vibrometer", "load.force", first=4.1, last=8.0, window=1.0)
    assert found.unit == "N/(m/s)"
    strong = (found.f > 2.0) & (found.f < 20.0)
    assert found.h[strong] == pytest.approx(-200.0, rel=1e-6)
    commands = run.commands["nf"]
    channel = series(run, "load.force")
    assert np.array_equal(channel.v[commands.tick[5:]], commands.values[5:, 0])


def test_the_command(tmp_path, rig):
    x = blows(3)
    log, table = tmp_path / "run.mcap", tmp_path / "response.csv"
    save(run_of(force=x, laser=held(OSCILLATOR, np.zeros(1))[1](x)), log)
    picture = tmp_path / "response.pdf"
    asked = (
        "analyse",
        "response",
        log,
        "--input",
        "force",
        "--output",
        "laser",
        "--figure",
        picture,
        "--csv",
        table,
        "--json",
    )
    code, out, _ = rig(*asked)
    told = json.loads(out)
    assert (code, told["taper"]) == (0, "none")
    assert picture.read_bytes().startswith(b"%PDF")
    assert told["resonances"][0]["frequency"] == pytest.approx(HERTZ, rel=1e-3)
    with table.open() as file:
        rows = list(csv.DictReader(file))
    top = max(rows, key=lambda row: float(row["magnitude [m/N]"]))
    assert float(top["frequency [Hz]"]) == pytest.approx(HERTZ, abs=told["step"])
    assert float(top["phase [degree]"]) == pytest.approx(-90.0 - 360.0 * HERTZ * 0.5 / RATE, abs=20.0)
    code, out, err = rig("analyse", "response", log, "--input", "x", "--output", "y", "--window", "1 kg")
    assert (code, out, len(err.splitlines())) == (2, "", 3)
    code, _, err = rig("analyse", "response", log)
    assert (code, "--input" in err) == (2, True)
