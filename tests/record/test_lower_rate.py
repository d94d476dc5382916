"""Decimation: what the filter promises, at any factor; instants, ends and gaps."""

import dataclasses
import re

import numpy as np
import pytest
from scipy import signal

from rig.errors import UsageError
from rig.record.export import tables
from rig.record.export.lower_rate import ATTENUATION, PASSED, STOPPED, decimated, low_pass
from rig.record.run import Run, Samples

ROWS = 33
"""Rows next to an end that rest on the continuation of the signal."""


@pytest.mark.parametrize("factor", [2, 50])
def test_the_filter_is_as_documented(factor):
    taps = low_pass(factor)
    assert taps.size == 2 * ROWS * factor + 1
    assert np.array_equal(taps, taps[::-1])
    f = np.concatenate([np.linspace(0.0, PASSED, 4001), np.linspace(STOPPED, factor / 2, 20_001)])
    _, response = signal.freqz(taps, worN=f, fs=factor)
    size = np.abs(response)
    assert np.abs(size[:4001] - 1.0).max() < 2e-5
    assert 20.0 * np.log10(size[4001:].max()) < -ATTENUATION


@pytest.mark.parametrize("factor", [7])
def test_tones_below_keep_amplitude_and_phase_and_tones_above_are_attenuated(factor):
    k = np.arange(400 * factor)
    inside = slice(ROWS, -ROWS)
    for of_new_rate in (0.0, 0.05, 0.2, 0.39):
        tone = np.cos(2.0 * np.pi * of_new_rate / factor * k + 0.7)
        found, _ = decimated(tone, factor)
        assert np.abs(found - tone[::factor])[inside].max() < 2e-5
    for of_new_rate in (0.5, 0.61, 0.95, 1.0):
        tone = np.cos(2.0 * np.pi * of_new_rate / factor * k + 0.7)
        found, _ = decimated(tone, factor)
        assert np.abs(found[inside]).max() < 10.0 ** (-ATTENUATION / 20.0)


def test_a_ramp_and_a_constant_are_kept_up_to_the_ends():
    for v in (np.full(1001, 3.0), np.linspace(-1.0, 4.0, 1001)):
        found, _ = decimated(v, 10)
        assert found.size == 101
        assert np.abs(found - v[::10]).max() < 1e-12


@pytest.mark.parametrize("begin", [1995])
def test_a_long_gap_stays_a_gap_and_spoils_nothing_beyond_its_neighbours(begin):
    factor = 10
    k = np.arange(5001)
    tone = np.sin(2.0 * np.pi * 0.3 / factor * k)
    v = tone.copy()
    v[begin : begin + 57] = np.nan
    found, bridged = decimated(v, factor)
    lost = np.isnan(found)
    assert bridged == 0
    assert np.array_equal(lost, np.isnan(v[::factor]))
    rows = np.flatnonzero(lost)
    far = (np.arange(found.size) < rows[0] - ROWS) | (np.arange(found.size) > rows[-1] + ROWS)
    far[:ROWS] = far[-ROWS:] = False
    assert np.abs(found - tone[::factor])[far].max() < 2e-5
    assert np.nanmax(np.abs(found - tone[::factor])) < 0.15


def test_a_short_gap_is_bridged_by_a_line():
    v = np.sin(2.0 * np.pi * 1e-3 * np.arange(3000))
    gap = v.copy()
    gap[1000:1004] = np.nan
    filled = gap.copy()
    filled[999:1005] = np.linspace(v[999], v[1004], 6)
    found, bridged = decimated(gap, 10)
    assert bridged == 4
    assert np.abs(found - decimated(filled, 10)[0]).max() < 1e-15


@pytest.fixture
def made():
    """A run of 2 s: outputs and one sensor at 1 kHz, one at 44.1 kHz, one at 25 Hz."""

    def at(rate):
        return np.rint(np.arange(2 * rate + 1) * 1e9 / rate).astype(np.int64)

    def tone(t_ns):
        return np.sin(2.0 * np.pi * 3.0 * t_ns * 1e-9)

    t_ns = at(1000)
    sensors = {"gauge": 1000, "microphone": 44_100, "slow": 25}
    return Run(
        scene="{}",
        step_ns=1_000_000,
        frame_ns=1_000_000,
        time=t_ns * 1e-9,
        signals={"x": tone(t_ns)},
        units={"x": "m", "meas/gauge": "N"},
        measurements={name: Samples(at(rate), tone(at(rate))) for name, rate in sensors.items()},
        mode=np.arange(2001) % 3,
    )


def test_rows_are_at_instants_that_were_recorded(made):
    found = tables(made, rate=100.0)
    assert [(one.name, one.t_ns.size) for one in found] == [
        ("outputs", 201),
        ("sensors_100_Hz", 201),
        ("sensors_25_Hz", 51),
        ("events", 0),
    ]
    outputs, sensors, slow, _ = found
    wanted = np.arange(201) * 10_000_000
    assert np.array_equal(outputs.t_ns, wanted)
    assert np.array_equal(sensors.t_ns, wanted)  # 44.1 kHz and 1 kHz have these instants in common
    assert [one.name for one in sensors.columns] == ["gauge", "microphone"]
    assert np.array_equal(outputs.columns[1].values, made.mode[::10])  # a number of a mode set has no mean
    tone = np.sin(2.0 * np.pi * 3.0 * wanted * 1e-9)
    for column in (outputs.columns[0], *sensors.columns):
        assert np.abs(column.values - tone)[ROWS:-ROWS].max() < 2e-5
    assert np.array_equal(slow.columns[0].values, made.measurements["slow"].v)
    assert [note.partition(":")[0] for note in found.notes] == ["x, gauge", "microphone", "slow"]
    assert "now at 100 Hz behind a low-pass filter: pass band to 40 Hz, 100 dB below from 50 Hz" in found.notes[0]
    assert found.notes[2] == "slow: recorded at 25 Hz, below --rate; exported as recorded"


def test_rates_that_are_impossible(made):
    with pytest.raises(UsageError, match="--rate 50000 Hz: the highest recorded rate is 44100 Hz; take a lower one"):
        tables(made, rate=50_000.0)
    with pytest.raises(UsageError) as fault:
        tables(made, rate=300.0)
    assert str(fault.value).splitlines() == [
        "--rate 300 Hz: x, gauge: recorded at 1000 Hz; a lower rate is this over a whole number: 250 Hz or 333.333 Hz",
        "take another rate, or choose outputs and sensors with --only",
    ]
    with pytest.raises(UsageError, match=r"gauge: recorded at 1000 Hz for 2\.001 s; at least 10 rows must remain"):
        tables(made, ["gauge"], rate=4.0)
    assert [one.t_ns.size for one in tables(made, ["gauge"], rate=5.0)] == [11]
    uneven = Samples(np.array([0, 1000, 2370, 3000, 4000], np.int64), np.arange(5.0))
    with pytest.raises(UsageError, match="gauge: its times are not evenly spaced; export it without --rate"):
        tables(dataclasses.replace(made, measurements={"gauge": uneven}), ["gauge"], 100.0)


def test_outputs_of_a_live_run_are_reported_as_aliased(made):
    (note,) = tables(dataclasses.replace(made, step_ns=100_000), ["x"]).notes
    assert re.match("outputs of the plant were recorded at 1000 Hz and not filtered: vibration above 500 Hz", note)
