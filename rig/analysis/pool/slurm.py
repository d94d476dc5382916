"""The jobs of a batch system, SLURM, whose processes are workers of a dask scheduler in this process."""

from __future__ import annotations

import shutil
import signal
from contextlib import suppress
from typing import Any

from rig.errors import UsageError
from rig.extras import needed

LOOPBACK = "127.0.0.1"
ANSWER = 10.0  # s within which a scheduler answers


def job_script(workers: int) -> str:
    """Return the job script with which `--cluster slurm` asks for worker processes. Raises UsageError."""
    cluster = _cluster([])
    try:
        [spec] = [cluster.new_worker_spec()]
        each = int(next(iter(spec.values()))["options"].get("processes") or 1)
        script: str = cluster.job_script()
    finally:
        with suppress(Exception):
            cluster.close(timeout=ANSWER)
    reach = "where other machines do not reach it: state jobqueue.slurm.interface in the configuration of dask"
    note = "" if _told_host() else f"# the scheduler listens on {LOOPBACK}, {reach}\n"
    return f"# submitted {-(-workers // each)} times\n{note}{script}"


def started(workers: int | None, refused: list[str]) -> Any:
    """Submit jobs for `workers` processes; return their cluster. A job that is refused adds its reason to `refused`.

    Raises UsageError if this machine submits no jobs.
    """
    if shutil.which("sbatch") is None:
        raise UsageError(
            "--cluster slurm: the command sbatch is not found; start this where jobs are submitted "
            "(--dry-run prints the job script anywhere)"
        )
    cluster = _cluster(refused)
    cluster.scale(n=workers)
    return cluster


def _told_host() -> bool:
    """Whether the configuration of dask says where the scheduler of a batch system listens."""
    own = needed("dask", "cluster").config.get("jobqueue.slurm", {})
    return bool(own.get("interface") or (own.get("scheduler-options") or {}).get("host"))


def _cluster(refused: list[str]) -> Any:
    interrupted = signal.getsignal(signal.SIGINT)
    jobqueue = needed("dask_jobqueue", "cluster")
    if signal.getsignal(signal.SIGINT) is not interrupted:  # its import makes Ctrl-C end this process with code 0
        signal.signal(signal.SIGINT, interrupted)
    dask = needed("dask", "cluster")
    own = dask.config.get("jobqueue.slurm", {})
    defaults = {"cores": 1, "processes": 1, "memory": "4 GB"}
    asked: dict[str, Any] = {name: value for name, value in defaults.items() if not own.get(name)}
    if not _told_host():
        asked["scheduler_options"] = {"host": LOOPBACK, "dashboard_address": f"{LOOPBACK}:0"}
    try:
        return jobqueue.SLURMCluster(job_cls=_noted(jobqueue.SLURMCluster.job_cls, refused), **asked)
    except Exception as fault:
        raise UsageError(f"--cluster slurm: {type(fault).__name__}: {fault}") from None


def _noted(job: Any, refused: list[str]) -> Any:
    """The class `job` of dask-jobqueue, which notes why it could not be submitted, instead of a line in a log."""

    class Job(job):  # type: ignore[misc]
        async def start(self) -> None:
            try:
                await super().start()
            except Exception as fault:
                told = str(fault).rpartition("stderr:")[2]
                refused.append(" ".join(told.split())[:300] or type(fault).__name__)
                self.status = needed("distributed", "cluster").Status.running  # as a process that was started

    return Job
