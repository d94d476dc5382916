"""What a frame of instruments costs on this machine."""

from __future__ import annotations

import timeit

import numpy as np
import pytest

from rig.sensors import KINDS
from rig.sensors.chain.bank import Bank
from rig.solve.segment_output import Segments

COLUMNS = ["velocity", "displacement", "acceleration", "normal_force"]
FOUR = ("laser_vibrometer", "displacement_laser", "accelerometer", "normal_force")


@pytest.mark.bench
@pytest.mark.parametrize(
    ("sensors", "parts", "limit_us"),
    [
        ({kind: KINDS[kind]() for kind in FOUR}, 1, 3.0),
        ({"v": KINDS["laser_vibrometer"](rate=10e3)}, 10, 6.0),
    ],
    ids=["four at 1 kHz", "vibrometer at 10 kHz"],
)
def test_a_frame_of_instruments_costs_little(sensors, parts, limit_us, capsys):
    bank = Bank(sensors, COLUMNS, 1_000_000, 1)
    bank.start(np.ones(4))
    coef = np.random.default_rng(1).standard_normal((parts, 4, 9))
    edges = np.linspace(0.0, 1e-3, parts + 1)
    frame = Segments(np.array([parts]), edges[:-1].copy(), np.diff(edges), coef)
    cost = 1e6 * min(timeit.repeat(lambda: bank.advance(frame), number=20_000, repeat=7)) / 20_000
    with capsys.disabled():
        print(f"\n{len(sensors)} instruments, {parts} segments: {cost:.2f} us per frame")  # noqa: T201
    assert cost < limit_us
