"""The eigenvalues of a rig along one of its parameters: branches, and the critical values where growth changes sign.

The real parts of all eigenvalues in falling order are continuous functions of the parameter, whatever branches cross or
coalesce in between. So a critical value is a root of one of them, found without following anything, to the rounding of
the key (Brent). A stable or unstable island between two values is found by minimising in between. Where friction falls
with a kink, growth may jump over zero: told as a jump.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rig.scenes.scene import Scene
from rig.study.axis import Axis
from rig.study.modes import shape, told
from rig.study.spectrum import Spectra, Spectrum, equilibrium, follow

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
NEUTRAL = 1e-9  # of |lambda|: growth that is none
ROUNDING = 1e-12  # of the largest |lambda|
RELATIVE = 4.0 * float(np.finfo(float).eps)  # the finest that a root is asked for
CUSP = 4.0  # times the steps to both sides, growth may rise to a peak between: it bends like a root where modes meet
JUMP = 1e-3  # of the growth beside it: what is left at a root of a continuous function is far less


@dataclass(frozen=True)
class Critical:
    """A value of the key at which a motion stops or begins to grow, and the motion there.

    kind     flutter (an oscillation), divergence (a monotone growth), jump (growth leaps over zero), jamming (friction
             takes up all of the inertia; no motion, branch -1)
    becomes  what the motion becomes as the key rises: "unstable" or "stable"
    branch   number of the branch of the sweep that it belongs to; `frequency` [Hz]
    """

    value: float
    kind: Literal["flutter", "divergence", "jump", "jamming"]
    becomes: Literal["unstable", "stable"]
    frequency: float
    branch: int
    shape: dict[str, complex]


@dataclass(frozen=True)
class Sweep:
    """Eigenvalues `rates` [value, branch] at the values of `axis`; NaN where a branch is not there.

    `shapes` [value, branch, state]: amplitudes in the order of `states`. `exists` [value]: whether the rig slides
    steadily, and `notes` [value] what speaks against it. `loop`: the controller whose loop is closed, "" for none.
    """

    scene: str
    axis: Axis
    rates: Complex
    shapes: Complex
    states: tuple[str, ...]
    exists: NDArray[np.bool_]
    notes: tuple[str, ...]
    critical: tuple[Critical, ...]
    loop: str = ""

    @property
    def growth(self) -> Array:
        """Growth rates [value, branch] in 1/s; of a pair of oscillations the upper one alone."""
        return np.where(self._upper, self.rates.real, np.nan)

    @property
    def frequency(self) -> Array:
        """Frequencies [value, branch] in Hz."""
        return np.where(self._upper, self.rates.imag / (2.0 * math.pi), np.nan)

    @property
    def _upper(self) -> NDArray[np.bool_]:
        return np.asarray(self.rates.imag >= -ROUNDING * np.abs(self.rates))

    @property
    def largest(self) -> Array:
        """The largest growth rate at each value [1/s]."""
        return np.array([max(row[np.isfinite(row)], default=math.nan) for row in self.rates.real])

    def to_json(self) -> dict[str, Any]:
        """As plain values; a number that is not there is null."""
        growth, frequency = self.growth, self.frequency
        return {
            "scene": self.scene,
            "loop": self.loop or None,
            "key": self.axis.key,
            "unit": self.axis.unit,
            "values": list(self.axis.values),
            "exists": self.exists.tolist(),
            "notes": list(self.notes),
            "largest": self.largest.tolist(),
            "branches": [
                {"growth": g.tolist(), "frequency": f.tolist()}
                for g, f in zip(growth.T, frequency.T)
                if np.isfinite(g).any()
            ],
            "critical": [
                {**vars(one), "shape": {name: [v.real, v.imag] for name, v in one.shape.items()}}
                for one in self.critical
            ],
        }

    def text(self) -> str:
        """For a reader."""
        axis = self.axis
        what = f"the loop of {self.loop}" if self.loop else "steady sliding"
        lines = [f"{self.scene}: {what} over {axis.label}"]
        for one in self.critical:
            at = f" at {one.frequency:.6g} Hz" if one.frequency else ""
            side = "above" if one.kind != "jamming" or one.becomes == "unstable" else "below"
            what = "jams" if one.kind == "jamming" else f"{one.kind}{at}, {one.becomes}"
            lines += [f"  {axis.tell(one.value, 12)}: {what} {side}"]
            lines += [f"    {told(one.shape)}"] if one.shape else []
        if not self.critical:
            lines += ["  no critical value between these ends"]
        lines += ["", f"  {axis.label:<26}{'largest growth 1/s':>20}{'frequency Hz':>16}  motions that grow"]
        for value, row, note in zip(axis.values, self.rates, self.notes):
            if not np.isfinite(row).any():
                lines += [f"  {axis.tell(value):<26}{note:>20}"]
                continue
            top = row[int(np.nanargmax(row.real))]
            upper = row[np.isfinite(row) & (row.imag >= 0.0)]
            count = int(np.count_nonzero(upper.real > NEUTRAL * np.abs(upper)))
            hertz = abs(top.imag) / (2.0 * math.pi)
            lines += [f"  {axis.tell(value):<26}{top.real:>20.6g}{hertz:>16.6g}  {count or ''}  {note}".rstrip()]
        return "\n".join(lines)


def sweep(scene: Scene, axis: Axis) -> Sweep:
    """The eigenvalues of `scene` at its sliding equilibrium over `axis`, and the critical values between its ends."""
    return along(scene.name, axis, lambda value: equilibrium(axis.at(scene, value)))


def along(name: str, axis: Axis, spectrum_at: Spectra, loop: str = "") -> Sweep:
    """The sweep of whatever has a spectrum at each value of an axis."""
    spectra = lru_cache(maxsize=4096)(spectrum_at)
    found = [spectra(value) for value in axis.values]
    rates, order = _branches(axis.values, found, spectra)
    states = tuple(dict.fromkeys(name for one in found for name in one.names))
    shapes = np.zeros((*rates.shape, len(states)), dtype=np.complex128)
    for row, one, places in zip(shapes, found, order):
        columns = [states.index(state) for state in one.names]
        for i, place in places.items():
            row[place, columns] = one.right[:, i]
    return Sweep(
        scene=name,
        axis=axis,
        rates=rates,
        shapes=shapes,
        states=states,
        exists=np.array([one.exists for one in found]),
        notes=tuple(one.note for one in found),
        critical=tuple(_critical(axis.values, found, rates, spectra)),
        loop=loop,
    )


def _branches(
    values: tuple[float, ...], found: list[Spectrum], spectra: Spectra
) -> tuple[Complex, list[dict[int, int]]]:
    """Rates [value, branch], and for each value the branch of each of its rates."""
    order: list[dict[int, int]] = []
    count = 0
    for k, one in enumerate(found):
        here: dict[int, int] = {}
        if k and one.counts and found[k - 1].counts:
            on = follow(spectra, values[k - 1], found[k - 1], values[k], one)
            here = {int(on[i]): place for i, place in order[-1].items() if on[i] >= 0}
        for i in range(len(one.rates) if one.counts else 0):
            if i not in here:
                here[i] = count
                count += 1
        order.append(here)
    rates = np.full((len(found), count), complex(math.nan, math.nan))
    for row, one, places in zip(rates, found, order):
        for i, place in places.items():
            row[place] = one.rates[i]
    return rates, order


def _none(spectrum: Spectrum) -> Array:
    """Growth rate of each motion up to which it is none: what rounding makes of a motion without damping."""
    size = np.abs(spectrum.rates)
    return np.asarray(np.maximum(NEUTRAL * size, ROUNDING * size.max(initial=0.0)))


def _sign(spectrum: Spectrum, k: int) -> int:
    """Of the growth of motion k: 1, -1, or 0 where it is none."""
    growth = float(spectrum.rates[k].real)
    return 0 if abs(growth) <= _none(spectrum)[k] else 1 if growth > 0.0 else -1


def _critical(values: tuple[float, ...], found: list[Spectrum], rates: Complex, spectra: Spectra) -> Iterator[Critical]:
    """Critical values in the order of the key, each told once though a pair of eigenvalues passes there."""
    known = list(_jamming(values, found, spectra))
    for start, end in _stretches(found):
        among = list(values[start:end])
        for k in range(min(len(one.rates) for one in found[start:end])):
            x = sorted([*among, *_islands(among, k, spectra)], reverse=values[0] > values[-1])
            for a, b, shift in _brackets(x, [_sign(spectra(value), k) for value in x]):
                one = _root(spectra, k, a, b, shift, values, rates)
                span = 1e-9 * abs(values[-1] - values[0])
                if not any(abs(c.value - one.value) <= span and c.kind == one.kind for c in known):
                    known.append(one)
    yield from sorted(known, key=lambda one: one.value)


def _jamming(values: tuple[float, ...], found: list[Spectrum], spectra: Spectra) -> Iterator[Critical]:
    """Where the mass matrix with friction in it stops or begins to be one."""
    from scipy.optimize import brentq

    for (a, b), (one, other) in zip(pairwise(values), pairwise(found)):
        if one.inertia * other.inertia < 0.0:
            ends = sorted((a, b))
            root = float(brentq(lambda value: spectra(value).inertia, *ends, xtol=1e-300, rtol=RELATIVE))
            rises = (other.inertia > one.inertia) == (b > a)
            yield Critical(root, "jamming", "stable" if rises else "unstable", 0.0, -1, {})


def _stretches(found: list[Spectrum]) -> Iterator[tuple[int, int]]:
    """First and last + 1 of the values that follow one another with a spectrum that counts."""
    start = None
    for k, one in enumerate([*found, None]):
        if one is not None and one.counts:
            start = k if start is None else start
        elif start is not None:
            if k - start > 1:
                yield start, k
            start = None


def _islands(x: list[float], k: int, spectra: Spectra) -> Iterator[float]:
    """Values between those of the sweep at which the growth number k has another sign than on both sides."""
    from scipy.optimize import minimize_scalar

    def growth(value: float) -> float:
        return float(spectra(value).rates[k].real)

    at = [growth(value) for value in x]
    for i in range(1, len(x) - 1):
        sign = 1.0 if at[i] > 0.0 else -1.0
        left, here, right = (sign * g for g in at[i - 1 : i + 2])
        least = 0.0 < here < min(left, right) * (1.0 - NEUTRAL)
        if least and here < CUSP * (max(left, right) - here):  # a bend that could reach zero beside this value
            ends = sorted((x[i - 1], x[i + 1]))
            options = {"xatol": 1e-6 * (ends[1] - ends[0])}
            found = minimize_scalar(
                lambda v, s=sign: s * growth(float(v)), bounds=ends, method="bounded", options=options
            )
            if found.fun < 0.0:
                yield float(found.x)


def _brackets(x: list[float], signs: list[int]) -> Iterator[tuple[float, float, bool]]:
    """Neighbours between which the sign changes; the flag tells growth that begins from none, as without damping."""
    clear = [k for k, sign in enumerate(signs) if sign]
    for i, j in pairwise(clear):
        if signs[i] != signs[j] and j - i <= 2:
            yield x[i], x[j], False
    for k, (a, b) in enumerate(pairwise(signs)):
        beyond = k - 1 if a == 0 else k + 2
        lone = 0 <= beyond < len(x) and signs[beyond] != 0  # a value of the sweep that is a critical one by chance
        if {a, b} == {0, 1} and not lone:
            yield x[k], x[k + 1], True


def _root(
    spectra: Spectra, k: int, a: float, b: float, shift: bool, values: tuple[float, ...], rates: Complex
) -> Critical:
    """The critical value between a and b, where the growth number k changes sign."""
    from scipy.optimize import brentq

    def growth(value: float) -> float:
        one = spectra(value)
        return float(one.rates[k].real - (_none(one)[k] if shift else 0.0))

    root = float(brentq(growth, a, b, xtol=1e-15 * max(abs(a), abs(b)), rtol=RELATIVE, maxiter=200))
    low, high = sorted((a, b))
    at, sides = spectra(root), (growth(low), growth(high))
    jumps = not shift and abs(growth(root)) > JUMP * min(map(abs, sides))
    grown = spectra(high if sides[1] > 0.0 else low) if jumps else at
    i = k if grown.rates[k].imag >= 0.0 else int(np.abs(grown.rates - grown.rates[k].conj()).argmin())
    rate = grown.rates[i]
    near = int(np.abs(np.array(values) - root).argmin())
    here = np.where(np.isfinite(rates[near]), np.abs(rates[near] - rate), np.inf)
    return Critical(
        value=root,
        kind="jump" if jumps else "flutter" if rate.imag else "divergence",
        becomes="unstable" if sides[1] > sides[0] else "stable",
        frequency=float(rate.imag / (2.0 * math.pi)),
        branch=int(here.argmin()),
        shape=shape(grown.names[: grown.own], grown.right[: grown.own, i], grown.coordinates),
    )
