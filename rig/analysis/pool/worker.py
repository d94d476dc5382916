"""A worker process: `python -m rig.analysis.pool.worker FOLDER` computes the batches that it reads, and saves them.

It reads the work on standard input, then a line for each batch, a list of [unit, value, ...], and ends when there are
no more. What it tells (`rig.machine.process.tell`):

ready        waits for batches             at N   units of the batch that are finished
done S       the batch is saved, S s       fault TEXT   the whole work has to end
"""

from __future__ import annotations

import base64
import json
import os
import pickle
import signal
import sys
import time
from pathlib import Path
from typing import IO

from rig.analysis.pool.work import Arrays, Store, Work
from rig.errors import ExitCode, RigError
from rig.machine.process import as_process, tell, with_parent
from rig.machine.scheduling import keep_to_one_core

_TELL = 0.1  # s between two messages on a batch


def main() -> int:
    """Run one worker."""
    store = Store(Path(sys.argv[1]))
    keep_to_one_core()
    # SIGTERM acts as Ctrl-C, which a job in the background ignores: what is finished of a batch is saved
    with_parent(lambda: os.kill(os.getpid(), signal.SIGTERM))
    batches = _batches()
    try:
        work = pickle.loads(base64.b64decode(batches.readline()))
        tell("ready")
        while line := batches.readline():
            begin = time.perf_counter()
            _batch(work, store, json.loads(line))
            tell("done", time.perf_counter() - begin)
    except RigError as fault:  # as a full disk
        tell("fault", str(fault))
        return 1
    except KeyboardInterrupt:
        return ExitCode.INTERRUPTED
    return 0


def _batches() -> IO[str]:
    """Standard input, on which units find nothing from now on: they would wait for ever, or take the batches."""
    batches = os.fdopen(os.dup(0), encoding="utf-8")
    with Path(os.devnull).open() as nothing:
        os.dup2(nothing.fileno(), 0)
    sys.stdin = open(0, encoding="utf-8", closefd=False)
    return batches


def _batch(work: Work, store: Store, batch: list[list[float]]) -> None:
    """Compute a batch and save it; after an interruption, what is finished of it."""
    rows: dict[int, Arrays] = {}
    told = time.monotonic()
    leave = sys.unraisablehook

    def interrupted_in_a_callback(fault: sys.UnraisableHookArgs) -> None:  # `leave` ends the process, see as_process
        try:
            if rows and isinstance(fault.exc_value, KeyboardInterrupt):
                store.save(rows)
        finally:
            leave(fault)

    def progress(done: int) -> None:
        nonlocal told
        if time.monotonic() - told >= _TELL:
            told = time.monotonic()
            tell("at", done)

    sys.unraisablehook = interrupted_in_a_callback
    try:
        store.compute(work, batch, rows, progress)
    finally:
        sys.unraisablehook = leave


if __name__ == "__main__":
    as_process(main)
