"""The process of the plant, which is the hub of a run."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from rig import bus
from rig.bench.live.frame_cost import FrameCost, kept_pace
from rig.bench.live.outcome import Job, keeps_up
from rig.bench.live.plant import Plant, Say, Show
from rig.bench.live.rehearsal import marked, rehearse
from rig.bench.run.runner import PlantRunner
from rig.bus import address
from rig.errors import Interrupted, RigError
from rig.machine import scheduling
from rig.machine.process import as_process, tell, told_to_stop
from rig.scenes.scene import Scene


def carry_out(
    job: Job, say: Say = lambda _: None, show: Show = lambda _: None, calling: Path | None = None
) -> dict[str, Any]:
    """Host a run, carry out the job and return its summary. Raises RigError if the run cannot begin.

    A stop signal ends the run in order. `say` gets status lines before the first frame, `show` gets the health of the
    run while it continues. `calling`: see `rig.bench.live.rehearsal.marked`.
    """
    scene = Scene.from_json(job.scene)
    keeps_up(scene, job.pace)
    address.directory()  # a system without live runs is refused before the rehearsal, and so is a name
    if job.run is not None:
        address.check(job.run)
    with marked(calling):  # Ctrl-C may interrupt this, but nothing after it
        if job.pace is None:
            sets = warm(scene)
        else:
            rehearsal = rehearse(scene, job)
            sets = rehearsal.sets
            job = _at_pace_kept(scene, job, job.pace, rehearsal.cost, say)
    asked: list[str] = []
    with told_to_stop(asked.append):
        scheduling.come_first()  # the threads of the bus inherit it
        with bus.host(job.run, scene.name, job.endpoint, scene.controllers, job.listener) as session:
            plant = Plant(session, job, lambda: f"stopped by {asked[0]}" if asked else "", sets)
            session.announce()
            tell("run", session.run)
            say(f"run {session.run}")
            if job.listener is not None:
                folder = next(iter(session.tickets.values())).parent
                say(f"listens at {job.listener.endpoint}; tickets in {folder}: {', '.join(session.tickets)}")
            plant.gather(say)
            if asked:
                raise Interrupted(f"stopped by {asked[0]} before the first frame")
            return plant.run(show)


def _at_pace_kept(scene: Scene, job: Job, pace: float, cost: FrameCost | None, say: Say) -> Job:
    """The job at the pace that it takes on this machine; `say` gets what its user should know of it."""
    if cost is None:
        return job
    kept, told = kept_pace(scene, pace, cost, job.adapts)
    if told:
        say(told)
    return replace(job, pace=kept)


def warm(scene: Scene) -> tuple[int, ...]:
    """Compile or load the kernels of `scene` before any frame is due. Return the keys of the mode sets visited."""
    runner = PlantRunner(scene)
    for _ in range(3):
        runner.frame()
        runner.output_values()
    runner.statistics()
    return runner.motion.mode_sets.keys


def main(arguments: list[str] | None = None) -> int:
    """`python -m rig.bench.live.plant_process CALLING`, started by a supervisor, which sends the job as a line of JSON.

    It is told status lines (say) and the summary, or why there was no run. None of this needs room on a disk.
    """
    parser = argparse.ArgumentParser(prog="rig.bench.live.plant_process", description=__doc__.partition("\n")[0])
    parser.add_argument("calling", type=Path, help="file for the name of the controller that the rehearsal calls")
    given = parser.parse_args(arguments)
    try:
        job = Job.from_json(sys.stdin.readline())
        summary = carry_out(job, lambda text: tell("say", text), calling=given.calling)
    except RigError as error:
        summary = {"failed": str(error), "exit_code": error.exit_code}
    tell("summary", summary)
    return int(summary["exit_code"])


if __name__ == "__main__":
    as_process(main)
