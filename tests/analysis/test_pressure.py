"""Maps of the contact pressure: which instants, what is told of them, what is refused."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

import rig as laboratory
from rig.analysis.recorded import pressure, spectrum
from rig.errors import UsageError
from rig.record.run import Run
from rig.record.save_run import save

TIME = np.arange(100) * 0.005
ALONG, ACROSS = 4, 2


@pytest.fixture(scope="module")
def run():
    """A film of 4 x 2 points: closed up to 0.3 s; then the rear half is open, at 0.4 s all of it."""
    scene = laboratory.load("plate", {"film.along": str(ALONG), "film.across": str(ACROSS)})
    names = [f"pressure_{i}_{j}" for i in range(1, ALONG + 1) for j in range(1, ACROSS + 1)]
    front = np.repeat(np.arange(ALONG) >= 2, ACROSS)
    table = np.where((TIME < 0.3)[:, None] | front, 1e5 + 1e3 * np.arange(ALONG * ACROSS), 0.0)
    table[TIME == 0.4] = 0.0
    x = np.repeat((np.arange(ALONG) + 0.5) / ALONG - 0.5, ACROSS) * 0.043
    total = table.sum(axis=1)
    signals = dict(zip(names, table.T))
    signals |= {"contact_fraction": (table > 0.0).mean(axis=1), "normal_force": total * 0.043 * 0.0253 / 8}
    signals |= {"pressure_centre_x": np.divide(table @ x, total, out=0.0 * total, where=total > 0.0)}
    opens = (table[1:] == 0.0) & (table[:-1] > 0.0)
    signals |= {"pressure_centre_y": 0.0 * TIME, "openings": np.append(0.0, np.cumsum(opens.sum(axis=1)))}
    units = {name: "Pa" if name in names else "1" for name in signals}
    return Run(scene.to_json(), 5_000_000, 1_000_000, TIME, signals, units, mode=np.zeros(100, np.int64))


def test_the_sample_nearest_to_each_time_is_taken(run):
    found = pressure(run, [0.1012, 0.4])
    closed, opened = found.maps
    assert (closed.time, opened.time) == (pytest.approx(0.1), pytest.approx(0.4))
    assert closed.pressures == pytest.approx((1e5 + 1e3 * np.arange(8)).reshape(ALONG, ACROSS))
    assert (closed.fraction, opened.fraction, opened.force, opened.largest) == (1.0, 0.0, 0.0, 0.0)
    assert closed.force == pytest.approx(closed.pressures.sum() * 0.043 * 0.0253 / 8)
    last = found.text().splitlines()[-1]
    assert last.split()[:3] == ["film", "0.40000", "0"]
    assert last.split().count("-") == 4  # nothing presses: no centre, no place


def test_without_times_the_telling_instants_are_taken(run):
    found = {one.why: one for one in pressure(run).maps}
    assert found["first opening"].time == pytest.approx(0.3)
    assert found["fewest in contact"].time == pytest.approx(0.4)
    assert found["before the first opening"].fraction == 1.0
    assert found["most at the front edge"].centre[0] == pytest.approx(0.0108, abs=2e-4)


@pytest.mark.parametrize(
    ("at", "says"),
    [
        ([0.1, 3.0, -1.0], "--at 3 s, -1 s: the recording has 0 to 0.495 s"),
        ([0.1] * 21, "--at names 21 times: at most 20 maps"),
        ([0.05], "lost the pressures at 0.05 s"),
    ],
)
def test_times_that_the_recording_has_not_are_refused(run, at, says):
    signals = {**run.signals, "pressure_2_1": np.where(TIME == 0.05, np.nan, run.signals["pressure_2_1"])}
    with pytest.raises(UsageError, match=says):
        pressure(replace(run, signals=signals), at)


def test_a_run_without_a_film_is_refused(run):
    for other in (replace(run, scene=laboratory.load("belt").to_json()), replace(run, scene="{}", signals={})):
        with pytest.raises(UsageError, match="no contact points with places"):
            pressure(other)


def test_the_command(tmp_path, rig, run):
    log, png, table = tmp_path / "run.mcap", tmp_path / "maps.png", tmp_path / "maps.csv"
    save(run, log)
    code, out, _ = rig(
        "analyse", "pressure", log, "--at", "0.1, 350 ms,0.4 s", "--figure", png, "--csv", table, "--json"
    )
    told = json.loads(out)
    assert code == 0
    assert [one["time"] for one in told["maps"]] == pytest.approx([0.1, 0.35, 0.4])
    assert np.shape(told["maps"][1]["pressures"]) == (ALONG, ACROSS)
    assert png.read_bytes().startswith(b"\x89PNG")
    with table.open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3 * ALONG * ACROSS
    assert [float(v) for v in list(rows[0].values())[:4]] == pytest.approx([0.1, -0.016125, -0.006325, 1e5])
    code, _, err = rig("analyse", "pressure", log, "--at", "0.1,soon")
    assert (code, "--at" in err) == (2, True)


def test_a_spectrum_says_what_is_folded_down(run):
    """The plate rings up to 50 kHz, and the outputs of this run are 200 a second: there is no filter before them."""
    fast = replace(run, step_ns=5_000_000, signals={**run.signals, "slider_acceleration": np.sin(300.0 * TIME)})
    found = spectrum(fast, "slider_acceleration", window=0.2)
    assert "vibration above 100 Hz is aliased" in found.gaps
    other = replace(fast, scene=laboratory.load("belt").to_json())
    assert not spectrum(other, "slider_acceleration", window=0.2).gaps
