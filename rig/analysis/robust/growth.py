"""The growth of the rigs of a box: their matrices, eigenvalues, and what both change with a design or with the rig.

    modes.growth   the plant alone about steady sliding, as `rig modes` computes it
    loop.growth    all controllers closed, as `rig.analysis.linear.all_loops` computes it

What counts is the largest growth rate of the modes in the band; modes outside of it count where they grow. A rig
without steady sliding, and one that the scene refuses, has the growth infinity: its matrix is empty and says why.

A design is what everybody knows: controllers are designed for the scene with its values. What the box changes is an
error of the rig: controllers keep what they believe, even of a speed, a load and a delay, unless the scene says that
they are designed anew for each rig (`Scene.redesign`).

    growth = Growth(scene, box, "modes.growth", (2000.0, 5000.0))
    growth.matrix(x, u).A                       of design x and rig u, coordinates in unit cubes (Box)
    growth.value(x, u)                          (growth [1/s], frequency [Hz] of its mode)
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.analysis.linear.all_loops import closed_plant
from rig.analysis.linear.control_loop import VANISHED
from rig.analysis.linear.eigenvalue_curves import none
from rig.analysis.linear.modes import at_rest, dithers, missing, under_dither
from rig.analysis.robust.box import Box
from rig.design import numbers
from rig.design.linearised import linear
from rig.errors import SceneError, Singular
from rig.model.assembly import Assembly
from rig.scenes.belief import varied
from rig.scenes.rooms import assembled
from rig.scenes.scene import Scene
from rig.stability.linearisation import Steady

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
MODES = "modes.growth"
LOOP = "loop.growth"
KEPT = 6
"""Most eigenvalues of the band that a search follows at each rig."""
_OUTSIDE = 2  # and of those outside of it
_NONE = np.zeros((0, 0))  # the matrix of a rig without a growth
_STEP = 1e-6  # of the unit cube: forward differences of a matrix
_DESIGNS = 64  # whose controllers are kept: the gradient of a design needs one for each free value


def hertz(rates: Complex) -> Array:
    """Return the frequencies [Hz] of rates [1/s]."""
    return np.asarray(np.abs(rates.imag) / (2.0 * math.pi))


class Matrix(NamedTuple):
    """The matrix of a rig, [n, n]: continuous in time (`period` 0), or of one period [s]. Eigenvalues count up to the
    frequency `up_to` [Hz]. `why`: the reason in words, if the rig has none.
    """

    A: Array
    period: float = 0.0
    up_to: float = math.inf
    why: str = ""

    @property
    def values(self) -> Complex:
        """All eigenvalues of A."""
        return np.linalg.eigvals(self.A).astype(np.complex128)

    @property
    def spectrum(self) -> Complex:
        """The rates [1/s] of all eigenvalues."""
        return self.rates(self.values)

    def rates(self, values: Complex) -> Complex:
        """The rates [1/s] of eigenvalues of A; one that vanishes within a period has the rate -infinity."""
        if not self.period:
            return values
        size = np.abs(values)
        rates = np.log(np.where(size > VANISHED, values, 1.0)) / self.period
        return np.where(size > VANISHED, rates, complex(-np.inf, 0.0))


class Piece(NamedTuple):
    """An eigenvalue of a rig: its `rate` [1/s], the gradient of its growth over a unit cube, whether it is in the
    band.
    """

    rate: complex
    slope: Array
    inside: bool


class Growth:
    """The growth of the rigs of `box` of `scene`, as `measure` states it, in a `band` (from, to) [Hz]."""

    def __init__(
        self, scene: Scene, box: Box, measure: str = MODES, band: tuple[float, float] = (0.0, math.inf)
    ) -> None:
        self.scene = scene
        self.box = box
        self.band = band
        self.closed = measure == LOOP
        self.count = 0
        """Rigs that were assembled."""
        inputs = assembled(scene.parameters, scene.frame_ns, random=False).inputs if self.closed else ()
        self._moved = dict.fromkeys(inputs, "held") if self.closed else scene.moved
        self._dithered = bool(dithers(scene, ""))
        self._mode_set: int | None = None
        self._numbers = lru_cache(_DESIGNS)(lambda design: numbers(self.designed(dict(design))))

    def rig(self, design: Mapping[str, float], values: Mapping[str, float]) -> Scene:
        """The scene of a rig: with a `design`, and with `values` (SI) that its controllers do not know of.

        Raises SceneError if the scene refuses them.
        """
        return varied(self.designed(design), values, by_operator=False)

    def designed(self, design: Mapping[str, float]) -> Scene:
        """The scene with the values (SI) of a design, which its controllers know."""
        if not design:
            return self.scene
        believed = {key: value for key, value in self.scene.believed.items() if key not in design}
        return replace(self.scene, believed=believed).with_values(design)

    def matrix(self, x: Array, u: Array) -> Matrix:
        """The matrix of design x [free] and rig u [uncertain]."""
        design = self.box.design(x)
        return self.matrix_of(design, self.box.rig(design, u))

    def matrix_of(self, design: Mapping[str, float], values: Mapping[str, float]) -> Matrix:
        """The same for values (SI) by key."""
        self.count += 1
        try:
            return self._closed(design, values) if self.closed else self._alone({**design, **values})
        except SceneError as fault:
            why = "; ".join(fault.faults)
        except Singular as fault:
            why = fault.why
        except (ArithmeticError, np.linalg.LinAlgError) as fault:
            why = f"its equations are singular: {fault}"
        return Matrix(_NONE, why=why)

    def _alone(self, values: Mapping[str, float]) -> Matrix:
        scene = self.scene.with_values(values)
        if self._dithered:
            at = under_dither(scene)
            up_to = math.inf
        else:
            assembly, at = self._steady(scene)
            up_to = assembly.up_to
        if not at.counts:
            return Matrix(_NONE, why=missing(at))
        return Matrix(at.A[np.ix_(at.moving, at.moving)], up_to=up_to)

    def _steady(self, scene: Scene) -> tuple[Assembly, Steady]:
        """A rig and its steady sliding, in the mode set of a rig before: to find it takes as long as all the rest."""
        assembly, at = at_rest(scene, self._moved, self._mode_set)
        if not at.slides and self._mode_set is not None:
            assembly, at = at_rest(scene, self._moved)
        self._mode_set = at.modes.key
        return assembly, at

    def _closed(self, design: Mapping[str, float], values: Mapping[str, float]) -> Matrix:
        scene = self.rig(design, values)
        told = numbers(scene) if scene.redesign else self._numbers(tuple(design.items()))
        assembly, at = self._steady(scene)
        if not at.exists:
            return Matrix(_NONE, why=missing(at))
        loops = closed_plant(scene, linear(assembly, at), told)
        return Matrix(loops.matrix, loops.period)

    def value(self, x: Array, u: Array) -> tuple[float, float]:
        """The growth [1/s] that counts, and the frequency [Hz] of its mode."""
        matrix = self.matrix(x, u)
        return (math.inf, math.nan) if matrix.why else self.of_rates(matrix.spectrum, matrix.up_to)

    def of_rates(self, rates: Complex, up_to: float = math.inf) -> tuple[float, float]:
        """The growth that counts of `rates`, and its frequency; -infinity without a mode in the band."""
        rates = rates[np.isfinite(rates.real)]
        tones = hertz(rates)
        real = np.where(tones <= up_to, rates.real, -np.inf)
        within = np.where(self.inside(tones), real, -np.inf)
        beyond = np.where(self.inside(tones), -np.inf, real)
        first = int(within.argmax())
        other = int(beyond.argmax())
        if beyond[other] > max(none(rates)[other], within[first]):
            return float(beyond[other]), float(tones[other])
        return float(within[first]), float(tones[first])

    def inside(self, tones: Array) -> NDArray[np.bool_]:
        """Whether frequencies [Hz] are in the band."""
        return (tones >= self.band[0]) & (tones <= self.band[1])

    def pieces(self, x: Array, u: Array, of_rig: bool = False, kept: int = KEPT) -> list[Piece]:
        """The eigenvalues of a rig that may count: the largest in the band, and the two largest outside of it.

        A rig without a growth has none.

        Their gradients are over the design x, or with `of_rig` over the rig u: y^H dA r / y^H r with the left and right
        eigenvectors y and r and forward differences of the matrix.
        """
        from scipy.linalg import eig

        matrix = self.matrix(x, u)
        if matrix.why:
            return []
        values, left, right = eig(matrix.A, left=True, right=True)
        rates = matrix.rates(values.astype(np.complex128))
        tones = hertz(rates)
        counts = np.flatnonzero((rates.imag >= 0.0) & (tones <= matrix.up_to) & np.isfinite(rates.real))
        order = counts[np.argsort(-rates.real[counts], kind="stable")]
        inside = self.inside(tones)
        changes = [self._change(matrix.A, x, u, i, of_rig) for i in range(len(u if of_rig else x))]
        out = []
        for i in [*order[inside[order]][:kept], *order[~inside[order]][:_OUTSIDE]]:
            y = left[:, i].conj()
            r = right[:, i]
            size = y @ r * (values[i] * matrix.period if matrix.period else 1.0)
            slope = np.array([(y @ change @ r / size).real if size else 0.0 for change in changes])
            out.append(Piece(complex(rates[i]), slope, bool(inside[i])))
        return out

    def _change(self, A: Array, x: Array, u: Array, i: int, of_rig: bool) -> Array:
        """The change of A over coordinate i of the rig or of the design; zero where A has another size beside."""
        beside = (u if of_rig else x).copy()
        at = beside[i]
        beside[i] += _STEP if at < 0.5 else -_STEP
        if of_rig and self.box.uncertain[i].step:
            return np.zeros_like(A)
        other = self.matrix(*((x, beside) if of_rig else (beside, u))).A
        return (other - A) / (beside[i] - at) if other.shape == A.shape else np.zeros_like(A)
