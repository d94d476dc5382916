"""The workers of a dask cluster, known by the address of its scheduler.

dask does what concerns more than one machine: connections, TLS, lost workers. Here batches of about ten seconds are
sent, results are saved as they come, and workers are checked for the same sources.
"""

from __future__ import annotations

import ctypes
import importlib
import logging
import pickle
import queue
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import lru_cache
from typing import Any

from rig.analysis.pool.work import Arrays, Schedule, Store, Work, sources, this_processor
from rig.compiled import kernel
from rig.errors import RigError, UsageError, WorkerError
from rig.extras import needed

LOOPBACK = "127.0.0.1"
ANSWER = 10.0  # s within which a scheduler answers
SPAN = 10.0  # s of a batch
JOIN = 60.0  # s within which a worker joins
_LONGEST = 1 << 20  # bytes of a scheduler's first message, which has some hundreds
_LOOK = 0.2  # s between two reports of progress
_AHEAD = 2  # batches on their way for each worker, so that none waits for the next
_PREPARING = 300.0  # s for another process of the same machine to compile
_TAKEN = threading.Lock()  # one batch at a time: a worker may have several threads
# M_MMAP_THRESHOLD, M_TRIM_THRESHOLD of <malloc.h> [bytes]: the greatest values that glibc itself chooses.
_KEPT = {-3: 32 << 20, -1: 64 << 20}


class Cluster:
    """The workers of `where`, known to the dask `client`, that compute `work` into `store`.

    `failed`: units that ended their worker, with the reason.
    """

    def __init__(self, work: Work, store: Store, where: str, client: Any) -> None:
        self._store = store
        self._where = where
        self._client = client
        self._pickled = pickle.dumps(work)
        self.failed: dict[int, str] = {}

    def compute(self, units: Mapping[int, tuple[float, ...]], progress: Callable[[int], object]) -> None:
        """Compute `units` (number -> values that they are given) and save them, as `WorkerProcesses.compute` does.

        Raises WorkerError for a fault that ends the whole work, if the scheduler is lost, and if no worker joins.
        """
        schedule = Schedule(units, max(self._threads(), 1), SPAN)
        ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
        out: dict[Any, list[int]] = {}
        joined = time.monotonic()
        alone = False
        try:
            while schedule.left:
                threads = self._threads()
                if threads:
                    joined = time.monotonic()
                elif time.monotonic() - joined > JOIN:
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


def _hear(where: str) -> None:
    """Raise OSError if what listens at tcp://HOST:PORT does not speak first: eight bytes, the length of a message.

    dask would wait for a scheduler's answer for ever. Where nothing listens, it tries again for some time.
    """
    scheme, _, rest = where.partition("://")
    host, _, port = rest.rpartition(":")
    try:
        connected = socket.create_connection((host.strip("[]"), int(port)), timeout=ANSWER)
    except OSError:
        return
    with connected:
        if scheme == "tcp" and not 0 < int.from_bytes(connected.recv(8, socket.MSG_WAITALL), "little") <= _LONGEST:
            raise OSError("what listens there does not speak as dask does")


@contextmanager
def joined(work: Work, store: Store, where: str) -> Iterator[Cluster]:
    """The cluster with the scheduler `where` (tcp://HOST:PORT, tls://HOST:PORT). Raises UsageError."""
    distributed = needed("distributed", "cluster")
    for name in ("distributed", "distributed.client", "asyncio", "tornado"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # what matters is reported by this module
    try:
        _hear(where)
        client = distributed.Client(where, timeout=ANSWER, set_as_default=False, name="friction-rig")
    except (OSError, TimeoutError, ValueError, ImportError, TypeError) as fault:
        if "ssl_context" in str(fault):
            raise UsageError(
                f"--cluster {where}: the configuration of dask names no certificates: state "
                "distributed.comm.tls.ca-file, and key and cert of distributed.comm.tls.client"
            ) from None
        why = " ".join(str(fault).split())[:200]
        raise UsageError(
            f"--cluster {where}: no scheduler answers within {ANSWER:g} s ({why}); start one: "
            f"dask scheduler --host {LOOPBACK}"
        ) from None
    try:
        compare_sources(client, where)
        yield Cluster(work, store, where, client)
    finally:
        with suppress(Exception):
            client.close(timeout=ANSWER)


def compare_sources(client: Any, where: str) -> None:
    """Raise UsageError if a worker has other sources, or none; one that is lost before it answers is no such worker."""
    mine = sources()
    wrong = []
    for address, theirs in client.run(sources, on_error="return").items():
        if isinstance(theirs, OSError | TimeoutError):  # its connection has ended: dask starts another, or has others
            continue
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


def check(where: str, workers: int | None) -> None:
    """Raise UsageError unless `where` is an address and `workers`, which the scheduler has, are not given."""
    scheme, _, rest = where.partition("://")
    host, _, port = rest.rpartition(":")
    if not (scheme in ("tcp", "tls") and host and port.isdecimal() and 0 < int(port) < 65536):
        raise UsageError(
            f"--cluster {where}: expected the address of a scheduler (tcp://HOST:PORT, tls://HOST:PORT) with a port "
            "from 1 to 65535"
        )
    if workers is not None:
        raise UsageError(f"--cluster {where}: a scheduler that runs has its workers; leave --workers {workers} out")


def _compute(
    pickled: bytes, batch: list[tuple[float, ...]], expected: str
) -> tuple[str, dict[int, Arrays], float, str]:
    """Compute a batch on a worker: a fault ("" if there is none), results, seconds, type of the processor."""
    if sources() != expected:
        return f"a worker has other sources: {sources()}, not {expected}", {}, 0.0, ""
    with _TAKEN, _unwatched():
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


@contextmanager
def _unwatched() -> Iterator[None]:
    """Keep dask from looking at the stack of its worker, as it often does: a twentieth of the time of short points."""
    worker = importlib.import_module("distributed").get_worker()
    look = worker.periodic_callbacks.get("profile")
    if look is None:
        yield
        return
    worker.loop.add_callback(look.stop)
    try:
        yield
    finally:
        worker.loop.add_callback(look.start)


def _keep_memory() -> None:
    """Let this process keep the memory of arrays that it has freed for the next ones, as without dask.

    dask starts workers with MALLOC_TRIM_THRESHOLD_, which makes glibc return every large array to the system. A run of
    100 000 samples then takes 3000 page faults, a tenth of its time.
    """
    if sys.platform != "linux":
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        for parameter, size in _KEPT.items():
            mallopt(parameter, size)
