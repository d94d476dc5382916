"""Spectra and orders of signals whose lines are known in closed form."""

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest

import rig as lab
from rig.analysis.recorded import orders, spectrum
from rig.errors import UsageError
from rig.record.run import Run, Samples
from rig.record.save_run import save

RATE = 1000
T = np.arange(20 * RATE) / RATE
RISING = np.interp(T, [0.0, 1.0, 19.0, 20.0], [0.0, 0.0, 30.0, 30.0])
"""Speed of a disc [rad/s]."""
TURN = np.concatenate(([0.0], np.cumsum(0.5 * (RISING[1:] + RISING[:-1]) / RATE)))


def run_of(v, speed=RISING, unit="rad/s", kept=slice(None)):
    """A recording of an accelerometer and of the speed of a disc, or of whatever `unit` says."""
    t_ns = np.arange(v.size, dtype=np.int64) * 1_000_000
    return Run(
        scene=lab.load("pendulum").to_json(),
        step_ns=1_000_000,
        frame_ns=1_000_000,
        time=T,
        signals={"disc_speed": speed},
        units={"disc_speed": unit, "meas/accelerometer": "m/s^2"},
        measurements={"accelerometer": Samples(t_ns[kept], v[kept])},
    )


def sine(hertz, size=3.0):
    return size * np.sin(2.0 * math.pi * hertz * T)


@pytest.mark.parametrize("hertz", [50.13, 333.33])
def test_a_sine_has_its_frequency_and_its_rms(hertz):
    found = spectrum(run_of(7.0 + sine(hertz)))
    [line] = found.lines
    assert line.at == pytest.approx(hertz, abs=2e-3)  # lines are 0.4 Hz apart
    assert line.rms == pytest.approx(3.0 / math.sqrt(2.0), rel=2e-3)
    assert found.density.rms == pytest.approx(3.0 / math.sqrt(2.0), rel=2e-3)  # Parseval
    assert found.density.step == pytest.approx(0.4)
    assert found.density.windows == 15


def test_white_noise_has_its_density():
    """2 sigma^2 / rate; Parseval to the scatter of the windows' weights."""
    v = 0.5 * np.random.default_rng(2).standard_normal(T.size)
    found = spectrum(run_of(v), window=0.5)
    assert found.density.s[2:-2].mean() == pytest.approx(2.0 * 0.5**2 / RATE, rel=0.02)
    assert found.density.rms == pytest.approx(v.std(), rel=0.01)
    assert found.lines == ()
    assert "no line is 10 dB above its surroundings" in found.text()


def test_two_sines_share_the_mean_square():
    found = spectrum(run_of(sine(50.0, 3.0) + sine(120.0, 1.0)))
    assert [round(line.at) for line in found.lines] == [50, 120]
    assert [line.rms for line in found.lines] == pytest.approx([3.0 / math.sqrt(2.0), 1.0 / math.sqrt(2.0)], rel=2e-3)
    assert [f"{row['of the mean square']:.2g}" for row in found.to_json()["lines"]] == ["0.9", "0.1"]


def test_a_chirp_goes_through_the_spectrogram():
    """20 Hz + 15 Hz/s: in every window its line is where the middle of the window says, and holds its mean square."""
    found = spectrum(run_of(3.0 * np.sin(2.0 * math.pi * (20.0 * T + 7.5 * T**2))), window=0.25)
    ridge = found.map.f[found.map.s.argmax(axis=0)]
    assert ridge == pytest.approx(20.0 + 15.0 * found.map.t, abs=4.0)  # lines are 4 Hz apart
    assert found.map.s.sum(axis=0) * 4.0 == pytest.approx(4.5, rel=0.05)
    assert found.map.t[0] == pytest.approx(0.125, abs=2e-3)
    assert found.map.t[-1] > 19.8


def test_short_gaps_are_bridged_and_long_ones_left_out():
    rng = np.random.default_rng(4)
    v = sine(20.0)
    v[rng.random(T.size) < 0.01] = np.nan
    kept = (T < 8.0) | (T > 9.0)
    found = spectrum(run_of(v, kept=kept), window=0.5)
    lost = np.count_nonzero(~(kept & np.isfinite(v)))
    assert f"{lost} of {T.size} samples of accelerometer are missing" in found.text()
    assert found.bridged == np.count_nonzero(np.isnan(v) & kept)
    assert 3 <= found.density.left_out <= 7
    assert found.density.rms == pytest.approx(3.0 / math.sqrt(2.0), rel=5e-3)
    empty = np.isnan(found.map.s).all(axis=0)
    assert np.all((found.map.t[empty] > 7.7) & (found.map.t[empty] < 9.3))
    assert empty.sum() > 5
    with pytest.raises(UsageError, match=r"every window of 15 s has gaps; .*the longest takes 1 s"):
        spectrum(run_of(v, kept=kept), window=15.0)


