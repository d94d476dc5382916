"""Tables for the exact propagation of rigs with many states (rig.solve.many_states).

Short series over a whole tick need powers of u on [0, 1] as polynomials of lower degree (`economy`). They are
telescoped after Lanczos: u^j = u u^(j-1), where the Chebyshev polynomials beyond the degree are removed from u^(j-1).
For a vibration that turns by w h radians per tick, degree d leaves an error of 2 (w h / 4)^(d+1) / (d+1)!; its Taylor
series of the same degree would leave (w h)^(d+1) / (d+1)!. At u = 0 the approximation is exact.

Source: Lanczos, Applied Analysis (1956), chapter 7.
"""

from __future__ import annotations

from fractions import Fraction
from functools import cache
from math import comb

import numpy as np
from numpy.typing import NDArray

from rig.model.energy_forms import gathered
from rig.solve import expm
from rig.solve.column_blocks import BLOCK, LANE, blocks, zeros
from rig.solve.many_states import (
    CHECKS,
    MARGIN,
    NODES,
    QUICK,
    SIZE,
    TERMS,
    TURN,
    WEIGHTS,
    ManyStatesTables,
    taylor_matrices,
)
from rig.solve.roots import DEGREE as ORDER
from rig.solve.segment_output import DEGREE

Array = NDArray[np.float64]


@cache
def economy(degree: int, terms: int) -> NDArray[np.float64]:
    """The coefficients of u^k, k = 0 .. degree, in the approximation of u^j, j = 0 .. terms: [k, j]."""
    chebyshev = _shifted(degree)
    out = np.zeros((degree + 1, terms + 1))
    for j in range(terms + 1):
        if j <= degree:
            out[j, j] = 1.0
            continue
        n = j - 1
        column = [Fraction(0)] * degree
        for i in range(degree):  # u^n = 2 / 4^n sum_i comb(2n, n-i) T_i(2u - 1), the first term halved
            share = Fraction(comb(2 * n, n - i), 4**n) * (1 if i == 0 else 2)
            for k, value in enumerate(chebyshev[i]):
                column[k] += share * value
        out[1:, j] = [float(value) for value in column]
    return out


def bernstein(degree: int) -> NDArray[np.float64]:
    """The matrix from the coefficients of powers [k] to Bernstein coefficients [i]: [i, k]."""
    rows = np.zeros((degree + 1, degree + 1))
    for i in range(degree + 1):
        for k in range(i + 1):
            rows[i, k] = comb(i, k) / comb(degree, k)
    return rows


def _shifted(count: int) -> list[list[int]]:
    """The coefficients of T_i(2u - 1), i < count, lowest power first."""
    polynomials = [[1], [-1, 2]]
    while len(polynomials) < count:
        before, last = polynomials[-2], polynomials[-1]
        new = [0] * (len(last) + 1)
        for k, value in enumerate(last):
            new[k] -= 2 * value
            new[k + 1] += 4 * value
        for k, value in enumerate(before):
            new[k] -= value
        polynomials.append(new)
    return polynomials


def depth(A: Array, step: float) -> int:
    """The number of halvings from a tick to a cell."""
    turn = float(np.abs(np.linalg.eigvals(A)).max(initial=0.0)) * step
    size = float(expm.norm(A, expm.balance(A))) * step
    level = 0
    while turn > TURN or size > SIZE:
        turn = 0.5 * turn
        size = 0.5 * size
        level = level + 1
    return level


