"""docs/peers.md, made again: `python tests/peers/page.py` with the extra `peers`; what is not installed is left out.

The programs run alternately with this one on the same machine. Times are processor times of a run without preparation;
ours are the shortest of several, of the whole call unless stated.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

from other_races import RACES as RACES_BEYOND
from others import OTHERS, mujoco_slope
from problems import HERE, PROBLEMS, at_end, timed
from race import OURS, cheapest, race

import rig
from rig.machine.files import write_file
from rig.model.friction_law import stribeck
from rig.motion.motion import Motion
from rig.record.provenance import provenance

ROOT = HERE.parents[1]
RACES = (
    ("P1: Coulomb friction", "p1", (1e-2, 1e-6, 2e-9), "exact"),
    ("P2: friction that falls", "p2", (1e-6, 2e-9), "dopri5"),
)


class Better(NamedTuple):
    """A case in which another is better: what is measured, the other's name, its value and ours [s], and why."""

    case: str
    other: str
    theirs: float
    ours: float
    why: str


def number(value: float) -> str:
    """An error or a time in a table."""
    return "0" if value == 0.0 else "" if math.isnan(value) else f"{value:.1e}"


def table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> list[str]:
    """A table in Markdown."""
    return ["| " + " | ".join(row) + " |" for row in (head, ("---",) * len(head), *rows)] + [""]


def values() -> Iterator[str]:
    """The problems of others: error and time of both sides."""
    for problem in PROBLEMS.values():
        exact, ours = problem.exact(), problem.ours()
        yield from (
            f"### {problem.title}",
            "",
            f"{problem.source}. {problem.measure.capitalize()}: **{exact:.12g} {problem.unit}** ({problem.by}).",
            "",
        )
        rows = [("friction-rig", problem.how, number(abs(ours.value - exact)), number(ours.seconds))]
        if not math.isnan(ours.alone):
            rows.append(("friction-rig", "the run alone", number(abs(ours.value - exact)), number(ours.alone)))
        rows += [(name, "published", number(abs(v - exact)), "") for name, v in problem.stored.items()]
        for other in OTHERS:
            if PROBLEMS[other.problem] is problem and other.available():
                for step in other.steps:
                    value, seconds = other.answer(step)
                    name = f"{other.name} ({other.version()})"
                    rows.append((name, f"{other.setting} {step:g}", number(abs(value - exact)), number(seconds)))
        yield from table(("program", "setting", f"error [{problem.unit}]", "processor time [s]"), rows)


def races() -> Iterator[str]:
    """Mass on a belt by all solvers, at equal errors of the times of mode changes."""
    for title, name, targets, method in RACES:
        entries = race(rig.load(ROOT / "tests" / "problems" / f"{name}.toml"))
        rows, near = [], set()
        for target in targets:
            ours, *best = cheapest(entries, target)
            for entry in (entry for entry in best if entry.error <= target):
                ratio = ours.factor / entry.factor
                near |= {entry.peer} if ratio < 10.0 else set()
                rows.append((f"{target:g}", entry.peer, entry.setting, number(entry.error), f"{ratio:.3g}"))
        exact = min((entry for entry in entries if entry.peer == OURS), key=lambda entry: entry.error)
        for entry in [entry for entry in entries if entry.peer == "heyoka" and not entry.fault][-1:]:  # its tightest
            factor = f"{exact.factor / entry.factor:.3g}"
            rows.append(("least of both", entry.peer, entry.setting, number(entry.error), factor))
        yield from (f"### {title}", "")
        yield from table(("error at most", "solver", "its setting", "its error", "friction-rig is faster by"), rows)
        yield from ([f"Less than ten times: {', '.join(sorted(near))}.", ""] if near else [])
        yield from (parts(name, method), "")


def other_races() -> Iterator[str]:
    """Races beyond a mass on a belt."""
    for measure in RACES_BEYOND:
        rows = [(r.what, r.who, number(r.error), f"{r.figure:.3g} {r.unit}") for r in measure()]
        yield from table(("case", "program", "relative error", "figure"), rows)


def parts(name: str, method: str, seconds: float = 4.0) -> str:
    """What our own run consists of: its time with a state every millisecond, every 0.1 ms, and every 20 ms."""
    system = rig.load(ROOT / "tests" / "problems" / f"{name}.toml").assemble().system()
    spent, events = [], 0
    for step_ns in (1_000_000, 100_000, 20_000_000):
        ticks = round(seconds * 1e9 / step_ns)
        motion = Motion(system, step_ns, method, with_energy=False, longest=ticks)

        def run(motion: Motion = motion, ticks: int = ticks) -> float:
            motion.x[:] = system.start
            motion.advance(ticks)
            return 0.0

        spent.append(1e6 * min(timed(run)[1] for _ in range(20)))
        events = motion.event_count
    state = (spent[1] - spent[0]) / (9e3 * seconds)
    return (
        f"A run of ours with `{method}` takes {spent[0]:.0f} us: {1e3 * seconds * state:.0f} us for {1e3 * seconds:g} "
        f"states ({1e3 * state:.1f} ns each), the rest for steps and {events} events; with a state every 20 ms "
        f"{spent[2]:.0f} us."
    )


