"""What `make bench` measures: groups of figures that are measured together, and the limits of some of them.

The limit of a speed is a ratio to something that is measured in the same run: a C twin, the exact kernel of the
pendulum, scipy, a bare round trip, Python with numpy, two workers apart. So it holds on slower machines too.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from benchmarks import (
    absent,
    against,
    boards,
    branches,
    classroom,
    first_run,
    kernels,
    loop,
    one_contact,
    pages,
    recording,
    remote,
    robust,
    structures,
    studies,
    twins,
    whole_runs,
)
from benchmarks.one_version import CASES as OF_VERSIONS

_VERDICTS = {"VALID": 0.0, "DEGRADED": 1.0, "INVALID": 2.0}


class Asked(NamedTuple):
    """How long measurements take: `quick`, the length [s] of the paced run of the loop, the CSV to import [MB]."""

    quick: bool
    seconds: float
    megabytes: int = 250


class Case(NamedTuple):
    """A figure that has a limit. `name`: its place in the results of its group, keys joined by dots."""

    name: str
    what: str
    limit: float
    unit: str
    at_most: bool = False

    def value(self, results: Any) -> float | None:
        """Return its value; None if it was not measured. Of timing verdicts: 0 VALID, 1 DEGRADED, 2 INVALID."""
        for key in self.name.split("."):
            if not isinstance(results, dict) or key not in results:
                return None
            results = results[key]
        return _VERDICTS[results] if isinstance(results, str) else float(results)

    def margin(self, value: float) -> float:
        """Return how many times better than its limit a value is: at least 1 if it keeps it, infinite without one."""
        better, worse = (self.limit, value) if self.at_most else (value, self.limit)
        return better / worse if worse else float("inf")

    def kept(self, value: float) -> bool:
        """Whether a value keeps the limit."""
        return value <= self.limit if self.at_most else value >= self.limit


class Group(NamedTuple):
    """Figures that are measured together: `measure` returns nested dicts, whose keys end with the unit."""

    title: str
    measure: Callable[[Asked], Any]
    cases: tuple[Case, ...]


def _most(name: str, what: str, limit: float, unit: str) -> Case:
    return Case(name, what, limit, unit, at_most=True)


EXACT = "of the exact kernel"
TWIN = "of the time of C"
GROUPS = {
    "precision": Group(
        "kernels of the pendulum: error of event times (of a period) and real-time factor, samples of 1 ms",
        lambda asked: kernels.precision(),
        (_most("over_exact", "Stribeck pendulum, events to 1e-6 of a period", 5.0, EXACT),),
    ),
    "twins": Group(
        "kernels beside their C twins, gcc -O3 -march=native",
        lambda asked: twins.twins(),
        (
            _most("quiet.ratio", "quiet tick", 1.15, TWIN),
            _most("rk4.ratio", "rk4", 1.15, TWIN),
            _most("exact.ratio", "exact, stiff shunt (3400 Hz at 1 ms)", 1.5, TWIN),
            _most("film.ratio", "film of 40 points", 1.8, TWIN),
            _most("points.ratio", "film of 24 points on 40 modes of a structure", 1.5, TWIN),
            _most("points.s_per_s", "the same at 0.5 us", 1.6, "s of a simulated second"),
            _most("run.ratio", "a whole run in open loop", 2.0, TWIN),
        ),
    ),
    "absent": Group(
        "forces of a rig without products of states, beside a kernel compiled without their source",
        lambda asked: absent.cost(),
        (_most("ratio", "what an absent effect costs", 1.03, "of the time without it"),),
    ),
    "memory": Group(
        "a friction law with memory from a file beside the same law shipped, processor time",
        lambda asked: kernels.memory(5 if asked.quick else 12),
        (_most("ratio", "LuGre's law from a file", 1.05, "of the shipped law"),),
    ),
    "scipy": Group(
        "exact beside scipy's solve_ivp (DOP853, rtol 1e-9, events)",
        lambda asked: kernels.scipy_ratio(),
        (Case("ratio", "exact beside scipy", 200.0, "x faster"),),
    ),
    "whole": Group(
        "the whole rig simulate pendulum: sensors, controller, protocol, outputs kept",
        lambda asked: whole_runs.simulate(3 if asked.quick else 7),
        (_most("over_exact", "rig simulate pendulum", 1000.0, EXACT),),
    ),
    "marginal": Group(
        "a further second of a run, processor time",
        lambda asked: whole_runs.marginal(2 if asked.quick else 5),
        tuple(_most(f"{name}.over_exact", run.title, run.most, EXACT) for name, run in whole_runs.RUNS.items()),
    ),
    "before": Group(
        "stability report of a belt whose friction law has memory, processor time",
        lambda asked: whole_runs.before(3 if asked.quick else 7),
        tuple(_most(f"{law}_s", f"before each run: {law}", 0.1, "s") for law in whole_runs.WITH_MEMORY),
    ),
    "start": Group(
        "new processes, processor time: rig list, rig simulate belt for 0.1 s, a recorder",
        lambda asked: whole_runs.start(5 if asked.quick else 9),
        tuple(
            _most(f"over_numpy.{name}", f"start: {name}", most, "of Python with numpy")
            for name, most in (("list", 2.4), ("simulate", 9.5), ("recorder", 4.2))
        ),
    ),
    "steps": Group(
        f"environment of Gymnasium, {one_contact.DRIVEN}, one frame of 1 ms a step, processor time",
        lambda asked: one_contact.steps(3 if asked.quick else 7),
        (_most("over_frame", "a step of Gymnasium", 6.0, "of a frame of the runner"),),
    ),
    "disc": Group(
        f"{one_contact.DISC} with seven modes: growth rate of the simulation beside the eigenvalue, kernel",
        lambda asked: one_contact.growth(),
        (_most("over_exact", "flexible disc, growth rate to 1e-4", 2000.0, EXACT),),
    ),
    "rubbing": Group(
        "rigs of one contact, kernel without energy balance, processor time",
        lambda asked: one_contact.speed(5 if asked.quick else 10),
        tuple(
            _most(f"{name}.over_exact", rubbing.title, rubbing.most, EXACT)
            for name, rubbing in one_contact.RIGS.items()
        ),
    ),
    "recording": Group(
        "recorder: 10 sensors at 100 kHz in blocks, 8 outputs at 1 kHz; us on the publishing thread in a frame",
        lambda asked: recording.recording(3.0 if asked.quick else 20.0),
        (_most("cores", "recorder", 1.0, "cores"), _most("lost", "recorder, messages lost", 0.0, "messages")),
    ),
    "imports": Group(
        "rig import of a CSV; its size is that of --megabytes",
        lambda asked: recording.imported(asked.megabytes),
        (
            Case("MB_per_core_s", "import of a CSV", 50.0, "MB per second of a core"),
            _most("above_MB", "import of a CSV, memory above that of a small one", 300.0, "MB"),
        ),
    ),
    "loop": Group(
        "loop over the bus: controller, recorder, paced also viewer bridge; short runs beside bare round trips",
        lambda asked: loop.measured(asked.quick, asked.seconds),
        (
            _most("short.over_bare.lockstep", "a tick in lockstep", 1.3, "of a bare round trip"),
            _most("short.over_bare.paced", "paced, put to command", 1.0, "of a bare round trip"),
            _most("paced.over_bare", "the same in the longer run", 2.0, "of a bare round trip"),
            _most("paced.lost", "messages lost", 0.0, "messages"),
            _most("plate.verdict", "plate under a slider, paced: not INVALID", 1.0, "verdict"),
            _most("disc.verdict", "8 points of a squealing disc, two sensors, paced: VALID", 0.0, "verdict"),
        ),
    ),
    "board": Group(
        "a controller on a stand-in for a board by UDP, paced at 1 kHz, in turns with the shipped controller",
        lambda asked: boards.measured(asked.seconds, 1 if asked.quick else 3),
        (
            _most("p99_ratio", "step to command, 99th percentile", 1.5, "of the shipped controller"),
            _most("missed", "steps without an answer", 0.0, "steps"),
            _most("verdict", "VALID", 0.0, "verdict"),
        ),
    ),
    "remote": Group(
        "controller and recorder in another namespace by TLS, paced at 1 kHz, in turns with this host",
        lambda asked: remote.measured(10.0 if asked.quick else 60.0, 1 if asked.quick else 3),
        (
            _most("p99_ratio", "step to command over TLS, 99th percentile", 1.5, "of the unix socket"),
            _most("verdict", "VALID", 0.0, "verdict"),
        ),
    ),
    "classroom": Group(
        f"rig web --share: a paced run at 1 kHz that {classroom.WATCHERS} watchers read, with disturbers",
        lambda asked: classroom.classroom(10.0 if asked.quick else 60.0, disturbed=True),
        (
            _most("verdict", "a run that a class watches: VALID", 0.0, "verdict"),
            Case("pictures_per_s", "worst watcher of a class", 8.0, "pictures/s"),
            _most("delay_s.p99", "delay, worst watcher of a class", 0.25, "s"),
            _most("memory_MB", "memory of the server for each watcher", 3.0, "MB"),
        ),
    ),
    "pages": Group(
        f"rig web: a paced run at 1 kHz with {pages.PAGES} pages without a browser, and one with a page in Chromium",
        lambda asked: pages.pages(10.0 if asked.quick else 30.0),
        (
            _most("sockets.verdict", "a run that ten pages watch: VALID", 0.0, "verdict"),
            _most("browser.verdict", "a run that a page in Chromium watches: VALID", 0.0, "verdict"),
            Case("sockets.pictures_per_s", "pages without a browser", 20.0, "pictures/s"),
            Case("browser.pictures_per_s", "page in Chromium", 20.0, "pictures/s"),
            _most("sockets.delay_s.p99", "delay, pages without a browser", 0.15, "s"),
            _most("browser.delay_s.p50", "delay, page in Chromium, median", 0.06, "s"),
            _most("browser.delay_s.p99", "delay, page in Chromium, 99th percentile", 0.15, "s"),
            _most("browser.layout_share", "layout and style in Chromium", 0.05, "of a core"),
            _most("browser.moving_s", "from Start to the moving rig, in Chromium", 2.0, "s"),
        ),
    ),
    "map": Group(
        f"map of {one_contact.MAP}, run-up and run-down, kernels compiled",
        lambda asked: one_contact.efficiency(24 if asked.quick else 100),
        (Case("efficiency", "map on two cores", 0.95, "of two apart"),),
    ),
    "branches": Group(
        "branches of cycles on one core: 100 points of a belt, 20 points of the lever's boundary over its load",
        lambda asked: branches.measured(asked.quick),
        (
            _most("belt_s", "100 points of a branch of the belt", 10.0, "s"),
            _most("lever_s", "20 points of the lever's boundary", 60.0, "s"),
        ),
    ),
    "studies": Group(
        "studies on one worker, two, and two of dask, in turns",
        lambda asked: studies.measured(asked.quick),
        (
            *(
                Case(f"{what}.{workers}.efficiency", f"study of {title}, two workers{of}", floor, "of two apart")
                for what, title in (("P1", "a rig"), ("loop", "a closed loop"))
                for workers, of, floor in (("two", "", 0.95), ("dask", " of dask", 0.92))
            ),
            _most("empty_ms", "a point that computes nothing", 1.0, "ms"),
        ),
    ),
    "identify": Group(
        "rig identify: four parameters of the belt, three runs of 6 s, two workers",
        lambda asked: studies.identified(),
        (_most("fit_s", "fit of four parameters", 15.0, "s"),),
    ),
    "robust": Group(
        "a robust design of the shunt of the brake: four free and four uncertain values, two workers, audit included",
        lambda asked: robust.measured(),
        (_most("design_s", "robust design of a shunt, audit included", 120.0, "s"),),
    ),
    "structure": Group(
        "reduction of a structure of 100,000 degrees of freedom: seconds, MB, error",
        lambda asked: structures.measure(asked.quick),
        (
            _most("true_error", "structure of 100,000 rows, error of its first mode", 1e-6, "of the eigenvalue"),
            _most("sweep_ratio", "100 friction values of 85 coordinates", 3.0, "times their eigenvalues by scipy"),
            _most("point_ms", "eigenvalues of a structure at a point, 120 vectors", 15.0, "ms of processor time"),
            _most("point_ratio", "eigenvalues of a structure at a point, 120 vectors", 0.95, "times numpy.linalg.eig"),
        ),
    ),
}
"""By name: an option of the command takes a group alone."""


def versions(commit: str) -> Group:
    """Return the comparison with another version of the sources. Raises UsageError if git does not know it."""
    checkout = against.unpacked(commit)
    return Group(
        f"speed over that of {commit}: processor time, {against.PAIRS} pairs of processes, {against.ROUNDS} rounds",
        lambda asked: against.compared(checkout) | {"first": {} if asked.quick else first_run.compared(checkout)},
        (
            *(
                Case(f"{name}.speed", name, against.FLOOR if case.method else 0.0, "of the speed there")
                for name, case in OF_VERSIONS.items()
            ),
            *(
                _most(f"first.{run}.{clock}", f"{run} with nothing compiled, {clock}", 1.05, "of the time there")
                for run in (*first_run.SCENES, "both", "warmup")
                for clock in ("wall", "processor")
            ),
        ),
    )