def empty(n: int, inputs: int, guards: int, signals: int, outputs: int) -> ManyStatesTables:
    """Tables without a mode set."""
    count = {
        "tick": n + guards * (QUICK + 1),
        "signal": signals * (DEGREE + 1),
        "output": outputs,
        "margin": guards,
        "state": ORDER * n,
        "guard": guards * BLOCK,
    }
    needed = {name: -(-columns // BLOCK) for name, columns in count.items()}
    filled = -(-n // BLOCK) * BLOCK
    return ManyStatesTables(
        **{name: zeros((0, many, n, BLOCK)) for name, many in needed.items()},
        field=zeros((0, n + inputs, -(-n // LANE) * LANE)),
        whole=zeros((0, n, filled)),
        part=zeros((0, n, filled)),
        nodes=0.5 * (NODES + 1.0),
        weights=0.5 * WEIGHTS,
        product=zeros(BLOCK * max(needed.values())),
        bound=zeros(BLOCK * needed["margin"]),
        poly=zeros(BLOCK),
        size=zeros(n),
        filled=zeros(filled),
        path=zeros((filled // BLOCK, ORDER + 1, BLOCK)),
        power=zeros(ORDER + 1),
    )


def series(A: Array, length: float) -> Array:
    """A^j length^j / j!, j = 0 .. TERMS, [j, n, n]; summed in the balanced scale."""
    n = len(A)
    d = expm.balance(A)
    out = np.zeros((TERMS + 1, n, -(-n // BLOCK) * BLOCK))
    out[0, :, :n] = np.eye(n)
    balanced = A * d[:, None] / d[None, :]
    taylor_matrices(blocks((balanced * length).T), out)
    return np.asarray(out[:, :, :n] * d[None, None, :] / d[None, :, None])


def tables(
    terms: Array,
    E: Array,
    landing: Array,
    guards: Array,
    bounds: Array,
    field: Array,
    outputs: Array,
    read: int,
) -> dict[str, Array]:
    """The tables of one mode set.

    `terms`: `series` over a cell; E [level, n, n] as in ModeSets; bounds [guard, n]: chord bounds; field [n, n +
    inputs]: rows of the derivative; outputs [output, n], of which sensors read the first `read`.
    """
    n = len(landing)
    filled = -(-n // BLOCK) * BLOCK
    levels = len(E)
    polynomial = landing @ _combine(economy(ORDER, TERMS)[1:], terms) @ landing  # [ORDER, n, n]
    along = np.concatenate([np.eye(n)[None], polynomial])
    over_guards = np.zeros((len(guards), BLOCK, n))
    over_guards[:, : ORDER + 1] = np.einsum("gi,kij->gkj", guards, along)
    over_signals = np.einsum("si,kij->skj", outputs[:read], _combine(economy(DEGREE, TERMS), terms))
    if levels == 1:
        low = economy(QUICK, TERMS)
        powers = CHECKS[:, None] ** np.arange(TERMS + 1)
        guard_terms = np.einsum("gi,kij->kgj", guards, terms)
        left = (powers - powers[:, : QUICK + 1] @ low) @ guard_terms.reshape(TERMS + 1, -1)
        margin = MARGIN * np.abs(left).max(axis=0).reshape(guards.shape)
        coefficients = np.einsum("gi,kij->gkj", guards, _combine(low, terms))
        quick = np.einsum("bk,gkj->gbj", bernstein(QUICK), coefficients)
    else:  # values at the ends of the chord; `margin` bounds the distance of the guard from the chord
        margin = bounds
        quick = np.repeat(guards[:, None, :], QUICK + 1, axis=1)
        quick[:, 1:] += (guards @ E[0])[:, None, :]
    return {
        "tick": blocks(np.concatenate([E[0], quick.reshape(-1, n)])),
        "signal": blocks(over_signals.reshape(-1, n)),
        "output": blocks(outputs),
        "margin": blocks(margin),
        "state": blocks(polynomial.reshape(-1, n)),
        "guard": blocks(over_guards.reshape(-1, n)),
        "field": np.pad(field.T, ((0, 0), (0, -len(field) % LANE))),
        "whole": np.zeros((n, filled)),
        "part": np.zeros((n, filled)),
    }


def collected_energy(t: ManyStatesTables, count: int, work: Array, powers: Array) -> Array:
    """Evaluate the sums `whole` and `part` of the first `count` mode sets as energy terms, [term], and reset them.

    work, powers [mode set, term, n, n]: quadratic forms.
    """
    return gathered(work, t.whole, count) + gathered(powers, t.part, count)


def at(places: Array, terms: Array) -> Array:
    """The propagators exp(A u) at places u of a cell, [place, n, n]."""
    return _combine(places[:, None] ** np.arange(TERMS + 1), terms)


def _combine(weights: Array, terms: Array) -> Array:
    """The sums sum_j weights[k, j] terms[j], [k, n, n]."""
    out = np.zeros((len(weights), terms[0].size))
    flat = np.ascontiguousarray(terms.reshape(len(terms), -1))
    expm.multiply(np.ascontiguousarray(weights), flat, out)
    return out.reshape(len(weights), *terms.shape[1:])
