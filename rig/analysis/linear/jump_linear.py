"""A control loop over impaired links as a jump linear system: growth of the mean and of the mean square.

At every tick a link delivers a message of some age, or none, and then the last one is held. The loop z(k+1) = A_j z(k)
has a matrix for each case j, which occurs with probability p_j. For cases that are independent from tick to tick

    mean          E z(k+1) = (sum_j p_j A_j) E z(k)
    mean square   S(k+1) = sum_j p_j A_j S(k) A_j^T,    S = E z z^T

and the loop is stable in the mean square exactly if the spectral radius of the second map is below one (Costa, Fragoso,
Marques (2005), "Discrete-Time Markov Jump Linear Systems", theorem 3.9 with independent cases). Growth rates are
ln(radius) / T and ln(radius) / (2 T). Decay in the mean square implies decay of almost every single run.

Loss with a constant delay is exactly of this kind. With jitter the age of successive messages is not independent; the
model draws it from its stationary distribution at each tick, as Nilsson (1998), "Real-Time Control Systems with
Delays", does for random delays. Duplicates are left out: without reordering a second copy brings nothing new.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rig.analysis.linear.control_loop import Loop, ends, loop
from rig.scenes.network import Link
from rig.scenes.scene import Scene

Array = NDArray[np.float64]
Ages = Sequence[tuple[int | None, float]]
"""Age of the message that arrives at a tick [frames], None for none, with its probability."""
DENSE = 10
"""Largest number of states for which the map of S is written out as a matrix."""
_RESTARTS = 40  # of the search for its radius: where it succeeds, it needs fewer
_SEARCHED = 150  # most states for which its radius is searched, in about a second; 316 would take minutes [chosen]


@dataclass(frozen=True)
class Growth:
    """Growth rates [1/s] of a loop over impaired links: of the mean, and of the root of the mean square.

    The latter is NaN where its eigenvalue was not found: rigs of many modes with little damping.
    """

    mean: float
    mean_square: float
    hertz: float
    """Frequency of the mean [Hz]."""
    shape: Array
    """Of the mean, over the states of the plant."""


def latencies(link: Link, frame_ns: int) -> dict[int, float]:
    """Time under way of a message [frames] -> probability, as rig.bus.impaired_link rounds it up."""
    low = link.delay - link.jitter
    count = 2 * link.jitter + 1
    least, most = link.ticks(frame_ns)
    ends = [min(max(d * frame_ns - low + 1, 0), count) for d in range(least - 1, most + 1)]
    return {d: (b - a) / count for d, (a, b) in zip(range(least, most + 1), pairwise(ends))}


def ages(link: Link, frame_ns: int) -> Ages:
    """The stationary distribution of what a link delivers at a tick."""
    under_way = latencies(link, frame_ns)
    kept = 1.0 - link.loss
    least = min(under_way)
    most = max(under_way)
    arrivals: list[tuple[int | None, float]] = []
    if link.reorder:  # of the messages that arrive at this tick the last one sent counts
        left = 1.0
        for d in range(least, most + 1):
            arrives = kept * under_way.get(d, 0.0)
            arrivals.append((d, left * arrives))
            left *= 1.0 - arrives
        return [*arrivals, (None, left)]

    def arrived(age: int) -> float:
        """The probability that a message of this age has arrived, or is lost."""
        return float(link.loss + kept * sum(p for d, p in under_way.items() if d <= age))

    before = 0.0
    for m in range(least, most + 1):
        all_arrived = math.prod(arrived(age) for age in range(m, most + 1))
        arrivals.append((m, kept * (all_arrived - before)))
        before = all_arrived
    return [*arrivals, (None, link.loss)]


def mean_age(link: Link, frame_ns: int) -> float:
    """Mean age of the samples that a controller has [frames]; a tick without a message adds one frame."""
    arriving = [(age, p) for age, p in ages(link, frame_ns) if age is not None]
    share = sum(p for _, p in arriving)
    if not share:
        return math.inf
    return sum(age * p for age, p in arriving) / share + (1.0 - share) / share


def fits(scene: Scene, name: str) -> bool:
    """Whether the loop of controller `name` works once in every frame, as `jump_growth` needs."""
    return round(loop(scene, name).model.period * 1e9) == scene.frame_ns


def worst_case(scene: Scene, name: str, meas: Link, act: Link) -> Growth:
    """The growth of a loop if every message takes the longest time that its links allow.

    The age of a sample at an update is a multiple of the shorter period, that of the controller or that of its sensor.
    """
    frame = scene.frame_ns
    sensor, _ = ends(scene, name)
    period = min(scene.controllers[name].period, scene.sensors[sensor].period_ns)
    _, longest = meas.ticks(frame)
    heard = -(-longest * frame // period) * period
    _, commanded = act.ticks(frame)
    closed = loop(scene, name, heard + commanded * frame)
    rate = complex(closed.spectrum.rates[0])
    shape = closed.spectrum.right[: closed.model.own, 0].real
    return Growth(rate.real, rate.real, abs(rate.imag) / (2.0 * math.pi), shape)


def jump_growth(scene: Scene, name: str, meas: Link, act: Link) -> Growth:
    """The growth of the loop of controller `name` over a link of its sensor and one of its commands.

    For a loop that `fits`. Raises SceneError as `rig.analysis.linear.control_loop.loop` does.
    """
    frame = scene.frame_ns
    heard, commanded = ages(meas, frame), ages(act, frame)
    longest = max((age for age, _ in commanded if age is not None), default=0)
    cases: list[tuple[float, Array]] = []
    states = 0  # of the plant
    for commanded_age, p in commanded:
        if p > 0.0:
            late = None if commanded_age is None else longest - commanded_age
            cut = loop(scene, name, longest * frame, late)
            states = states or cut.model.own
            cases += [(p * q, _case(cut, age, heard)) for age, q in heard if q > 0.0]
    period = frame * 1e-9
    z, shapes = np.linalg.eig(sum(p * A for p, A in cases))
    fastest = np.abs(z).argmax()
    mean = complex(z[fastest])
    shape = shapes[:states, fastest].real
    hertz = abs(cmath.phase(mean)) / (2.0 * math.pi * period)
    return Growth(math.log(abs(mean)) / period, 0.5 * math.log(_radius(cases)) / period, hertz, shape)


def _case(cut: Loop, age: int | None, heard: Ages) -> Array:
    """The matrix over [z, measurements under way (the newest first), the measurement heard last]."""
    m = cut.model
    n = len(m.F)
    under_way = max((a for a, _ in heard if a is not None), default=0)
    size = n + under_way + 1
    reads = np.zeros(size)
    if age is None:
        reads[-1] = 1.0
    elif age:
        reads[n + age - 1] = 1.0
    else:
        reads[:n] = m.H
    A = np.zeros((size, size))
    A[:n, :n] = m.F
    A[:n] += cut.gain * np.outer(m.G, reads)
    if under_way:
        A[n, :n] = m.H
        A[n + 1 : n + under_way, n : n + under_way - 1] = np.eye(under_way - 1)
    A[-1] = reads
    return A


def _radius(cases: Sequence[tuple[float, Array]]) -> float:
    """The spectral radius of S -> sum p A S A^T."""
    size = len(cases[0][1])
    if len(cases) == 1:
        return float(np.abs(np.linalg.eigvals(cases[0][1])).max()) ** 2
    scale = np.maximum(np.max([np.abs(A).max(axis=1) for _, A in cases], axis=0), 1e-300)
    scaled = [(p, A / scale[:, None] * scale) for p, A in cases]  # states of similar size: the same eigenvalues
    if size <= DENSE:
        return float(np.abs(np.linalg.eigvals(sum(p * np.kron(A, A) for p, A in scaled))).max())
    if size > _SEARCHED:
        return math.nan
    from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs

    def after(s: Array) -> Array:
        S = s.reshape(size, size)
        return np.asarray(sum(p * (A @ S @ A.T) for p, A in scaled)).ravel()

    operator = LinearOperator((size * size, size * size), matvec=after, dtype=np.float64)  # type: ignore[call-arg]
    start = np.eye(size).ravel()
    try:
        largest = eigs(operator, k=4, ncv=40, v0=start, tol=1e-10, maxiter=_RESTARTS, return_eigenvectors=False)
    except ArpackNoConvergence:
        return math.nan
    return float(np.abs(largest).max())
