"""Waits for what must come at last, on a machine as busy as it may be: a test judges the run, and not the load."""

import time

PATIENCE_S = 120.0


def wait_for(what, told=lambda: ""):
    """What `what()` returns, when that is something; `told()` says how far it is."""
    deadline = time.monotonic() + PATIENCE_S
    while not (answer := what()):
        assert time.monotonic() < deadline, told()
        time.sleep(0.02)
    return answer
