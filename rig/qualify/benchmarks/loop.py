"""Benchmark of the loop over the bus, beside bare round trips measured alternately.

Plant at 1 kHz with the vibrometer at 10 kHz in blocks, one controller, recorder, viewer bridge. A paced run gives
losses, the age of commands when they take effect, and the time from the plant's put to the command in its queue. A
lockstep run gives the time of a tick. Both are compared with a bare round trip over the bus to a process that only
answers. A bare round trip through a unix socket shows the share of the operating system.
"""

from __future__ import annotations

import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from rig.errors import BusError

_ECHO = """
import socket, sys
with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as s:
    s.connect(sys.argv[1])
    while data := s.recv(64):
        s.send(data)
"""
OVERRIDES = {"sensors.vibrometer.rate": "10000 Hz"}


ROUNDS = 5


def paced(seconds: float = 60.0) -> dict[str, Any]:
    """Return the summary of a paced run, with bare round trips through a unix socket a hundred times a second."""
    bare = Bare()
    bare.begin()
    try:
        summary = _run(seconds, web=True)
    finally:
        trips = bare.end()
    summary["bare_us"] = {f"p{q}": float(np.percentile(trips, q)) * 1e6 for q in (50, 99)} if len(trips) else {}
    return summary


def beside_bare(
    rounds: int = ROUNDS, lockstep_s: float = 3.0, paced_s: float = 6.0, bare_s: float = 1.0
) -> dict[str, Any]:
    """Measure short runs in lockstep and paced, alternating with bare round trips over the bus; times in us.

    In each round, a tick in lockstep and the paced run's median from put to command are divided by the mean of the bare
    medians before and after; the ratios `over_bare` are the medians over the rounds. `bare` is the round trip of
    `rig doctor`, with a pause before each. `back_to_back` is one directly after the other, which finds warm caches: a
    tick in lockstep is also compared with it. `publish`: mean publishing time of a frame in the paced runs. Raises
    BusError if bare round trips cannot be measured.
    """
    rows: dict[str, list[float]] = {"lockstep": [], "paced": [], "publish": []}
    bare, back_to_back = [_bare(bare_s)], [_bare(bare_s, paced=False)]
    for _ in range(rounds):
        summary = _run(lockstep_s, pace=None)
        rows["lockstep"].append(1e6 * summary["wall_seconds"] / summary["ticks"])
        back_to_back.append(_bare(bare_s, paced=False))
        summary = _run(paced_s, web=True)
        rows["paced"].append(summary["round_trip"]["p50"])
        rows["publish"].append(summary["timing"]["spans"]["publish"]["mean"])
        bare.append(_bare(bare_s))
    ratios = {
        "lockstep": over_bare(rows["lockstep"], bare),
        "lockstep_back_to_back": over_bare(rows["lockstep"], back_to_back),
        "paced": over_bare(rows["paced"], bare),
    }
    times = rows | {"bare": bare, "back_to_back": back_to_back}
    return {
        "rows": times,
        **{name: statistics.median(values) for name, values in times.items()},
        "over_bare": {name: statistics.median(values) for name, values in ratios.items()},
    }


def over_bare(rows: list[float], around: list[float]) -> list[float]:
    """Each of `rows` over the mean of the two of `around` that were measured before and after it."""
    return [2.0 * row / (before + after) for row, before, after in zip(rows, around, around[1:])]


def plate() -> dict[str, Any]:
    """Return the summary of a paced run of the plate under a slider, over its whole protocol, with recorder and
    viewer.
    """
    return _carried("plate", {}, None, web=True)


def _run(seconds: float, **how: Any) -> dict[str, Any]:
    return _carried("belt_normal_force", {**OVERRIDES, "sensors.vibrometer.ideal": False}, seconds, **how)


def _carried(name: str, changes: dict[str, Any], seconds: float | None, **how: Any) -> dict[str, Any]:
    from rig.bench.live.supervise import run
    from rig.scenes import load

    scene = load(name, changes)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "bench.mcap"
        outcome = run(scene, duration=seconds, out=out, say=lambda _: None, **how)
    return dict(outcome.to_json())


def _bare(seconds: float, *, paced: bool = True) -> float:
    """Median of bare round trips over the bus [us]."""
    from rig.qualify.doctor import round_trips

    trips, _, fault = round_trips(seconds, paced=paced)
    if fault:
        raise BusError(fault)
    return float(np.median(trips)) / 1e3


class Bare:
    """Round trips of 64 bytes to another process through a unix socket, every 10 ms."""

    def begin(self) -> None:
        """Start the other process and the round trips."""
        self._folder = tempfile.TemporaryDirectory()
        path = f"{self._folder.name}/bare"
        self._server = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._server.bind(path)
        self._server.listen(1)
        self._server.settimeout(10.0)
        self._child = subprocess.Popen([sys.executable, "-c", _ECHO, path])
        self._peer, _ = self._server.accept()
        self._peer.settimeout(5.0)
        self._stop = threading.Event()
        self.trips: list[float] = []
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        payload = bytes(64)
        while not self._stop.wait(0.01):
            begin = time.perf_counter()
            self._peer.send(payload)
            self._peer.recv(64)
            self.trips.append(time.perf_counter() - begin)

    def end(self) -> list[float]:
        """End both; return the round trips [s]."""
        self._stop.set()
        self._thread.join(10.0)
        self._peer.close()
        self._child.wait(10.0)
        self._server.close()
        self._folder.cleanup()
        return self.trips
