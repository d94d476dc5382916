"""The workers of a dask cluster: those of a scheduler that runs, of one that is started here, or of a batch system.

dask does what concerns more than one machine: connections, TLS, lost workers, queues. Here batches of about ten
seconds are sent, results are saved as they come, and workers are checked for the same sources.

dask itself would wait for ever for the answer of what listens at an address and is no scheduler. A scheduler speaks
first: the length of its message in eight bytes, then the message. The jobs of a batch system, SLURM, are processes that
are workers of a scheduler in this process.
"""

from __future__ import annotations

import ctypes
import logging
import pickle
import queue
import shutil
import signal
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from functools import lru_cache
from typing import Any

from rig.analysis.pool.work import MOST_WORKERS, Arrays, Schedule, Store, Work, sources, this_processor
from rig.compiled import kernel
from rig.errors import RigError, UsageError, WorkerError
from rig.extras import needed
from rig.machine.scheduling import cores
from rig.quantities import whole

_LONGEST = 1 << 20  # bytes of a first message: it has some hundreds
_HEAD = struct.Struct("<Q")
LOOPBACK = "127.0.0.1"
ANSWER = 10.0  # s within which a scheduler answers
SPAN = 10.0  # s of a batch
JOIN, _QUEUE = 60.0, 86400.0  # s within which a worker joins; one that waits in the queue of a batch system
_LOOK = 0.2  # s between two reports of progress
_AHEAD = 2  # batches on their way for each worker, so that none waits for the next
_PREPARING = 300.0  # s for another process of the same machine to compile
_TAKEN = threading.Lock()  # one batch at a time: a worker may have several threads
_LOCAL = {
    "distributed.scheduler.allowed-failures": 1,
    "distributed.worker.memory.terminate": False,
    "distributed.worker.profile.enabled": False,  # the rest watches the processes: 20 to 30 ms of each second
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "5s",
}
"""Configuration of dask for a cluster that is started here."""
# M_MMAP_THRESHOLD, M_TRIM_THRESHOLD of <malloc.h> [bytes]: the greatest values that glibc itself chooses.
_KEPT = {-3: 32 << 20, -1: 64 << 20}


def unanswered(where: str, seconds: float) -> str:
    """Why no scheduler answers at tcp://HOST:PORT within some time; "" if one does, or if nothing listens there yet.

    Other addresses are not tried: what listens without encryption fails at once with tls.
    """
    scheme, _, rest = where.partition("://")
    if scheme != "tcp":
        return ""
    host, _, port = rest.rpartition(":")
    try:
        connected = socket.create_connection((host.strip("[]"), int(port)), timeout=seconds)
    except OSError:  # dask tries again for some time
        return ""
    with connected:
        connected.settimeout(seconds)
        try:
            with connected.makefile("rb") as file:
                head = file.read(_HEAD.size)
        except TimeoutError:
            return "it accepts the connection and says nothing"
        except OSError as fault:
            return fault.strerror or str(fault)
    if len(head) == _HEAD.size and 0 < _HEAD.unpack(head)[0] <= _LONGEST:
        return ""
    return "what listens there does not speak as dask does"


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


