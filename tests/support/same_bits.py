"""Compares what a live run has recorded with a run in one process."""

import numpy as np


def same_bits(log, run, lost):
    """What was recorded has the bits of a run in one process; all of them, if no messages were `lost`."""
    for name, known in run.measurements.items():
        recorded = log.measurements[name]
        at = np.searchsorted(known.t_ns, recorded.t_ns)
        assert recorded.t_ns.tobytes() == known.t_ns[at].tobytes()
        assert recorded.v.tobytes() == known.v[at].tobytes()
        assert lost or len(at) == len(known.v)
    at = np.searchsorted(run.time, log.time - 1e-9)
    for name, values in log.signals.items():
        assert values.tobytes() == run.signals[name][at].tobytes()
    for name, known in run.commands.items():
        at = np.searchsorted(known.tick, log.commands[name].tick)
        assert log.commands[name].values.tobytes() == known.values[at].tobytes()
        assert lost or np.array_equal(log.commands[name].tick, known.tick)
