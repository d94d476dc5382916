"""Nominal and worst rigs in time: runs after a small knock, their growth, and the least knock that is too large.

Runs whose controllers act are runs in lockstep, with a process for each controller; others are simulated. All are
recorded where runs are recorded. The results of runs are kept beside those of the search: a proof that was interrupted
continues from there.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.analysis.pool import Progress, Store, Work, asking, digest, packed, unpacked
from rig.analysis.robust import knocked
from rig.analysis.robust.envelope import Mode, envelope, slope
from rig.analysis.robust.knocked import Case, Ends, Least, cases, least_knocks
from rig.analysis.robust.search import Findings
from rig.analysis.robust.stated import Job
from rig.analysis.studies.runs import MOST
from rig.bench.run.simulate import simulate
from rig.errors import ExitCode, RigError
from rig.machine.files import RUNS
from rig.model.formulation import signal_rows
from rig.record.provenance import provenance
from rig.record.reader import open as read
from rig.record.run_data import RunData
from rig.record.save_run import save
from rig.results import Column, Table, plain
from rig.scenes.scene import Scene
from rig.stability.linearisation import sliding_key

Array = NDArray[np.float64]
_GROWS = 1e-5  # of the knock at which a contact stops or opens: the begin of a growth,
_DECAYS = 3e-2  # and of a decay
_SMALL = math.log(100.0)  # of the amplitude: so far below a change of a contact the rig counts as linear
_LONG = 5.0  # time constants of a decay that are recorded once its mode is alone,
_GROWN = 15.0  # and of a growth, in which a contact then changes
_WAITED = 3.0  # time constants, the longest wait for a mode to be alone
_LEAST = {True: 20.0, False: 6.0}  # fewest periods of a mode in a run, by whether it is filtered
_MOST = 20_000.0  # and most
_FLOOR = 3.0  # times the envelope at the end of a decay: below it may be noise
_AGREES = 0.02  # of the growth,
_RESOLVED = 0.05  # or of 1 over the evaluated time: a smaller difference is none
_OFFSET = 0.2  # of the knock: a start that is farther from sliding is told
_UNEVEN = 0.05  # of the logarithm of the envelope: a larger deviation from a straight line is told
_DRAWN = 400  # points of an envelope
ROLES = ("velocity", "displacement", "")
"""Outputs whose envelope is evaluated: the first that there is; "": any."""


@dataclass(frozen=True)
class Timed:
    """A run of a design with a rig. `expected`, `hertz`: its eigenvalue [1/s], [Hz]; `growth` [1/s]: measured in time.

    `begin`, `end` [s]: of the evaluated part. `changed`: the first change of a contact [s]. `remark`: why they
    disagree, or what happened. `recording`: its file; `how` it ran. `output`: of which, in `unit_of_output`, `times`
    [s] and `amplitudes` are the envelope. `least`: the least knock.
    """

    design: str
    rig: str
    expected: float
    hertz: float
    growth: float
    begin: float
    end: float
    changed: float
    recording: str
    how: str
    output: str
    unit_of_output: str
    times: list[float]
    amplitudes: list[float]
    remark: str = ""
    least: Least | None = None

    @property
    def name(self) -> str:
        """Design and rig in words."""
        return f"{self.design}, {self.rig} rig"

    @property
    def agrees(self) -> bool:
        """Whether the growth in time is that of the eigenvalue."""
        resolved = _RESOLVED / max(self.end - self.begin, 1e-300)
        return abs(self.growth - self.expected) <= max(_AGREES * abs(self.expected), resolved)


class Proof:
    """The proof in time of what a job has found: first its `runs`, then the `knocks`. `folder`: of the search."""

    def __init__(self, job: Job, found: Findings, folder: Path) -> None:
        self._growth = job.grown()
        self._cases = list(cases(self._growth, found))
        asked = [(case.name, case.values, case.mode.rate, case.unit) for case in self._cases]
        identity = digest(job.scene, repr([asked, job.measure, knocked.SIZES, knocked.EXACT]))
        self._work = Work(knocked.Knocks(self._cases), range(MOST), "in_time", identity)
        self._store = Store.of(self._work, folder)

    def runs(self, watch: Callable[[str], object] = bool) -> list[Timed]:
        """Return a run of each case; `watch` gets what is done, in words. Those that are kept are not run again."""
        timed = []
        with self._store.open(self._work):
            rows = self._store.load()
            for unit, case in enumerate(self._cases):
                kept = Timed(**unpacked(rows[unit])) if unit in rows else None
                if kept is None or not Path(kept.recording).exists():
                    watch(f"run {unit + 1} of {len(self._cases)}: {case.name}")
                    # a name that no other proof has, so that it is the file of an earlier run of this case
                    name = re.sub("[^A-Za-z0-9_-]+", "-", f"{case.scene.name}-{case.name}-{self._work.digest}")
                    kept = in_time(case, RUNS / f"{name}.mcap")
                    self._store.save({unit: packed(asdict(kept))})
                timed.append(kept)
        return timed

    def knocks(
        self,
        timed: Sequence[Timed],
        workers: int | None = None,
        progress: Progress | None = None,
        watch: Callable[[str], object] = bool,
    ) -> list[Timed]:
        """Return the runs with the least knock of each rig. `progress` gets the number of searches that have ended, and
        how many there are at most; `watch` what is done beside them, in words.

        Raises WorkerError.
        """
        say = progress or (lambda done, total: None)
        runs = len(self._cases)
        with asking(self._work, self._store, workers, MOST) as ask:

            def ends(asked: Sequence[tuple[float, ...]]) -> list[Ends]:
                # the numbers of the units are beyond those of the runs, and do not depend on what was asked before
                units = {
                    runs + 4 * int(case) + 2 * bool(within) + (side < 0.0): (case, side, *within)
                    for case, side, *within in asked
                }
                first = min(units, default=runs) - runs
                rows = ask(units, lambda done: say(first + done, 4 * runs))
                return [Ends(*unpacked(row)) for row in rows]

            least = least_knocks(self._growth, self._cases, ends, self._store.folder, watch)
        say(4 * runs, 4 * runs)
        return [replace(run, least=each) for run, each in zip(timed, least)]


def in_time(case: Case, recording: Path) -> Timed:
    """Run a case and record it. Raises KeyboardInterrupt where Ctrl-C has ended the run."""
    mode = case.mode
    scene = case.knocked(_GROWS if mode.rate.real > 0.0 else _DECAYS, _seconds(mode))
    run, how = _ran(scene, recording)
    assembly, at = case.rest
    roles = [(role, name) for role in ROLES for name, each in assembly.outputs.items() if role in ("", each.role)]
    output = assembly.outputs[roles[0][1]]
    over_x, over_t = signal_rows(at.system, at.modes, [output.row])
    still = float((over_x @ at.x + over_t @ at.T)[0])
    times, amplitudes = envelope(run.signals[roles[0][1]] - still, run.step_ns * 1e-9, mode)
    changes = np.flatnonzero((run.mode >= 0) & (run.mode != sliding_key(case.running)))
    changed = float(run.time[changes[0]]) if len(changes) else math.inf
    begin, end = _span(mode, times, amplitudes, changed)
    growth, uneven = slope(times, amplitudes, begin, end)
    stride = max(len(times) // _DRAWN, 1)
    timed = Timed(
        design=case.design,
        rig=case.rig,
        expected=float(mode.rate.real),
        hertz=mode.hertz,
        growth=growth,
        begin=begin,
        end=end,
        changed=changed,
        recording=str(recording),
        how=how,
        output=roles[0][1],
        unit_of_output=output.unit,
        times=times[::stride].tolist(),
        amplitudes=amplitudes[::stride].tolist(),
    )
    what = case.running.describe(int(run.mode[changes[0]])) if len(changes) else ""
    return replace(timed, remark="; ".join(_remarks(timed, case, what, uneven)))


def _seconds(mode: Mode) -> float:
    """How long a case runs [s]."""
    rate = abs(mode.rate.real)
    wanted = (_GROWN if mode.rate.real > 0.0 else _LONG) / max(rate, 1e-300) + _begin(mode)
    if not mode.hertz:
        return wanted
    wanted += 1.0 / mode.hertz
    return min(max(wanted, _LEAST[mode.light] / mode.hertz), _MOST / mode.hertz)


def _begin(mode: Mode) -> float:
    """When the mode is alone [s]."""
    return min(mode.alone, _WAITED / max(abs(mode.rate.real), 1e-300))


def _span(mode: Mode, times: Array, amplitudes: Array, changed: float) -> tuple[float, float]:
    """Begin and end [s] of the part of an envelope in which the mode is alone and the motion small."""
    begin = _begin(mode)
    end = float(times[-1]) if len(times) else 0.0
    if mode.rate.real > 0.0:
        return begin, min(end, changed - _SMALL / mode.rate.real)
    last = amplitudes[-max(len(amplitudes) // 20, 1) :]
    floor = _FLOOR * float(np.median(last)) if len(last) else 0.0
    low = times[(amplitudes <= floor) & (times > begin)]
    return begin, min(end, changed, *low[:1].tolist())


def _ran(scene: Scene, recording: Path) -> tuple[RunData, str]:
    """The run of a scene with all its samples, and how it ran, which is recorded. Raises KeyboardInterrupt.

    Only some of the samples of a run of processes are recorded. They have the bits of a run in one process.
    """
    recording.parent.mkdir(parents=True, exist_ok=True)
    run = simulate(scene, boards=True)
    run.provenance = provenance(scene.seed)
    how = _in_lockstep(scene, recording, run) if scene.controllers else "simulated"
    if how.startswith("simulated"):
        save(run, recording)
    return run, how


def _in_lockstep(scene: Scene, recording: Path, run: RunData) -> str:
    """Run a scene as processes in lockstep; return how it went, compared with a `run` in this process."""
    from rig.bench.live import supervise  # a run in one process needs no bus

    try:
        outcome = supervise.run(scene, pace=None, lockstep=True, out=recording, replace=True, say=lambda text: None)
    except RigError as fault:
        return f"simulated; not in lockstep: {fault}"
    if outcome.exit_code == ExitCode.INTERRUPTED:
        raise KeyboardInterrupt
    if outcome.exit_code not in (ExitCode.DONE, ExitCode.STOPPED):
        return f"simulated; not in lockstep: {'; '.join(outcome.summary['reasons'])}"
    recorded = read(recording)
    at = np.rint(recorded.time * 1e9 / run.step_ns).astype(np.int64)
    same = all(np.array_equal(values, run.signals[name][at]) for name, values in recorded.signals.items())
    return "lockstep" if same else "lockstep, with other values than in one process"


def _remarks(timed: Timed, case: Case, what: str, uneven: float) -> Iterator[str]:
    """What happened in a run, and why the growth in time is not that of the eigenvalue."""
    if math.isfinite(timed.changed):
        yield f"{what} from {timed.changed:.3g} s on"
    if not case.unit:
        yield "its plant states no place for a knock, so that nothing moves it"
    elif not timed.agrees:
        yield "eigenvalue and time disagree: " + ("; ".join(_causes(timed, case, uneven)) or "no cause is known")


def _causes(timed: Timed, case: Case, uneven: float) -> Iterator[str]:
    if math.isnan(timed.growth):
        yield "too few periods of a small motion"
    if case.offset > _OFFSET * _DECAYS:
        yield f"the run begins {100.0 * case.offset:.2g} % of the way to stick away from sliding, as start.* states"
    if math.isfinite(case.mode.slower):
        yield f"a mode at {case.mode.slower:.5g} Hz decays more slowly and does not count here"
    for name, section in case.scene.controllers.items():
        if section.delay % case.scene.frame_ns:
            yield f"the delay of {name} is no whole number of frames, and a run rounds it up"
    if case.scene.network.act or case.scene.network.meas:
        yield "links delay and lose messages, which the eigenvalue leaves out"
    if uneven > _UNEVEN:
        yield "the envelope is uneven: other modes, or noise of sensors"


def table(timed: Sequence[Timed]) -> Table:
    """Return the table of the runs."""
    growths = (Column("eigenvalue", "1/s", ".5g"), Column("at", "Hz", ".5g"), Column("growth in time", "1/s", ".5g"))
    columns = (Column("in time"), *growths, Column("least knock", "N s", ".4g"), Column("run"))
    rows = []
    for run in timed:
        least = run.least.size if run.least is not None else math.nan
        rows.append((run.name, run.expected, run.hertz, run.growth, least, run.how))
    return Table("in_time", columns, plain(rows))


def envelopes(timed: Sequence[Timed]) -> Table:
    """Return the envelopes of all runs, a row for each of their points."""
    columns = (Column("run"), Column("time", "s", ".6g"), Column("amplitude", timed[0].unit_of_output, ".6g"))
    rows: list[tuple[str, float, float]] = []
    for run in timed:
        rows += [(run.name, time, amplitude) for time, amplitude in zip(run.times, run.amplitudes)]
    return Table("envelopes", columns, rows)


def lines(timed: Sequence[Timed]) -> Iterator[str]:
    """Yield what there is to say of the runs and of the least knocks."""
    for run in timed:
        yield "; ".join(filter(None, [f"{run.name}: {run.recording}", run.remark]))
        if run.least is not None:
            yield f"{run.name}, least knock: {run.least.how}"


def facts(timed: Sequence[Timed]) -> list[dict[str, Any]]:
    """Return what JSON has beside the table."""
    return [
        {
            "design": run.design,
            "rig": run.rig,
            "agrees": run.agrees,
            "evaluated": [run.begin, run.end],
            "contact_changes": run.changed,
            "remark": run.remark,
            "recording": run.recording,
            "output": run.output,
            "knock": run.least and run.least._asdict(),
        }
        for run in timed
    ]