class Cluster:
    """The workers of `where`, known to the dask `client`, that compute `work` into `store`.

    `failed`: units that ended their worker, with the reason. `refused`: why jobs were not accepted by a batch system.
    """

    def __init__(self, work: Work, store: Store, where: str, client: Any, refused: list[str]) -> None:
        self._store, self._where, self._client, self._refused = store, where, client, refused
        self._pickled = pickle.dumps(work)
        self.failed: dict[int, str] = {}

    def compute(self, units: Mapping[int, tuple[float, ...]], progress: Callable[[int], object]) -> None:
        """Compute `units` (number -> values that they are given) and save them, as `WorkerProcesses.compute` does.

        Raises WorkerError for a fault that ends the whole work, if the scheduler is lost, and if no worker joins.
        """
        schedule = Schedule(units, max(self._threads(), 1), SPAN)
        ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
        out: dict[Any, list[int]] = {}
        joined, alone = time.monotonic(), False
        try:
            while schedule.left:
                threads = self._threads()
                if self._refused:
                    raise WorkerError(f"--cluster {self._where}: the batch system refused a job: {self._refused[0]}")
                if threads:
                    joined = time.monotonic()
                elif time.monotonic() - joined > (JOIN if self._where != "slurm" else _QUEUE):
                    raise self._lost("no worker has joined for a minute")
                while threads and schedule.waiting and len(out) < _AHEAD * threads and not alone:
                    if schedule.suspects and out:
                        break
                    alone = schedule.suspects  # dask also blames what waited behind: alone, it is known who did it
                    batch = schedule.batch()
                    given = [(unit, *units[unit]) for unit in batch]
                    key = f"friction-rig-{batch[0]}-{time.time_ns()}"
                    future = self._client.submit(_compute, self._pickled, given, sources(), pure=False, key=key)
                    out[future] = batch
                    future.add_done_callback(ended.put)
                with suppress(queue.Empty):
                    future = ended.get(timeout=_LOOK)
                    self._take(future, out.pop(future), schedule)
                    alone = False
                if self._client.status != "running":
                    raise self._lost("the scheduler does not answer any more")
                progress(len(units) - schedule.left)
        except BaseException:
            with suppress(Exception):
                self._client.cancel(list(out), force=True)
            raise

    def _take(self, future: Any, batch: list[int], schedule: Schedule) -> None:
        """Save the result of a batch, or send it out again if it ended its worker."""
        if future.status == "cancelled":
            raise self._lost("the scheduler has cancelled the work, or was lost")
        if future.status == "error":
            error = future.exception(timeout=ANSWER)
            if type(error).__name__ != "KilledWorker":
                what = f"{type(error).__name__}: {' '.join(str(error).split())[:300]}"
                raise WorkerError(f"a worker failed: {what}{self._store.kept}")
            for unit in schedule.lost(batch):
                self.failed[unit] = "ended every worker that dask gave it to"
            return
        result = None  # finished when it was reported, and perhaps lost with its worker since then
        with suppress(Exception):
            result = future.result(timeout=ANSWER) if future.status == "finished" else None
        future.release()
        if result is None:
            schedule.lost(batch, 0)
            return
        fault, rows, seconds, processor = result
        if fault:
            raise WorkerError(f"{fault}{self._store.kept}")
        self._store.save(rows, processor)
        schedule.done(batch, seconds)

    def _threads(self) -> int:
        """Number of batches that the workers compute at a time: one in each process."""
        with suppress(Exception):
            return len(self._client.scheduler_info(n_workers=-1)["workers"])
        return 0

    def _lost(self, what: str) -> WorkerError:
        return WorkerError(f"--cluster {self._where}: {what}{self._store.kept}; the same command continues from there")