def test_an_order_stays_where_it_is_while_the_speed_rises():
    """Order 7 with 2, order 1 with 0.5: narrow over the turn, spread over frequency."""
    v = 2.0 * np.sin(7.0 * TURN) + 0.5 * np.sin(TURN)
    found = orders(run_of(v))
    assert (found.per, found.over) == ("rev", "disc_speed")
    assert [line.at for line in found.lines[:2]] == pytest.approx([7.0, 1.0], abs=0.01)
    assert [line.rms for line in found.lines[:2]] == pytest.approx(
        [2.0 / math.sqrt(2.0), 0.5 / math.sqrt(2.0)], rel=0.02
    )
    assert found.density.rms == pytest.approx(math.sqrt(2.0 + 0.125), rel=0.01)
    assert [found.slowest, found.fastest] == pytest.approx([0.1 * 30 / 2 / math.pi, 30 / 2 / math.pi], rel=0.05)
    assert found.highest == pytest.approx(0.4 * RATE / found.fastest, rel=1e-6)
    strongest = found.map.f[found.map.s.argmax(axis=0)]
    assert strongest == pytest.approx(7.0, abs=0.3)
    assert np.all(np.diff(found.map.t) > 0.0)
    assert max(line.rms for line in spectrum(run_of(v)).lines) < 1.0


def test_nothing_is_folded_into_the_orders():
    """A tone of constant 450 Hz lies above the highest order at every speed: what is left of it is below 1 %."""
    found = orders(run_of(sine(450.0) + 2.0 * np.sin(7.0 * TURN)))
    assert 450.0 / found.fastest > found.highest
    assert found.lines[0].at == pytest.approx(7.0, abs=0.01)
    others = (found.density.f < 6.0) | (found.density.f > 8.0)
    assert math.sqrt(found.density.s[others].sum() * found.density.step) < 0.01 * 3.0 / math.sqrt(2.0)


@pytest.mark.parametrize(
    ("speed", "unit", "per", "factor"),
    [
        (0.02 * RISING, "m/s", "m", 0.02),
        (-RISING, "rad/s", "rev", 1.0 / (2.0 * math.pi)),
        (TURN, "rad", "rev", 1.0 / (2.0 * math.pi)),
    ],
    ids=["way by speed", "backwards", "angle"],
)
def test_orders_are_counted_in_revolutions_or_metres(speed, unit, per, factor):
    found = orders(run_of(np.sin(7.0 * TURN), speed, unit))
    assert found.per == per
    assert found.lines[0].at == pytest.approx(7.0 / (2.0 * math.pi * factor), rel=2e-3)
    assert found.lines[0].rms == pytest.approx(1.0 / math.sqrt(2.0), rel=0.02)


def test_what_cannot_be_is_told():
    v = sine(50.0)
    with pytest.raises(UsageError, match=r"window 1e-06 s: must be 0.032 s \(32 samples of .* at 1000 Hz\) to 20 s"):
        spectrum(run_of(v), window=1e-6)
    with pytest.raises(UsageError, match=r"disc_speed reads N; an angle or a speed is needed: rad, rad/s, m, m/s"):
        orders(run_of(v, unit="N"))
    with pytest.raises(UsageError, match=r"orders: the longest stretch.*has 0 samples; at least 112"):
        orders(run_of(v, 0.0 * T))


def test_the_command(tmp_path, rig):
    log, png, table = tmp_path / "run.mcap", tmp_path / "orders.png", tmp_path / "lines.csv"
    save(run_of(2.0 * np.sin(7.0 * TURN)), log)
    code, out, _ = rig("analyse", "spectrum", log, "--orders", "drive", "--figure", png, "--csv", table, "--json")
    told = json.loads(out)
    assert code == 0
    assert told["orders"]["lines"][0]["at"] == pytest.approx(7.0, abs=0.01)
    assert told["rms"] == pytest.approx(math.sqrt(2.0 * 0.95), rel=0.02)  # it stands still for a second
    assert png.read_bytes().startswith(b"\x89PNG")
    with table.open() as file:
        rows = list(csv.DictReader(file))
    assert {(row["axis"], row["unit"], row["unit of density"]) for row in rows} == {
        ("frequency", "Hz", "(m/s^2)^2/Hz"),
        ("order", "1/rev", "(m/s^2)^2*rev"),
    }
    square = sum(float(row["density"]) for row in rows if row["axis"] == "frequency") * told["step"]
    assert math.sqrt(square) == pytest.approx(told["rms"], rel=1e-6)
    code, out, _ = rig("analyse", "spectrum", log)
    assert "RMS about the mean, over these windows: 1.39" in out
    assert "orders" not in out
    code, out, err = rig("analyse", "spectrum", log, "--window", "1 kg", "--orders", "y", "--signal", "x")
    assert (code, out, len(err.splitlines())) == (2, "", 3)


def test_the_figure_labels_every_line_above_a_share_of_the_power_and_states_its_resolution():
    found = spectrum(lab.open(Path(__file__).parents[2] / "recordings" / "golden" / "plate_free.mcap"), "accelerometer")
    strong = [line for line in found.lines if line.rms**2 >= 0.01 * found.density.rms**2]
    assert 3 < len(strong) < len(found.lines)
    axes = found.plot().axes[0]
    assert sorted(int(text.get_text().split()[0]) for text in axes.texts) == sorted(round(line.at) for line in strong)
    assert f"resolution {found.density.step:.3g} Hz" in axes.get_title(loc="left")
