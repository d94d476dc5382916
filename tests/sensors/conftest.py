"""A signal source for instruments: functions of time, fed as segments of polynomials, and what was measured."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest

from rig.sensors.chain.bank import Bank
from rig.solve.segment_output import DEGREE, Segments

NODES = 0.5 - 0.5 * np.cos((np.arange(DEGREE + 1) + 0.5) * np.pi / (DEGREE + 1))
_CHEBYSHEV = np.polynomial.chebyshev.chebvander(2.0 * NODES - 1.0, DEGREE)
_ANALYSIS = _CHEBYSHEV.T * np.where(np.arange(DEGREE + 1) == 0, 1.0, 2.0)[:, None] / (DEGREE + 1)
_SHIFTED = np.zeros((DEGREE + 1, DEGREE + 1))  # row n: T_n(2u - 1) in powers of u, whole numbers
for n in range(DEGREE + 1):
    powers = np.polynomial.chebyshev.Chebyshev.basis(n).convert(kind=np.polynomial.Polynomial)
    _SHIFTED[n, : n + 1] = np.rint(powers(np.polynomial.Polynomial([-1.0, 2.0])).coef)

# Every flaw off but filter and delay, for each kind.
CLEAN = {
    "laser_vibrometer": {"noise": 0.0, "resolution": 0.0, "dropout_rate": 0.0, "span": 1e4, "slew": 1e6},
    "displacement_laser": {"noise": 0.0, "resolution": 0.0, "span": 1e4},
    "strain_gauge": {"noise": 0.0, "resolution": 0.0, "span": 1e4, "zero_drift": 0.0},
    "accelerometer": {"noise": 0.0, "resolution": 0.0, "span": 1e4, "temperature_sensitivity": 0.0},
    "normal_force": {"noise": 0.0, "resolution": 0.0, "span": 1e4, "drift": 0.0},
    "disc_speed": {"noise": 0.0, "resolution": 0.0, "span": 1e4},
    "microphone": {"noise": 0.0, "resolution": 0.0, "span": 1e4, "background": 0.0, "highpass": 0.1},
    "voltmeter": {"noise": 0.0, "resolution": 0.0, "span": 1e4},
}


def segments(signals, start, length, frame_start):
    """Interpolates each signal at the Chebyshev nodes of each segment (times relative to `frame_start`).

    By way of Chebyshev coefficients: a Vandermonde inverse would cost five digits.
    """
    t = frame_start + start[:, None] + length[:, None] * NODES
    coef = np.stack([f(t) @ _ANALYSIS.T @ _SHIFTED for f in signals], axis=1)
    return Segments(np.array([len(start)]), start, length, np.ascontiguousarray(coef))


@dataclass
class Measured:
    t: dict[str, np.ndarray] = field(default_factory=dict)
    y: dict[str, np.ndarray] = field(default_factory=dict)
    counters: dict[str, dict[str, int]] = field(default_factory=dict)

    def only(self) -> tuple[np.ndarray, np.ndarray]:
        ((name, t),) = self.t.items()
        return t, self.y[name]


def play(
    sensors: Mapping,
    signals: Mapping[str, Callable],
    duration: float,
    frame_ns: int = 1_000_000,
    parts: int = 1,
    seed: int = 1,
    cuts: Callable[[int], np.ndarray] | None = None,
    bank: Bank | None = None,
) -> Measured:
    """Feeds the signals for `duration` [s]; each frame is `parts` equal segments, or cut at `cuts(frame)` [s]."""
    bank = bank or Bank(sensors, list(signals), frame_ns, seed)
    bank.start(np.array([float(f(np.zeros(1))[0]) for f in signals.values()]))
    frame = 1e-9 * frame_ns
    t = [[0] for _ in bank.latest]
    y = [[x] for x in bank.latest]
    even = np.linspace(0.0, frame, parts + 1)
    for k in range(round(duration / frame)):
        edges = even if cuts is None else np.concatenate([[0.0], np.sort(cuts(k)), [frame]])
        bank.advance(segments(signals.values(), edges[:-1], np.diff(edges), frame * k))
        for i in range(len(sensors)):
            if bank.fresh[i]:
                first = bank.first(i)
                t[i].extend(bank.instants[i].at(np.arange(first, first + bank.fresh[i])).tolist())
                y[i].extend(bank.samples(i))
                assert bank.latest[i] == y[i][-1]
    return Measured(
        {name: 1e-9 * np.array(t[i]) for i, name in enumerate(bank.names)},
        {name: np.array(y[i]) for i, name in enumerate(bank.names)},
        bank.counters(),
    )


@pytest.fixture(name="play", scope="session")
def _play():
    return play


@pytest.fixture(scope="session")
def clean():
    return CLEAN