@contextmanager
def joined(work: Work, store: Store, where: str, workers: int | None) -> Iterator[Cluster]:
    """The cluster `where`: the address of a scheduler (tcp://HOST:PORT, tls://HOST:PORT), "local", or "slurm".

    `workers`: processes to start, if they are started here. Raises UsageError.
    """
    check(where, workers)
    distributed = needed("distributed", "cluster")
    for name in ("distributed", "distributed.client", "asyncio", "tornado"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # what matters is reported by this module
    if why := unanswered(where, ANSWER):
        raise _no_answer(where, why)
    refused: list[str] = []
    with ExitStack() as ends:
        made = _started(where, workers, refused)
        if made is not None:
            ends.callback(_closed, made)
        try:
            client = distributed.Client(
                where if made is None else made, timeout=ANSWER, set_as_default=False, name="friction-rig"
            )
        except (OSError, TimeoutError, ValueError, ImportError, TypeError) as fault:
            if "ssl_context" in str(fault):
                raise UsageError(
                    f"--cluster {where}: the configuration of dask names no certificates: state "
                    "distributed.comm.tls.ca-file, and key and cert of distributed.comm.tls.client"
                ) from None
            raise _no_answer(where, " ".join(str(fault).split())[:200]) from None
        ends.callback(_closed, client)
        _compare(client, where)
        yield Cluster(work, store, where, client, refused)


def _closed(what: Any) -> None:
    with suppress(Exception):
        what.close(timeout=ANSWER)


def _no_answer(where: str, why: str) -> UsageError:
    return UsageError(
        f"--cluster {where}: no scheduler answers within {ANSWER:g} s ({why}); start one: "
        f"dask scheduler --host {LOOPBACK}"
    )


def _compare(client: Any, where: str) -> None:
    """Raise UsageError if a worker has other sources, or none."""
    mine, wrong = sources(), []
    for address, theirs in client.run(sources, on_error="return").items():
        if isinstance(theirs, BaseException):
            why = " ".join(str(theirs).split())[:120]
            wrong.append(f"\n  {address}: cannot load this version of friction-rig ({why})")
        elif theirs != mine:
            wrong.append(f"\n  {address}: {theirs}")
    if wrong:
        raise UsageError(
            f"--cluster {where}: these workers have other sources than this process ({mine}):{''.join(wrong)}\n"
            "install the same version on all of them"
        )


def check(where: str, workers: int | None) -> str:
    """Return `where` if it names a cluster. Raises UsageError."""
    if workers is not None:
        whole("workers", workers, 1, MOST_WORKERS)
    if where == "slurm" and workers is None:
        raise UsageError("--cluster slurm: state the number of worker processes to ask for: --workers 16")
    if where in ("local", "slurm"):
        return where
    scheme, _, rest = str(where).partition("://")
    host, _, port = rest.rpartition(":")
    if scheme in ("tcp", "tls") and host and port.isdecimal() and 0 < int(port) < 65536:
        if workers is not None:
            raise UsageError(f"--cluster {where}: a scheduler that runs has its workers; leave --workers {workers} out")
        return where
    raise UsageError(
        f"--cluster {where}: expected local, slurm or the address of a scheduler (tcp://HOST:PORT, tls://HOST:PORT) "
        "with a port from 1 to 65535"
    )


def _started(where: str, workers: int | None, refused: list[str]) -> Any:
    """The cluster that is started here; None for a scheduler that runs already. Refused jobs add to `refused`."""
    if where == "slurm":
        return started(workers, refused)
    if where != "local":
        return None
    distributed = needed("distributed", "cluster")
    dask = needed("dask", "cluster")
    dask.config.set(_LOCAL)
    secure = dask.config.get("distributed.comm.require-encryption", None)
    with _without_interrupts():
        return distributed.LocalCluster(
            n_workers=workers or cores(),
            threads_per_worker=1,
            host=LOOPBACK,
            protocol="tls://" if secure else "tcp://",
            security=distributed.Security(),
            dashboard_address=f"{LOOPBACK}:0",
            worker_dashboard_address=None,
            silence_logs=logging.CRITICAL,
        )


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Processes that are started here ignore Ctrl-C, which reaches all processes of a terminal."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _compute(
    pickled: bytes, batch: list[tuple[float, ...]], expected: str
) -> tuple[str, dict[int, Arrays], float, str]:
    """Compute a batch on a worker: a fault ("" if there is none), results, seconds, type of the processor."""
    if sources() != expected:
        return f"a worker has other sources: {sources()}, not {expected}", {}, 0.0, ""
    with _TAKEN:
        try:
            work = _work(pickled)
            begin = time.perf_counter()
            rows = {int(unit): work.compute(int(unit), *given) for unit, *given in batch}
            return "", rows, time.perf_counter() - begin, this_processor()
        except RigError as fault:  # some of these cannot be sent as they are
            return str(fault), {}, 0.0, ""


@lru_cache(maxsize=2)
def _work(pickled: bytes) -> Work:
    """A work, its kernels compiled: once in each worker, by one process of a machine at a time."""
    _keep_memory()
    work: Work = pickle.loads(pickled)
    with kernel.FOLDER.claimed("pool", _PREPARING):
        work.prepare()
    return work


def _keep_memory() -> None:
    """Let this process keep the memory of arrays that it has freed for the next ones, as without dask.

    dask starts workers with MALLOC_TRIM_THRESHOLD_, which makes glibc return every large array to the system. A run of
    100 000 samples then takes 3000 page faults, a tenth of its time.
    """
    if sys.platform == "linux" and (mallopt := getattr(ctypes.CDLL(None), "mallopt", None)) is not None:
        for parameter, size in _KEPT.items():
            mallopt(parameter, size)
