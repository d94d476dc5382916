"""Forty faults put into `rig.solve` and `rig.model`, one at a time: the nearest tests have to fail under each.

    python -m tests.mutants [--only N ...]

Each is applied to a copy of the project, in which its tests then run. The exit code is 1 if a mutant survives.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
CHANGE = re.compile(r"\{(.*?) ?=> ?(.*?)\}", re.DOTALL)
_MOST_S = 1800.0  # a mutant whose tests take longer does not end


class Mutant(NamedTuple):
    """A fault: the module; its text, which occurs once, with {what stands there => what it becomes}; the tests."""

    module: str
    text: str
    tests: str

    @property
    def path(self) -> str:
        """The file of the module."""
        return f"rig/{self.module}.py"

    def side(self, which: int) -> str:
        """The text before (0) or after (1)."""
        return CHANGE.sub(lambda change: change[which + 1], self.text)


MUTANTS = [
    Mutant(*row)
    for row in (
        # methods: tableaus, tolerance, exponentials
        ("solve/dopri5", "49 / {176 => 175}, -5103 / 18656)", "solve/test_convergence"),
        ("solve/dopri5", "{-1453857185 => 1453857185} / 822651844", "solve/test_convergence"),
        ("solve/dopri5", "SHARE = {0.7 => 70.0}", "solve/test_convergence"),
        ("solve/rk4", "WEIGHTS = ({1.0, 2.0, 2.0, 1.0 => 1.5, 2.0, 2.0, 0.5})", "solve/test_convergence"),
        ("solve/expm", "E[i, j] = 2.0 * E[i, j] {+ => -} square[i, j]", "solve/test_expm"),
        ("solve/expm", "w = (k * w {- => +} 1.0) / x", "solve/test_pole_response"),
        ("solve/expm", "r * (1.0 / {5040.0 => 504.0})", "solve/test_lanes"),
        # events: location, certificates, stick and slip, sectors
        ("solve/roots", "lowest += {min => max}(c[k], 0.0)", "solve/test_roots"),
        ("solve/roots", "if size {<= zero => < 0.0}:", "solve/test_roots"),
        ("solve/exact", "and g[k] > {bound and after > bound => 0.0 and after > 0.0}", "solve/test_reference_problems"),
        ("solve/exact", "ends < -steepest{ and after > 0.0 => }:", "solve/test_stick"),
        ("solve/contact_state", "if abs(need) > {limit * (1.0 + slack) => 2.0 * limit}:", "solve/test_stick"),
        ("solve/contact_state", "x[t.turn[owner]] -= {t => 0.5 * t}.edges[owner, count]", "solve/test_sectors"),
        # forces, energy, films
        ("solve/forces", "p[0] *{ p[1] * => } fall * fall", "plants/test_seal"),
        ("solve/forces", "return -p[1]{ if p[0] - p[1] * v > p[2] else 0.0 => }", "plants/test_friction_laws"),
        ("solve/exact", "scale = w.weights[q] *{ reach * => } length", "solve/test_energy"),
        (
            "solve/film_steps",
            "k[i] * {max(deep[i], 0.0) => deep[i]}\n            opened += int((normal",
            "solve/test_film",
        ),
        ("solve/film_steps", "speeds[i] += {kick[i] => 2.0 * kick[i]} * forces[i]", "solve/test_film"),
        # instruments and controllers
        ("solve/sampling", "s.warmth * (left {- => +} np.exp", "sensors/test_flaws"),
        ("solve/sampling", "due = sample_instant(s, s.taken){ - delay => }\n        now", "sensors/test_flaws"),
        ("solve/control_loop", "= now + controller.delay{ => + 1}, now, 0", "loop/test_inside"),
        # a mode set: matrices, load vectors, guards
        ("model/formulation", "{contacts.sigma[p] * => 1.0 *} contacts.mu[p] * loads[k]", "solve/test_stick"),
        ("model/formulation", "limit += law.towards(sign).{static => numbers[0]} * loads[k]", "solve/test_stick"),
        ("model/formulation", "Me {- => +}= np.outer(d, system.normals[k].inertia)", "solve/test_mode_sets"),
        ("model/formulation", "landing[v] {+ => -}= MT @", "solve/test_singular"),
        ("model/formulation", "guard(-below if mode == records.{LOW => HIGH} else -above", "solve/test_limiters"),
        ("model/formulation", "system.damping{ + change.damping => }", "plants/test_brake_turn"),
        ("model/formulation", "scales[:, None, {1: => :-1}]", "solve/test_segments"),
        ("model/mode_sets", "_MARGIN = {1.25 => 0.6}", "test_theory_parts"),
        ("model/mode_sets", "np.array([law.{static => numbers[0]} for law in met])", "solve/test_stick"),
        ("model/products", "{-np => np}.sin(angle) * factor.row", "solve/test_products"),
        ("model/system", "% {self.period => 1e9}", "solve/test_sectors"),
        # friction laws, energy forms, tables of films and of many states
        ("model/friction_law", "Law(mixed{ + film * offset**0.5 => }, SEAL", "plants/test_seal"),
        ("model/friction_law", "float(values[{-1 => 0}])]", "plants/test_friction_laws"),
        ("model/energy_forms", "{Phi.T @ => } out[level + 1] @ Phi", "solve/test_energy"),
        ("model/energy_forms", "out += {limiter.excess => 0.0} * np.outer(beyond, beyond)", "plants/test_shunt"),
        ("model/workspace", "[{1.0, 0.0, 4.0, 0.0, 1.0 => 1.5, 0.0, 3.0, 0.0, 1.5}]", "solve/test_energy"),
        ("model/film_tables", "step * step / {12.0 => 6.0}", "plants/test_plate"),
        ("model/many_states_tables", "{(1 if i == 0 else 2) => 2}", "plants/test_brake"),
        ("model/many_states_tables", "margin = {MARGIN => 0.0} *", "test_theory_parts"),
    )
]


def killed(mutant: Mutant, copy: Path) -> str:
    """How the tests fail under a mutant of the project in `copy`; "" if they pass."""
    path, kernels = copy / mutant.path, copy.parent / "kernels"
    whole = path.read_text()
    path.write_text(whole.replace(mutant.side(0), mutant.side(1)))
    own = {"PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1", "OPENBLAS_NUM_THREADS": "1"}
    if mutant.module.startswith("solve"):  # the kernels of the other mutants are those of the project
        kernels.mkdir(mode=0o700)
        own["RIG_KERNELS"] = str(kernels)
    tests = [f"tests/{name}.py" for name in mutant.tests.split()]
    command = [sys.executable, "-m", "pytest", "-xq", "-p", "no:cacheprovider", "-o", "timeout=0", *tests]
    try:
        ended = subprocess.run(
            command, cwd=copy, env=os.environ | own, capture_output=True, text=True, timeout=_MOST_S, check=False
        )
    except subprocess.TimeoutExpired:
        return "it does not end"
    finally:
        path.write_text(whole)
        shutil.rmtree(kernels, ignore_errors=True)
    if ended.returncode > 1:
        raise SystemExit(f"{mutant.module}: the tests cannot run\n{ended.stdout}{ended.stderr}")
    failed = [line.split(" - ")[0] for line in ended.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return " ".join(failed) if ended.returncode else ""


def main() -> int:
    """Run the mutants and print how each was killed."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--only", type=int, nargs="*", default=range(1, len(MUTANTS) + 1), metavar="N")
    survivors = []
    only = parser.parse_args().only
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "project"
        shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(".git", ".venv", "__pycache__", "build", ".*_cache"))
        for number in only:
            mutant, begin = MUTANTS[number - 1], time.perf_counter()
            how = killed(mutant, copy)
            survivors += [] if how else [number]
            took = time.perf_counter() - begin
            print(f"{number:3} {took:5.0f} s  {mutant.module}: {mutant.text!r}  {how or 'SURVIVES'}", flush=True)  # noqa: T201
    print(f"{len(only) - len(survivors)} of {len(only)} killed; survivors: {survivors or 'none'}")  # noqa: T201
    return 1 if survivors else 0


if __name__ == "__main__":
    sys.exit(main())