def smooth(seconds: float = 20.0) -> Better:
    """A mass in slip all the time, by heyoka and by dop853 at its best."""
    import heyoka as hy

    law, load, k, v0 = (0.4, 0.25, 0.5), 10.0, 1000.0, 2.0
    x, v = hy.make_vars("x", "v")
    mu = law[1] + (law[0] - law[1]) * hy.exp((v - v0) / law[2])
    solver = hy.taylor_adaptive([(x, v), (v, mu * load - k * x)], [0.0, 0.0], tol=1e-15)

    def theirs() -> float:
        solver.time, solver.state[:] = 0.0, (0.0, 0.0)
        solver.propagate_until(seconds)
        return float(solver.state[0])

    changes = {
        "body.mass": 1.0,
        "body.stiffness": k,
        "body.damping": 0.0,
        "load.force": load,
        "drive.speed": v0,
        "friction.mu_static": law[0],
        "friction.mu_dynamic": law[1],
        "friction.speed_scale": law[2],
        "start.velocity": 0.0,
        "limits": "none",
    }
    system = rig.load("belt", changes).assemble().system()
    assert stribeck(*law).mu(1.0) == system.patches[0].law.mu(1.0)
    ticks = round(seconds * 1e3)
    motion = Motion(system, 1_000_000, "dop853", tolerance=1e-12, with_energy=False, longest=ticks)

    def ours() -> float:
        motion.x[:] = system.start
        motion.advance(ticks)
        return float(motion.x[0])

    (a, slow), (b, quick) = timed(ours), timed(theirs)
    why = "a Taylor series of order 18 needs few steps where nothing happens; ours has order 8"
    return Better(
        f"{seconds:g} s of slip without an event at 1e-12 (difference {abs(a - b):.0e} m)", "heyoka", quick, slow, why
    )


def first_result() -> Better:
    """The first result in a new process."""
    code = (
        "from scipy.integrate import solve_ivp; solve_ivp(lambda t, y: [y[1], -y[0]], (0, 1), [0, 1])",
        "import rig; rig.simulate('belt', duration=1)",
    )
    spent = []
    for line in code:
        spent.append(min(_process(line) for _ in range(3)))
    return Better("first result in a new process", "scipy", *spent, "no compiler and no scene to load")


def _process(line: str) -> float:
    import resource

    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", line], check=True, timeout=300, cwd=ROOT)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def short_call() -> Better:
    """A short motion of one contact by one call, preparation included."""
    begin = time.process_time()
    mujoco_slope(1e-3)
    theirs, ours = time.process_time() - begin, at_end("slope", "displacement")().seconds
    return Better(
        "1 s of a block on a slope, preparation included",
        "MuJoCo",
        theirs,
        ours,
        "ours examines the stability of every mode set first, whatever the length",
    )


BETTER: tuple[tuple[str, Callable[[], Better]], ...] = (
    ("heyoka", smooth),
    ("scipy", first_result),
    ("mujoco", short_call),
)


def better() -> Iterator[str]:
    """Cases in which another is better."""
    import importlib.util

    rows = []
    for package, measure in BETTER:
        if importlib.util.find_spec(package):
            b = measure()
            rows.append((b.case, b.other, number(b.theirs), number(b.ours), b.why))
    yield from table(("case", "program", "its time [s]", "ours [s]", "why"), rows)


EQUAL = """Mass on a belt that sticks and slips for 4 s with a state every millisecond; the error is that of the times
at which stick begins and ends, as a share of a period. The solvers take turns; processor time, the shortest run."""
LOADS = """Processor time of one core, but the paced loop in wall time, which other programs lengthen (load, below). The
error of the disc is that of the slider's place, of its range; that of the map the difference up to which cycles count
as the same, and for scipy the error of the period after twelve cycles. Our two processes of the paced loop ask for
real-time scheduling; those of the socket do not. Where ours is less than ten times as fast, a line says why: the loop
without its controller in Python, the bus alone."""
TEXT = """# The tests of others

Values that other projects use to test themselves or to show what they can do, answered by this one, and by those
projects where they are installed. Each problem is a scene in tests/peers; the exact value comes from a closed form or
from an integration that is written out in tests/peers/problems.py. `python -m pytest -m peers tests/peers` asks all of
it again.

```
pip install -e '.[peers]'             # siconos is a package of Debian: python3-siconos
python tests/peers/page.py            # makes this page again
```
"""


def main() -> None:
    """Write the page."""
    machine = provenance(0, ("page.py",))
    load = f"load {os.getloadavg()[2]:.0f} in the last 15 minutes"
    where = ", ".join(f"{key} {machine[key]}" for key in ("date", "processor", "cores", "python", "numpy", "scipy"))
    parts = (TEXT, "## Values", "", *values(), "## Speed at equal error", "", EQUAL, "", *races())
    parts += ("## Other loads", "", LOADS, "", *other_races())
    lines = [*parts, "## Where another is better", "", *better(), f"Measured on: {where}, {load}."]
    write_file(ROOT / "docs" / "peers.md", ("\n".join(lines) + "\n").encode())


if __name__ == "__main__":
    main()
