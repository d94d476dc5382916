"""The paced loop over the bus, for a minute, beside a bare round trip through a unix socket in the same run.

Plant at 1 kHz with the vibrometer at 10 kHz in blocks, one controller, recorder, viewer bridge: what is lost, how old
commands are when they take effect, and how long they take from the plant's put to its queue.
"""

from __future__ import annotations

import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

_ECHO = """
import socket, sys
with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as s:
    s.connect(sys.argv[1])
    while data := s.recv(64):
        s.send(data)
"""
OVERRIDES = {"sensors.vibrometer.rate": "10000 Hz"}


def paced(seconds: float = 60.0, view: bool = True) -> dict[str, Any]:
    """A paced run of the pendulum and, a hundred times a second beside it, a bare round trip."""
    from rig.bench.supervise import run
    from rig.scenes import load
    from rig.study.design import numbers

    scene = load("belt_normal_force", {**OVERRIDES, "sensors.vibrometer.ideal": False})
    bare = Bare()
    with tempfile.TemporaryDirectory() as folder:
        bare.begin()
        try:
            out = Path(folder) / "bench.mcap"
            outcome = run(scene, numbers=numbers(scene), duration=seconds, out=out, web=view, say=lambda _: None)
        finally:
            trips = bare.end()
    summary = dict(outcome.to_json())
    summary["bare_us"] = {f"p{q}": float(np.percentile(trips, q)) * 1e6 for q in (50, 99)} if len(trips) else {}
    return summary


class Bare:
    """64 bytes to another process and back through a unix socket, every 10 ms."""

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
        """End both; the round trips [s]."""
        self._stop.set()
        self._thread.join(10.0)
        self._peer.close()
        self._child.wait(10.0)
        self._server.close()
        self._folder.cleanup()
        return self.trips
