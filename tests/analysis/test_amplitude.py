"""Amplitudes of stages: noise is told from a vibration."""

import json
import math
from pathlib import Path

import pytest

import rig
from rig.analysis.recorded import amplitudes

PENDULUM = Path(__file__).parents[2] / "recordings" / "golden" / "pendulum.mcap"


def test_an_amplitude_at_noise_level_has_no_frequency():
    """Before the disc turns, the vibrometer reads its noise of 2.2e-5 m/s, which crosses zero 106 times a second."""
    run = rig.open(PENDULUM)
    found = amplitudes(run)
    rows = {(row.stage, row.sensor): row for row in found.rows}
    still, moving = rows["before", "vibrometer"], rows["accelerate", "vibrometer"]
    assert 1e-5 < still.found.half < 1e-4
    assert (still.why, still.found.cycles, math.isnan(still.found.frequency)) == ("at noise level", 0, True)
    assert moving.why == ""
    assert moving.found.frequency == pytest.approx(3.07, abs=0.01)
    assert "at noise level" in found.text()
    assert "105" not in found.text()
    labels = [text.get_text() for axes in found.plot().axes for text in axes.texts]
    assert "at noise\nlevel" in labels
    told = found.to_json()["rows"][0]["found"]
    assert (told["why"], json.loads(json.dumps(told["cycles"]))) == ("at noise level", 0)


def test_the_noise_of_an_unknown_instrument_is_not_judged(tmp_path):
    (tmp_path / "a.csv").write_text("t [s],v\n" + "".join(f"{0.01 * i},{(-1) ** (i // 5)}\n" for i in range(200)))
    rig.import_(tmp_path / "a.csv", tmp_path / "a.mcap", {"v": "v, 1e-9 m/s"}, time="t, s")
    [row] = amplitudes(rig.open(tmp_path / "a.mcap")).rows
    assert (row.noise, row.why, row.found.frequency) == (0.0, "", pytest.approx(10.0))
