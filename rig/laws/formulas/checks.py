"""What is wrong with a friction law from elsewhere, at the values that it has: each fault is a line.

finite        coefficient, rates and derivatives, over slip speeds up to 100 m/s and loads
passive       mu w >= 0 in (steady) slip; with deflections, no closed loop of the slip gives energy
continuous    mu jumps only where the law says so (`jumps`); at rest at least its value in slow slip
derivatives   those that the law states are those of its formulas
steady slip   the rates of the internal states become zero
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.model.friction_law import FASTEST, Formula, from_formula

Array = NDArray[np.float64]
SPEEDS = np.geomspace(1e-9, FASTEST, 111)
"""Slip speeds [m/s] at which a law without internal states is checked, beside 0."""
_CLOSE = np.geomspace(1e-6, FASTEST, 20_001)
"""Slip speeds [m/s], 0.1 % apart, at which its coefficient is checked to be finite."""
_FEW = np.geomspace(1e-7, 100.0, 6)  # m/s; slip speeds at which a law with internal states is checked
_LOADS = (1e-2, 1.0, 1e3)  # N
_STEP = 1e-6  # difference step, relative
_NEAR = 2e-5  # allowed difference of a derivative, relative
_ROUND = 1e-8  # rounding of mu, relative
_PAIRS = 8  # most suspicious pairs of speeds
_HALVINGS = 45  # of the interval between the two speeds of a pair
_JUMP = 1e-7  # smallest jump of mu, relative
_STEADY = 1e-6  # of the rate at the start
_CYCLES = 3  # periods of a loop
_STEPS = 80  # steps of a period
_GIVEN = 2e-3  # allowed share of the energy of a loop
_NEWTON = 12  # most iterations of an implicit step
_CONVERGED = 1e-9  # relative change in the last iteration


def faults(formula: Formula, numbers: Sequence[float], rest: float, jumps: Sequence[float]) -> Iterator[str]:
    """The faults of a law with these `numbers`; `rest`: its static coefficient."""
    if formula.states:
        yield from _with_memory(formula, numbers)
    else:
        yield from _over_speed(formula, numbers, rest, jumps)


def _at(w: float, load: float | None = None) -> str:
    return f"at w = {w:.3g} m/s" + ("" if load is None else f", N = {load:g} N")


def _over_speed(formula: Formula, numbers: Sequence[float], rest: float, jumps: Sequence[float]) -> Iterator[str]:
    none = np.zeros(0)

    def both(w: float) -> tuple[float, float]:
        values, slopes = formula.evaluate(numbers, w, 1.0, none)
        return float(values[0]), float(slopes[0, 0])

    speeds = [0.0, *SPEEDS.tolist()]
    mu, slope = np.array([both(w) for w in speeds]).T
    for name, values in (("mu", mu), ("slope", slope)):
        if not np.isfinite(values).all():
            i = int(np.argmin(np.isfinite(values)))
            yield f"{name} is {values[i]:g} {_at(speeds[i])}; it must be finite from 0 to 100 m/s"
    if not (np.isfinite(mu).all() and np.isfinite(slope).all()):
        return
    close = from_formula(rest, numbers, formula).over(_CLOSE)
    if not np.isfinite(close).all():
        i = int(np.argmin(np.isfinite(close)))
        yield f"mu is {close[i]:g} {_at(float(_CLOSE[i]))}; it must be finite from 0 to 100 m/s"
        return
    size = float(np.abs(mu).max())
    if mu.min() < 0.0:
        i = int(np.argmin(mu))
        yield f"mu is {mu[i]:.4g} {_at(speeds[i])}: friction would drive the slip; it must be at least 0"
    if not math.isfinite(rest):
        yield f"the static coefficient is {rest:g}; it must be finite"
    slow = mu[1] if 0.0 in jumps else mu[0]
    if rest < slow - _JUMP * size:
        yield (
            f"the static coefficient is {rest:.4g}, below mu = {slow:.4g} in slow slip: a contact that begins "
            "to slip would stick again immediately; give at least the same value"
        )
    undeclared = []
    for w in _jumps(both, speeds, mu, slope, size):
        if not any(_close(w, jump) for jump in jumps):
            undeclared.append(w)
    for w in undeclared:
        remedy = "make it continuous, or declare it: jumps = (SPEED, ...)"
        if w == 0.0:
            remedy = "return the static coefficient from static(self), and let mu begin with its value in slow slip"
        yield f"mu jumps {_at(w)}; {remedy}"
    worst = 1.0
    told = ""
    for w in SPEEDS.tolist()[20:]:
        if not any(_close(w, jump, 0.1) for jump in (*jumps, *undeclared)):
            stated = both(w)[1]
            excess, differences = _excess(lambda v: both(v)[0], w, stated, _STEP * w, size)
            if excess > worst:
                worst = excess
                told = f"slope gives {stated:.5g} s/m {_at(w)}, differences of mu {differences:.5g} s/m"
    if told:
        yield f"{told}; correct slope(p, w)"


def _close(w: float, jump: float, near: float = 1e-6) -> bool:
    return abs(w - jump) <= near * max(abs(w), abs(jump)) + 1e-12


def _excess(value: Any, at: float, stated: float, h: float, size: float) -> tuple[float, float]:
    """How far a stated derivative is from differences, in tolerances; and that of central differences.

    At a kink the difference to one side counts.
    """
    ahead = value(at + h)
    here = value(at)
    behind = value(at - h)
    central = (ahead - behind) / (2.0 * h)
    allowed = _NEAR * max(abs(stated), abs(central)) + _ROUND * size * _STEP / abs(h) + 1e-300
    sides = (central, (ahead - here) / h, (here - behind) / h)
    excess = min(abs(side - stated) for side in sides) / allowed
    return (excess if math.isfinite(excess) else math.inf), central


def _jumps(both: Any, speeds: Sequence[float], mu: Array, slope: Array, size: float) -> Iterator[float]:
    """Speeds at which mu jumps, in ascending order: where halving an interval does not make the change smaller."""
    widths = np.diff(speeds)
    unexplained = np.abs(np.diff(mu) - 0.5 * widths * (slope[1:] + slope[:-1]))
    for i in sorted(np.argsort(unexplained)[-_PAIRS:].tolist()):
        low, high = speeds[i], speeds[i + 1]
        at_low = both(low)
        at_high = both(high)
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            at_middle = both(middle)
            below = _unexplained(at_low, at_middle, middle - low)
            above = _unexplained(at_middle, at_high, high - middle)
            if below >= above:
                high = middle
                at_high = at_middle
            else:
                low = middle
                at_low = at_middle
        if abs(at_high[0] - at_low[0]) > _JUMP * size:
            yield 0.0 if low == 0.0 else high


def _unexplained(at_low: tuple[float, float], at_high: tuple[float, float], width: float) -> float:
    """The part of the change of mu that its slopes at both ends of an interval do not explain."""
    mu_low, slope_low = at_low
    mu_high, slope_high = at_high
    return abs(mu_high - mu_low - 0.5 * width * (slope_low + slope_high))


def _with_memory(formula: Formula, numbers: Sequence[float]) -> Iterator[str]:
    states = formula.states
    m = len(formula.states)
    start = np.array([state.start for state in states])
    steady: dict[tuple[float, float], Array] = {}
    told = set[str]()

    def once(kind: str, line: str) -> Iterator[str]:
        if kind not in told:
            told.add(kind)
            yield line

    for load in _LOADS:
        for w in (0.0, *_FEW.tolist()):
            values, slopes = formula.evaluate(numbers, w, load, start)
            for name, entries in (("mu, a rate or stored", values), ("an entry of slopes", slopes)):
                if not np.isfinite(entries).all():
                    yield from once(name, f"{name} is not finite {_at(w, load)}, in the states at the start")
            if w == 0.0 or told:
                continue
            try:
                z = formula.steady(numbers, w, load)
            except np.linalg.LinAlgError:
                z = np.full(m, math.nan)
            values, slopes = formula.evaluate(numbers, w, load, z)
            first = formula.evaluate(numbers, w, load, start)[0]
            size = np.abs(first[1 : m + 1]) + np.abs(slopes[1:, 2:]) @ np.abs(z) + 1e-300
            if not (np.isfinite(z).all() and (np.abs(values[1 : m + 1]) <= _STEADY * size).all()):
                rates = ", ".join(f"{state.name}' = {rate:.3g}" for state, rate in zip(states, values[1:]))
                yield from once(
                    "steady", f"there is no steady slip {_at(w, load)}: {rates}; every rate must become zero"
                )
            elif values[0] < -1e-9 * max(abs(first[0]), 1.0):
                fault = f"mu is {values[0]:.4g} in steady slip {_at(w, load)}"
                yield from once("drives", f"{fault}: friction would drive the slip; it must be at least 0")
            else:
                steady[w, load] = z
    if told:
        return
    yield from _slopes_of_memory(formula, numbers, start, steady)
    if any(state.along for state in states):
        yield from _loops(formula, numbers, start, steady)


def _slopes_of_memory(
    formula: Formula, numbers: Sequence[float], start: Array, steady: dict[tuple[float, float], Array]
) -> Iterator[str]:
    """Derivatives at states between those at the start and those of steady slip."""
    m = len(start)
    rows = ["mu", *(f"the rate of {state.name}" for state in formula.states)]
    columns = ["w", "N", *(state.name for state in formula.states)]
    worst = 1.0
    told = ""
    for (w, load), ahead in list(steady.items())[::2]:
        for share in (0.3, 0.9):
            z = start + share * (ahead - start)
            at = np.array([w, load, *z])
            sizes = np.array([w, load, *np.maximum(np.abs(z), np.abs(ahead))])

            def value(v: Array) -> Array:
                return formula.evaluate(numbers, v[0], v[1], v[2:])[0][: m + 1]

            stated = formula.evaluate(numbers, w, load, z)[1]
            here = value(at)
            for j in range(m + 2):
                h = _STEP * sizes[j]
                if h == 0.0:
                    continue
                step = np.zeros(m + 2)
                step[j] = h
                above = value(at + step)
                below = value(at - step)
                for i in range(m + 1):
                    size = abs(here[i]) + float(np.abs(stated[i]) @ sizes)
                    seen = {0.0: here[i], h: above[i], -h: below[i]}
                    excess, central = _excess(lambda v, seen=seen: seen[v], 0.0, stated[i, j], h, size)
                    if excess > worst:
                        worst = excess
                        entry = f"d[{i}, {j}], the derivative of {rows[i]} with respect to {columns[j]}"
                        values = f"is {stated[i, j]:.5g} {_at(w, load)}; differences give {central:.5g}"
                        told = f"slopes: {entry}, {values}"
    if told:
        yield told


def _loops(
    formula: Formula, numbers: Sequence[float], start: Array, steady: dict[tuple[float, float], Array]
) -> Iterator[str]:
    """Slip to and fro: after some cycles no cycle may give energy."""
    along = np.array([state.along for state in formula.states])
    w, load = min(steady, key=lambda at: abs(math.log(at[0] / 1e-3)) + abs(math.log(at[1])))
    reach = float(np.abs(steady[w, load][along]).max())
    for amplitude in (0.3 * reach, 3.0 * reach):
        for peak in (1e-4, 1e-1):
            work, size = _cycle(formula, numbers, start, along, amplitude, peak, load)
            if not math.isfinite(work):
                yield (
                    f"the states are not finite in a loop of slip of {amplitude:.3g} m at up to {peak:g} m/s, "
                    f"N = {load:g} N"
                )
                return
            if work < -_GIVEN * size:
                yield (
                    f"a closed loop of slip, of {amplitude:.3g} m at up to {peak:g} m/s with N = {load:g} N, gives "
                    f"{-work:.3g} J of the {size:.3g} J that pass through; friction must take energy"
                )
                return


def _cycle(
    formula: Formula, numbers: Sequence[float], start: Array, along: Any, amplitude: float, peak: float, load: float
) -> tuple[float, float]:
    """Work of friction over the last cycle of w = peak cos(t peak / amplitude), and the sum of its absolute values [J].

    Implicit Euler steps, none of which contains a reversal: they lose energy of springs and never add any.
    """
    z = start.copy()
    m = len(start)
    h = 2.0 * math.pi * amplitude / peak / _STEPS
    work = size = 0.0
    for step in range(_CYCLES * _STEPS):
        angle = (step + 0.5) * 2.0 * math.pi / _STEPS
        turn = np.where(along, math.copysign(1.0, math.cos(angle)), 1.0)
        w = abs(peak * math.cos(angle))
        before = z * turn
        after = before.copy()
        for _ in range(_NEWTON):
            values, slopes = formula.evaluate(numbers, w, load, after)
            try:
                residual = before + h * values[1 : m + 1] - after
                change = np.linalg.solve(np.eye(m) - h * slopes[1:, 2:], residual)
            except np.linalg.LinAlgError:
                return math.nan, math.nan
            after += change
            if np.abs(change).max() <= _CONVERGED * np.abs(after).max():
                break
        if step >= (_CYCLES - 1) * _STEPS:
            done = formula.evaluate(numbers, w, load, after)[0][0] * load * w * h
            work = work + done
            size = size + abs(done)
        z = after * turn
    return work, size
