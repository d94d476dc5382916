"""Cost of recording at high rates: 1 million samples per second in blocks beside 8 scalars per millisecond."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any, cast

import numpy as np

from rig import bus
from rig.bench.live import pace
from rig.bench.live.sample_blocks import AllSamples
from rig.bus import encode
from rig.bus.run_setup import Setup
from rig.errors import BusError
from rig.machine import scheduling
from rig.machine.process import no_garbage
from rig.sensors.chain.bank import KEPT_NS
from rig.sensors.chain.instants import Instants

SENSORS = 10
RATE = 100_000
"""Samples per second of each sensor."""
BLOCK_MS = 20
SCALARS = 8
"""Outputs in the state of each millisecond."""
_FRAME_NS = 1_000_000
_JOIN_S = 20.0
_RECORDER = """
import json, resource, sys
from pathlib import Path
from rig.record.recorder import record
accounts = []
record(sys.argv[1], Path(sys.argv[2]), accounts.append)
used = resource.getrusage(resource.RUSAGE_SELF)
(account,) = accounts
print(json.dumps({"lost": account.lost, "messages": account.messages, "seconds": used.ru_utime + used.ru_stime}))
"""


def recording(seconds: float = 10.0) -> dict[str, Any]:
    """Record traffic over the bus in real time, as a plant sends it.

    Returns the processor time of the recorder as a share of a core with its start ("cores"), messages and losses, bytes
    of the file, and the time on the publishing thread for each frame of 1 ms. Raises BusError if the recorder does not
    join.
    """
    outputs = {f"output_{i}": "m" for i in range(SCALARS)}
    sensors = {f"sensor_{i}": ("m/s", 1_000_000_000 // RATE) for i in range(SENSORS)}
    with tempfile.TemporaryDirectory() as folder, bus.host("benchmark") as session:
        setup = Setup(session.run, '{"plant": "none"}', 1_000_000, 1_000_000, outputs, sensors).to_text().encode()
        scene = session.serve("scene", lambda _: setup)
        watch, totals = session.watch("*/*"), session.subscribe("total/*")
        session.announce()
        path = Path(folder) / "run.mcap"
        child = subprocess.Popen([sys.executable, "-c", _RECORDER, session.run, str(path)], stdout=subprocess.PIPE)
        try:
            deadline = time.monotonic() + _JOIN_S
            while ("recorder", "recorder") not in watch.present:
                if time.monotonic() > deadline:
                    raise BusError(f"the recorder did not join within {_JOIN_S:g} s")
                scene.poll(0.02)
                watch.poll()
            spent = _publish(session, seconds)
            session.publisher("total/plant").put(session.totals(), round(seconds * 1e9))
            while (told := totals.get(_JOIN_S)) is not None and "total/plant" not in told.said.heard_topic:
                pass  # it catches up
        finally:
            session.close()
            said = child.communicate(timeout=2.0 * _JOIN_S)[0]
        account, size = json.loads(said), path.stat().st_size
    return {
        "cores": account["seconds"] / seconds,
        "messages": account["messages"],
        "lost": account["lost"],
        "bytes": size,
        "mean_us": float(spent.mean()) * 1e6,
        "p99_us": float(np.quantile(spent, 0.99)) * 1e6,
    }


class _Instruments:
    """Instruments that have measured noise, with the memory of a bank of instruments."""

    names = tuple(f"sensor_{i}" for i in range(SENSORS))
    instants = tuple(Instants.of(RATE) for _ in range(SENSORS))

    def __init__(self) -> None:
        self._room = KEPT_NS * RATE // 1_000_000_000
        noise = np.random.default_rng(1).standard_normal((SENSORS, self._room))
        self._samples = [memoryview(row) for row in noise]
        self.published = 1
        """Number of samples that each of them has published."""
        self._dropped = 0

    def memory(self, i: int, number: int, most: int) -> memoryview:
        """See `Instruments.memory`."""
        first = number - self._dropped
        return self._samples[i][first : min(first + most, self.published - self._dropped)]

    def drop(self) -> int:
        """Drop all samples but the last; returns the number of frames for which there is room now."""
        self._dropped = self.published - 1
        return (self._room - 1) * 1000 // RATE


def _publish(session: Any, seconds: float) -> Any:
    """Publish in real time with the plant's clock, core and priority; return the time of each frame [s]."""
    state, state_of = session.publisher("state"), encode.StateEncoder(SCALARS)
    instruments = _Instruments()
    samples = AllSamples(session, cast("Any", instruments))
    values, full = np.zeros(SCALARS), instruments.drop()
    spent = np.zeros(round(seconds * 1000))
    with ExitStack() as stack:
        stack.enter_context(no_garbage())
        stack.enter_context(scheduling.placed(*scheduling.choose()))
        stack.enter_context(scheduling.ahead(scheduling.PLANT))
        pacer = pace.Pacer(_FRAME_NS, 1.0, "catch-up", pace.WallClock(pace.choose(_FRAME_NS).spin_ns))
        pacer.anchor()
        for frame in range(spent.size):
            now = frame * _FRAME_NS
            values[:] = frame
            instruments.published = frame * RATE // 1000 + 1
            begin, _ = pacer.wait()
            state.put_later(now, state_of, now, frame, 0, values.tobytes())
            samples.gather(frame, now)
            if frame == full:
                samples.collect(frame, now)
                full += instruments.drop()
            if frame % BLOCK_MS == 0:
                session.flush()
            spent[frame] = 1e-9 * (time.perf_counter_ns() - begin)
    return spent


_ROWS = 10_000
_IMPORT = """
import resource, sys, time
from pathlib import Path
import psutil
import rig
small, large, out = map(Path, sys.argv[1:])
channels = {"v": "vibrometer, 125 mm/s/V", "F": "load, 100 N/V, offset -2.5 N", "a": "accelerometer, m/s^2"}
rig.import_(small, out, channels, rate="50 kHz", force=True)
before, begin, clock = psutil.Process().memory_info().rss, time.process_time(), time.perf_counter()
rig.import_(large, out, channels, rate="50 kHz", force=True)
most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
print(time.process_time() - begin, time.perf_counter() - clock, most - before)
"""


def imported(megabytes: int) -> dict[str, Any]:
    """Import a CSV of this size: MB per second of processor time and of the clock, memory above that after a small one.

    The files are in a folder of their own, which is deleted.
    """
    rows = np.random.default_rng(0).standard_normal((_ROWS, 3))
    block = "".join(f"{v:.9f},{F:.9f},{a:.9f}\n" for v, F, a in rows).encode()
    with tempfile.TemporaryDirectory(prefix="friction-rig-bench-") as folder:
        small, large, out = (Path(folder) / name for name in ("small.csv", "large.csv", "run.mcap"))
        for path, count in ((small, 1), (large, max(megabytes * 10**6 // len(block), 1))):
            with path.open("wb") as file:
                file.write(b"v,F,a\n")
                for _ in range(count):
                    file.write(block)
        size = large.stat().st_size / 1e6
        words = [sys.executable, "-c", _IMPORT, str(small), str(large), str(out)]
        done = subprocess.run(words, capture_output=True, text=True, check=True, timeout=1800)
    processor, clock, memory = map(float, done.stdout.split())
    return {"MB": size, "MB_per_core_s": size / processor, "MB_per_s": size / clock, "above_MB": memory / 1e6}
