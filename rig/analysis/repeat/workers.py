"""Worker processes that simulate one scene with many seeds; each takes the next seed until none is left."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from rig.analysis.repeat.measure import Seen, measure
from rig.bench.simulate import simulate
from rig.child_process import Child, end
from rig.errors import ExitCode, RigError, WorkerError
from rig.scenes.scene import Scene
from rig.user_files import write_file

_LOOK = 0.05  # s


@dataclass(frozen=True)
class Job:
    """`scene` with each of `seeds`, for `duration` [s] or the length of its protocol."""

    scene: Scene
    seeds: tuple[int, ...]
    duration: float | None

    def to_json(self) -> str:
        """Return the job as JSON text."""
        return json.dumps({"scene": self.scene.to_json(), "seeds": self.seeds, "duration": self.duration})

    @classmethod
    def from_json(cls, text: str) -> Job:
        """Return the job of a text by `to_json`."""
        raw = json.loads(text)
        return cls(Scene.from_json(raw["scene"]), tuple(raw["seeds"]), raw["duration"])

    def run(self, seed: int, stop: Callable[[], str] | None = None) -> Seen:
        """Simulate with one seed and measure."""
        duration_ns = None if self.duration is None else round(self.duration * 1e9)
        return measure(simulate(replace(self.scene, seed=seed), duration_ns=duration_ns, stop=stop), seed)


def work(
    job: Job, folder: Path, workers: int | None, progress: Callable[[int, int], object], stop: Callable[[], str]
) -> tuple[list[Seen], str]:
    """Simulate all seeds; return the numbers of each run and, if the work ended early, the reason.

    Results go through `folder`. This process simulates the first run, which compiles the kernels and builds the models
    that all runs need. Raises WorkerError if a process is lost.
    """
    total = len(job.seeds)
    progress(0, total)
    first = job.run(job.seeds[0], stop)
    if why := stop():
        return [], why
    progress(1, total)
    write_file(folder / "job.json", job.to_json().encode())
    count = min(workers or os.cpu_count() or 1, total - 1)
    children = [Child(f"repeat worker {k + 1}", [__name__, str(folder)]) for k in range(count)]
    why = ""
    try:
        while any(child.code is None for child in children) and not (why := stop()):
            time.sleep(_LOOK)
            progress(1 + len(list(folder.glob("*.seen"))), total)
            if lost := [child.ending for child in children if child.code]:
                raise WorkerError("; ".join(lost))
    finally:
        end(children, 0.0)
    rest = [Seen.from_json(json.loads(path.read_text())) for path in folder.glob("*.seen")]
    return sorted([first, *rest], key=lambda one: one.seed), why


def main() -> None:
    """Run one worker: `python -m rig.analysis.repeat.workers FOLDER`."""
    folder, parent = Path(sys.argv[1]), os.getppid()
    job = Job.from_json((folder / "job.json").read_text())
    try:
        for seed in job.seeds[1:]:
            if os.getppid() != parent:
                return
            try:
                os.close(os.open(folder / f"{seed}.claim", os.O_CREAT | os.O_EXCL))
            except FileExistsError:  # another worker has this seed
                continue
            write_file(folder / f"{seed}.seen", json.dumps(job.run(seed).to_json()).encode())
    except RigError as fault:  # as a full disk
        sys.exit(str(fault))
    except KeyboardInterrupt:
        sys.exit(ExitCode.INTERRUPTED)


if __name__ == "__main__":
    main()
