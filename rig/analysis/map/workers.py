"""Worker processes of a map, which fetch batches from the plan until none is left.

The numbers of a batch depend on the job alone: neither the worker nor the number of workers changes them.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

from rig.analysis import kernel_shapes
from rig.analysis.map.compute import compute
from rig.analysis.map.job import Arrays, Job
from rig.analysis.map.store import Store
from rig.analysis.map.track import Track
from rig.child_process import Child, end
from rig.errors import ExitCode, RigError, WorkerError

_ROUNDS = 8  # batches for each worker: a small number at the end keeps the other workers idle only briefly
_MOST = 16  # units in a batch: the most that an interruption loses
_LOOK = 0.05  # s
_DONE = "done"

Progress = Callable[[int, int], object]
"""(units done, all units)."""


def make(job: Job, store: Store, workers: int, progress: Progress) -> dict[int, Arrays]:
    """Compute what `store` does not contain yet; return all units. Raises WorkerError if a worker is lost; `store`
    stays.
    """
    total = len(job.units)
    done = len(ready := store.load())
    todo = [unit for unit in range(total) if unit not in ready]
    progress(done, total)
    if not todo:
        return ready
    size = max(1, min(_MOST, len(todo) // (workers * _ROUNDS)))
    batches = [todo[i : i + size] for i in range(0, len(todo), size)]
    if workers == 1 or len(batches) == 1:
        for batch in batches:
            store.save(compute(job, batch))
            done += len(batch)
            progress(done, total)
    else:
        if not job.settings.eigenvalues:
            _compile(job)
        store.plan(batches)
        _together(store, min(workers, len(batches)), lambda new: progress(done + new, total))
    return store.load()


def _compile(job: Job) -> None:
    """Compile the kernels before several workers ask for them."""
    track = Track(job.at(0), job.x, job.settings)
    shape = kernel_shapes.shape_of(track.system(track.value), job.scene.clock.method)
    if shape not in kernel_shapes.ready():
        track.compile()
        kernel_shapes.note(shape)


def _together(store: Store, workers: int, progress: Callable[[int], object]) -> None:
    """Let `workers` processes compute the plan; `progress` gets the number of units finished so far."""
    crew = [Child(f"map worker {k + 1}", ["rig.analysis.map.workers", str(store.folder)]) for k in range(workers)]
    done = 0
    try:
        while any(child.code is None for child in crew):
            time.sleep(_LOOK)
            done += sum(line == _DONE for child in crew for line in child.new_lines())
            progress(done)
            lost = [child for child in crew if child.code]
            if lost:
                raise WorkerError(
                    f"{'; '.join(child.ending for child in lost)}. Finished results are kept in {store.folder}"
                )
    finally:
        end(crew, 0.0)


def main() -> None:
    """Run one worker: `python -m rig.analysis.map.workers FOLDER`."""
    store, parent = Store(Path(sys.argv[1])), os.getppid()
    job = store.job()
    try:
        for batch in store.planned():
            if os.getppid() != parent:
                return
            if store.claim(batch):
                store.save(compute(job, batch, lambda _: sys.stdout.write(f"{_DONE}\n") and sys.stdout.flush()))
    except RigError as fault:  # as a full disk
        sys.exit(str(fault))
    except KeyboardInterrupt:
        sys.exit(ExitCode.INTERRUPTED)


if __name__ == "__main__":
    main()
