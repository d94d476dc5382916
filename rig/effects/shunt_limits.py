"""Findings of the stability report on a series shunt: its static limit and its time constants.

A negative capacitance softens the stack to the static stiffness c33 + kappa delta/(1 + delta). The rig becomes
statically unstable where this change cancels the stiffness k_b between the ends of the shorted stack, at
delta = -k_b/(k_b + kappa). This limit is above that of the loop alone, delta = -1.
Source: Kroeger, Neubauer, Popp (2008), section 4 d; the limit in the structure is derived here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from rig.effects.stack import Stack
from rig.model.build_checks import Finding
from rig.model.singular import assembled
from rig.model.system import Judge, System
from rig.quantities import at_least
from rig.stability.linearisation import sliding_key

TOLERANCE = 0.1
"""Relative variation of a stack's capacitance with temperature [calibrated]."""
_SINGULAR = 1e-12  # share of the largest stiffness below which there is none


def stiffness_between_ends(system: System, stack: Stack) -> float:
    """Static stiffness k_b [N/m] between the ends of the shorted stack in steady sliding; infinite if they are fixed.

    The friction force is taken as constant.
    """
    nq = len(system.coordinates)
    ends = np.array([stack.path.get(c, 0.0) for c in system.coordinates])
    push = np.zeros_like(system.coupling)
    push[:, system.one] = ends
    key = sliding_key(system)
    plain, pushed = (assembled(replace(system, coupling=c), key).A[nq : 2 * nq] for c in (0.0 * push, push))
    stiff, pull = plain[:, :nq], (plain - pushed)[:, system.one]
    yields = np.linalg.pinv(stiff, rcond=_SINGULAR) @ pull
    if np.abs(stiff @ yields - pull).max() > _SINGULAR * np.abs(pull).max():
        return 0.0  # no spring resists the stack
    given = float(ends @ yields)
    return 1.0 / given if given else math.inf


def static_limit(system: System, stack: Stack) -> float:
    """The delta below which the rig is statically unstable: -k_b/(k_b + kappa)."""
    k_b = stiffness_between_ends(system, stack)
    return -1.0 / (1.0 + stack.kappa / k_b) if k_b else 0.0


def judge(stack: Stack, delta: float, states: Sequence[str], dropped: Sequence[str]) -> Judge:
    """The check of a series shunt for the stability report. `dropped`: parameters without influence, set to zero."""

    def findings(system: System, step: float) -> Iterator[Finding]:
        if dropped:
            what = f"shunt: {' and '.join(dropped)} too small to influence any motion of the structure, taken as 0"
            yield Finding("info", what, 0.0, "nothing to do; it saves a state that would be very fast")
        if delta < 0.0:
            yield from _static(system, stack, delta)
        if states:
            yield from _fast(system, states, step)

    return findings


def _static(system: System, stack: Stack, delta: float) -> Iterator[Finding]:
    k_b, kappa = stiffness_between_ends(system, stack), stack.kappa
    limit = static_limit(system, stack)
    safe = limit / (1.0 + TOLERANCE)
    where = f"the limit is -k_b/(k_b + kappa) = {limit:.4f} (k_b {k_b:.4g} N/m, kappa {kappa:.4g} N/m)"
    if delta <= limit:
        held = delta <= -1.0
        left = "even held at its ends" if held else f"stiffness left {k_b + kappa * delta / (1.0 + delta):.4g} N/m"
        what = f"shunt: with delta {delta:g} the stack is statically unstable, {left}; {where}"
        yield Finding("error", what, delta - limit, f"delta above {at_least(limit, 4)}, {at_least(safe)} to be safe")
    elif delta * (1.0 + TOLERANCE) <= limit:
        more = delta * (1.0 + TOLERANCE)
        what = f"shunt: a stack {TOLERANCE:.0%} above its capacitance makes delta {delta:g} to {more:.3f}"
        yield Finding("warning", f"{what}; {where}", delta - limit, f"delta above {at_least(safe)}")


def _fast(system: System, states: Sequence[str], step: float) -> Iterator[Finding]:
    """The time constant of the network with fixed ends of the stack, compared with the step."""
    at = [system.names.index(name) for name in states]
    key = sliding_key(system)
    patches, normals, limiters, sectors, thrown = system.modes(key)
    closed = [max(position, 1) for position in thrown]
    A = assembled(system, system.key(patches, normals, limiters, sectors, closed)).A[np.ix_(at, at)]
    values = np.linalg.eigvals(A)
    fastest = max(values, key=abs)
    if abs(fastest) == 0.0:
        return
    hertz = f"resonance {abs(fastest) / (2.0 * math.pi):.4g} Hz, " if fastest.imag else ""
    what = f"shunt: {hertz}time constant {1.0 / max(abs(fastest.real), 1e-300):.3g} s, step {step:g} s"
    yield Finding("info", what, abs(fastest) * step, "exact integrates it with any step; rk4 and dopri5 resolve it")
