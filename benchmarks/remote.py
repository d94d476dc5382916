"""Benchmark of a controller and a recorder on another host, over TLS, in turns with those on this host.

The other host is a namespace of the network behind a virtual cable, which only this machine can reach. Where none may
be made, it is an address of the loopback device.
"""

from __future__ import annotations

import itertools
import os
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rig.bench.live import supervise
from rig.bus.tickets import Listener
from rig.scenes.loader import load
from rig.view.viewer import free_port

SCENE = "belt_normal_force"
_NUMBER = itertools.count()
_WAIT_S = 60.0


class Cable:
    """Two addresses, `here` of this host and one of a namespace, joined by a pair of virtual interfaces.

    Raises OSError or subprocess.CalledProcessError where this is not permitted.
    """

    def __init__(self) -> None:
        number = next(_NUMBER)
        mark = f"{os.getpid()}x{number}"
        self.name = f"rig{mark}"
        near, self._far = f"ra{mark}", f"rb{mark}"
        network = f"10.231.{os.getpid() % 250}"
        first = 4 * (number % 60)
        self.here = f"{network}.{first + 1}"
        self._ip("netns", "add", self.name)
        self._ip("link", "add", near, "type", "veth", "peer", "name", self._far, "netns", self.name)
        self._ip("addr", "add", f"{self.here}/30", "dev", near)
        self._ip("link", "set", near, "up")
        self._ip("-n", self.name, "addr", "add", f"{network}.{first + 2}/30", "dev", self._far)
        self._ip("-n", self.name, "link", "set", "lo", "up")
        self.join()

    @staticmethod
    def _ip(*words: str) -> None:
        subprocess.run(["ip", *words], check=True, capture_output=True)

    @property
    def inside(self) -> list[str]:
        """Words before a command that is to run on the other host."""
        return ["ip", "netns", "exec", self.name]

    def cut(self) -> None:
        """Cut the cable: nothing arrives, and neither side is told."""
        self._ip("-n", self.name, "link", "set", self._far, "down")

    def join(self) -> None:
        """Join the ends of the cable."""
        self._ip("-n", self.name, "link", "set", self._far, "up")

    def remove(self) -> None:
        """Remove the namespace, and the interfaces with it."""
        self._ip("netns", "del", self.name)


@contextmanager
def _elsewhere() -> Iterator[tuple[str, list[str]]]:
    """The address of this host for another one, and words before a command that is to run there."""
    try:
        cable = Cable()
    except (OSError, subprocess.CalledProcessError):
        yield "127.0.0.1", []
        return
    try:
        yield cable.here, cable.inside
    finally:
        cable.remove()


def measured(seconds: float, rounds: int) -> dict[str, Any]:
    """Return the time from step to command of paced runs [ms], on this host (`here`) and on another one (`there`).

    `p99_ratio`: the median of the rounds of there over here. `verdict`: the worst timing verdict over TLS.
    """
    here: list[dict[str, Any]] = []
    there: list[dict[str, Any]] = []
    with _elsewhere() as (address, inside):
        for number in range(rounds):
            here.append(_run(seconds))
            there.append(_run(seconds, address, inside))
            for name, summaries in {"on this host": here, "by TLS": there}.items():
                trip = summaries[-1]["round_trip"]
                told = f"p50 {trip['p50'] / 1e3:.3f} ms, p99 {trip['p99'] / 1e3:.3f} ms, {summaries[-1]['verdict']}"
                sys.stderr.write(f"  round {number + 1} of {rounds}, {name}: {told}\n")
    times = {
        name: [summary["round_trip"]["p99"] / 1e3 for summary in summaries]
        for name, summaries in {"here": here, "there": there}.items()
    }
    worst = max(there, key=lambda summary: ("VALID", "DEGRADED", "INVALID").index(summary["verdict"]))
    ratios = [far / own for own, far in zip(times["here"], times["there"])]
    return {
        "p99_ms": times,
        "p99_ratio": statistics.median(ratios),
        "verdict": worst["verdict"],
        "namespace": bool(inside),
    }


def _run(seconds: float, address: str = "", inside: Sequence[str] = ()) -> dict[str, Any]:
    """The summary of a paced run, all on this host or, with an address, with controller and recorder elsewhere."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        out = folder / "here.mcap"
        if not address:
            return supervise.run(load(SCENE), duration=seconds, out=out, say=lambda _: None).to_json()
        started: list[subprocess.Popen[bytes]] = []
        interrupts: list[str] = []

        def begun(run: str) -> None:  # in the thread of the supervisor, which has to go on
            threading.Thread(target=join, args=(run,), daemon=True).start()

        def join(run: str) -> None:
            from rig.bus.tickets import tickets_of

            environment = {**os.environ, "XDG_RUNTIME_DIR": name}
            for seat, words in {"recorder": ["record", "--out", "far.mcap"], "nf": ["control", "nf"]}.items():
                command = [*inside, sys.executable, "-m", "rig", "live", *words, "--ticket"]
                process = subprocess.Popen(
                    [*command, str(tickets_of(run) / f"{seat}.ticket")],
                    cwd=folder,
                    env=environment,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                )
                started.append(process)
                deadline = time.monotonic() + _WAIT_S
                while seat == "recorder" and not (folder / "far.mcap").exists() and time.monotonic() < deadline:
                    time.sleep(0.05)
            while all(process.poll() is None for process in started):
                time.sleep(0.1)
            if any(process.wait() for process in started):  # else the plant waits for it until it is stopped
                interrupts.append("the benchmark")

        listener = Listener(f"tls/{address}:{free_port()}", ("nf", "recorder"), seconds)
        try:
            how: dict[str, Any] = {"begun": begun, "listener": listener, "interrupts": interrupts}
            summary = supervise.run(load(SCENE), duration=seconds, out=out, say=lambda _: None, **how).to_json()
            for process in started:
                process.wait(_WAIT_S)
        finally:
            for process in started:
                process.kill()
        return summary
