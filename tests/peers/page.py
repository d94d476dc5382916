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
RACES = (("Coulomb friction", "p1", 1e-6), ("friction that falls", "p2", 1e-6))


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
    """The problems of others: one row each, with error and time of both sides; of each program its nearest answer."""
    rows = []
    for problem in PROBLEMS.values():
        exact, ours = problem.exact(), problem.ours()
        theirs = [f"{name}: {number(abs(v - exact))}, published" for name, v in problem.stored.items()]
        for other in OTHERS:
            if PROBLEMS[other.problem] is problem and other.available():
                value, seconds = min((other.answer(step) for step in other.steps), key=lambda a: abs(a[0] - exact))
                theirs.append(f"{other.name} ({other.version()}): {number(abs(value - exact))} in {number(seconds)} s")
        what = f"{problem.measure}: {exact:.12g} {problem.unit} ({problem.by})"
        own = f"{number(abs(ours.value - exact))} in {number(ours.seconds)} s"
        rows.append((f"{problem.title} ({problem.source})", what, own, "; ".join(theirs)))
    yield from table(("problem", "exact value", "error of friction-rig", "error of others"), rows)


def races() -> Iterator[str]:
    """Mass on a belt by all solvers, at equal errors of the times of mode changes."""
    rows = []
    for title, name, target in RACES:
        entries = race(rig.load(ROOT / "tests" / "problems" / f"{name}.toml"))
        ours, *best = cheapest(entries, target)
        for entry in (entry for entry in best if entry.error <= target):
            faster = f"{ours.factor / entry.factor:.3g}"
            rows.append((title, entry.peer, entry.setting, number(entry.error), faster))
        exact = min((entry for entry in entries if entry.peer == OURS), key=lambda entry: entry.error)
        for entry in [entry for entry in entries if entry.peer == "heyoka" and not entry.fault][-1:]:  # its tightest
            factor = f"{exact.factor / entry.factor:.3g}"
            rows.append((f"{title}, least error of both", entry.peer, entry.setting, number(entry.error), factor))
    yield from table(("problem", "solver", "its setting", "its error", "friction-rig is faster by"), rows)


def other_races() -> Iterator[str]:
    """Races beyond a mass on a belt."""
    rows = [(r.what, r.who, number(r.error), f"{r.figure:.3g} {r.unit}") for measure in RACES_BEYOND for r in measure()]
    yield from table(("case", "program", "relative error", "figure"), rows)


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
    measure = f"{seconds:g} s of slip without an event at 1e-12 (difference {abs(a - b):.0e} m)"
    return Better(measure, "heyoka", quick, slow, why)


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
    why = "ours examines the stability of every mode set first, whatever the length"
    return Better("1 s of a block on a slope, preparation included", "MuJoCo", theirs, ours, why)


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


TEXT = """# Other programs, compared

Test problems of other programs, solved by friction-rig and by the programs that are installed, on one machine, in
turns. The exact value of each problem comes from a closed form or from an integration that is written out in
tests/peers/problems.py. An error has the unit of the exact value. Times are processor times; ours are those of the
whole call, with the check of stability before it.

```
pip install -e '.[peers]'             # siconos is a package of Debian: python3-siconos
python -m pytest -m peers tests/peers # solves and checks all of it
python tests/peers/page.py            # measures again and writes this page
```

## How near to the exact value
"""
EQUAL = """Mass on a belt that sticks and slips for 4 s, a state every millisecond, each solver at its cheapest setting
whose error of the times at which stick begins and ends is at most 1e-6 of a period."""
LOADS = """Processor time of one core; the loop between two processes in wall time. The error of the disc is that of the
slider's place, as a share of its range; that of the map is the difference up to which cycles count as the same."""


def main() -> None:
    """Write the page."""
    machine = provenance(0, ("page.py",))
    load = f"load {os.getloadavg()[2]:.0f} in the last 15 minutes"
    where = ", ".join(f"{key} {machine[key]}" for key in ("date", "processor", "cores", "python", "numpy", "scipy"))
    parts = (TEXT, *values(), "## Speed at equal error", "", EQUAL, "", *races())
    parts += ("## Other loads", "", LOADS, "", *other_races())
    lines = [*parts, "## Where another is better", "", *better(), f"Measured on: {where}, {load}."]
    write_file(ROOT / "docs" / "peers.md", ("\n".join(lines) + "\n").encode())


if __name__ == "__main__":
    main()
