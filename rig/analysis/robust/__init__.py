"""Robust design: controllers, shunts and rigs designed against what is not known of the rig.

stated     what a user asks for, read and checked
box        free values of a design and uncertain ones of a rig, both as unit cubes
growth     matrix, eigenvalues, gradients and growth of a rig of the box
descent    a design improved against a set of rigs: linear programs over eigenvalues; from a rig to a worse one
tasks      the units of work that a pool computes; the worst rig of a design
design     the robust design, the nominal optimum, the audit; the largest ranges that a design can hold
series     components of a series in place of any value
search     design, nominal optimum and scene beside each other; what each value costs; what is proved of the box
certificate
           whether no rig of a box grows: proved, refuted or undecided
in_time    the proof in time: nominal and worst rig as runs, recorded
envelope   the growth of a run
knocked    rigs that begin at steady sliding and are knocked, and the least knock from which they do not come back
result     text, JSON and CSV; its figures; the designed scene as a file
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

from rig.analysis.pool import Progress
from rig.analysis.robust.in_time import Proof, Timed
from rig.analysis.robust.result import RobustResult
from rig.analysis.robust.search import find, proved
from rig.analysis.robust.stated import Job, prepared
from rig.errors import RigError
from rig.record.provenance import provenance

__all__ = ["Job", "RobustResult", "designed", "prepared"]
ROOT = Path("searches")
Bar = Callable[[str], AbstractContextManager[Progress]]
"""Shows the progress of what it is named after."""


def _unseen(what: str) -> AbstractContextManager[Progress]:
    return nullcontext(lambda done, total: None)


def designed(
    job: Job,
    root: Path = ROOT,
    workers: int | None = None,
    bar: Bar = _unseen,
    cluster: str = "",
    prove: bool = False,
    watch: Callable[[str], object] = bool,
) -> RobustResult:
    """Carry out a robust design; results that its folder under `root` contains already are not computed again.

    `prove`: examine the whole box, and run nominal and worst rigs in time. `watch` gets what is done, in words. Raises
    UsageError, SceneError, WorkerError; what is finished stays.
    """
    with bar("batches of rigs") as progress:
        found, folder = find(job, root, workers, progress, cluster)
    if not prove:
        return RobustResult(job, found, provenance(job.seed), folder)
    with bar("proved thousandths of the box") as progress:
        certificate = proved(job, found, root, workers, progress, cluster)
    timed: list[Timed] = []
    untimed = ""
    try:
        proof = Proof(job, found, folder)
        timed = proof.runs(watch)
        with bar("searches of knocks") as progress:
            timed = proof.knocks(timed, workers, progress, watch)
    except RigError as fault:  # the search may have taken hours: its report comes anyway
        untimed = str(fault)
    return RobustResult(job, found, provenance(job.seed), folder, certificate, tuple(timed), untimed)
