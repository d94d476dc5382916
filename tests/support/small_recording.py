"""A small recording, written as the recorder writes it, and its messages."""

import numpy as np
import pytest

from rig.bus import encode
from rig.bus.run_setup import Setup
from rig.record import writer
from rig.record.message_scan import Scan
from rig.record.writer import Writer

SETUP = Setup("r", '{"plant": "belt"}', 1_000_000, 1_000_000, {"x": "m"}, {"s": ("m", 1_000_000)})


def walked(path):
    scan = Scan(path)
    return scan, list(scan)


def record(path, count, finished=True):
    """Messages as the recorder gets them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writer, "FLUSH_NS", 0)  # due whenever it is asked
        log, state = Writer(path, SETUP, "recorded"), encode.StateEncoder(1)
    try:
        for k in range(count):
            now = k * 1_000_000
            log.write("step", encode.step(k, now, np.array([float(k)]), np.ones(1, np.int64)), now, k, now)
            log.write("state", state(now, k, 0, np.array([k * 0.5])), now, k, now)
            log.write("meas/s", encode.block(k, now, 1_000_000, [float(k)]), now, k, now)
        if finished:
            log.close({"messages": log.messages}, {"verdict": "VALID"})
        else:
            log.settle(1 << 62)
            log.flush_if_due()
    finally:
        log.abandon()
