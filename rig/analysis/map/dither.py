"""The boundary of dither over frequency: the amplitude above which the rig keeps sliding, averaged and simulated.

averaged    the least stable mode of rig.analysis.cycles.averaged neither grows nor decays; leading: the same with only
            the inertia in the fast motion, as in direct partition of motion
simulated   a run that starts on the fast orbit, displaced along that mode, neither grows nor decays: its slow part
            (means over periods of the dither) has the same amplitude in the first and the last third

Where dither just reverses the slip speed, both show a thin range of stability and an unstable range above it. The
boundary is the largest amplitude at which sliding is lost. Therefore amplitudes are tried from the largest downwards,
with a finer grid just above that place. In the first gap that contains a loss the averaged boundary is a zero of the
growth rate (rig.analysis.linear.eigenvalue_curves), and the simulated one is found by halving.
Source: Thomsen, J. Sound Vib. 228 (1999); Liu and Ouyang, Meccanica 55 (2020), sections 2 and 4.1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rig.analysis.cycles.averaged import averaged, fast_motion, not_fast
from rig.analysis.linear.eigenvalue_curves import Growth, edge, grows, limits, none
from rig.analysis.linear.modes import GENERATOR
from rig.analysis.map.job import Job
from rig.analysis.pool import Arrays
from rig.bench.free_rig import FreeRig
from rig.errors import NumericsError
from rig.results import Column, Result, Table
from rig.scenes.left_out import left_out
from rig.scenes.rooms import assembled
from rig.scenes.scene import Scene
from rig.scenes.sections import with_values

Array = NDArray[np.float64]
OFFSET = 0.02
"""Size of the initial displacement, over the displacement of sliding."""
SLOW = 60.0
"""Default length of a run, in slow periods."""
_SAMPLES = 64  # of a period of the dither
_CLOSE = 1e-3  # relative: smallest gap of the amplitude that is bisected
_ABOVE = (0.002, 0.005, 0.01, 0.02, 0.03, 0.05, 0.08)  # relative: the finer grid above a reversal of the slip speed
_LOST = 10.0  # initial displacements: a slow motion of this size has left sliding
_STILL = 1e-6  # of the largest rate: smaller ones are zero but for rounding


@dataclass(frozen=True)
class Boundary(Result):
    """The result of `rig.map` over dither.frequency and dither.amplitude.

    averaged    boundary at each frequency (SI); 0 if sliding is stable at all amplitudes, inf if at none
    leading     the same to leading order
    simulated   [frequency, 2]: largest amplitude at which sliding was lost, smallest one above it at which it was kept
    """

    FIGURE: ClassVar = "rig.analysis.map.figure:figure"

    job: Job
    averaged: Array
    leading: Array
    simulated: Array
    folder: Path

    @property
    def deviation(self) -> Array:
        """Relative deviation of the simulated from the averaged boundary."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.simulated.mean(axis=1) / self.averaged - 1.0)

    def shown(self) -> Iterator[str | Table]:
        """Yield the amplitudes over the frequency."""
        x, y = self.job.x, self.job.y
        assert y is not None
        yield f"{self.job.scene.name}: smallest amplitude of dither that keeps the rig sliding"
        if alone := left_out(self.job.scene):
            yield f"  {alone}"
        yield ""
        yield self.listed()
        least = y.text(min(y.values))
        most = y.text(max(y.values))
        yield "\n  leading: averaged to leading order; deviation: simulated from averaged"
        yield f"  0: the rig slides from the smallest on, {least}; inf: it does not slide even at the largest, {most}"
        slow = []
        for frequency in x.values:
            rig = _Shaken(x.at(self.job.scene, frequency), None)
            if not_fast(rig.system, rig.sine, rig.cosine):
                slow.append(x.text(frequency))
        if slow:
            yield f"  too slow for an average: {', '.join(slow)}"

    def facts(self) -> dict[str, Any]:
        """Return axes and amplitudes in SI units."""
        x, y = self.job.x, self.job.y
        assert y is not None
        return {
            "scene": self.job.scene.name,
            "left_out": left_out(self.job.scene),
            "x": {"key": x.key, "unit": x.unit, "values": list(x.values)},
            "y": {"key": y.key, "unit": y.unit, "values": list(y.values)},
            "leading": self.leading.tolist(),
            "averaged": self.averaged.tolist(),
            "simulated": self.simulated.tolist(),
            "deviation": self.deviation.tolist(),
            "folder": str(self.folder),
        }

    def listed(self) -> Table:
        """Return a row for each frequency."""
        x, y = self.job.x, self.job.y
        assert y is not None
        names = ("leading", "averaged", "simulated_lost", "simulated_kept")
        columns = (x.column(), *map(y.column, names), Column("deviation", "1", "+.2f", "%", 0.01))
        amplitudes = np.column_stack([self.leading, self.averaged, self.simulated, self.deviation]).tolist()
        return Table("boundary", columns, [(value, *row) for value, row in zip(x.values, amplitudes)])


def put_together(job: Job, rows: dict[int, Arrays], folder: Path) -> Boundary:
    """Assemble the boundary of a job from its frequencies."""
    tables = {}
    for name in rows[0]:
        tables[name] = np.array([rows[i][name] for i in range(len(job.units))])
    return Boundary(job, folder=folder, **tables)


def boundary(job: Job, column: int) -> Arrays:
    """Compute the boundary at one frequency."""
    assert job.y is not None
    amplitudes = job.y.values
    shaken = _Shaken(job.x.at(job.scene, job.x.values[column]), job.settings.longest)
    averages = {name: np.array(shaken.averaged(amplitudes, name == "leading")) for name in ("averaged", "leading")}
    return {**averages, "simulated": np.array(shaken.simulated(amplitudes))}


def _last(lost: Callable[[float], bool], amplitudes: Sequence[float]) -> tuple[float, float]:
    """The largest of the amplitudes at which sliding is lost, and the one above it, inf without one; 0 if at none."""
    for kept, amplitude in pairwise([math.inf, *amplitudes[::-1]]):
        if lost(amplitude):
            return amplitude, kept
    return 0.0, 0.0


class _Shaken:
    """A rig with dither of one frequency."""

    def __init__(self, scene: Scene, longest: float | None) -> None:
        self.longest = longest
        parameters = with_values(scene.parameters, {"dither.enable": True})
        assembly = assembled(parameters, scene.frame_ns, {}, random=False)
        self.rig = FreeRig(scene, assembly)
        self.system = self.rig.system
        self.sine, self.cosine = (self.system.names.index(name) for name in GENERATOR)
        self.omega = float(self.system.signals[self.sine - self.system.one, self.cosine])

    def _closely(self, amplitudes: Sequence[float], leading: bool) -> list[float]:
        """`amplitudes`, and a finer grid just above those at which dither reverses the slip speed of a contact."""
        still = self.system.start.copy()
        still[[self.sine, self.cosine]] = 0.0
        fast = np.abs(self.system.slip_rows @ fast_motion(self.system, self.sine, self.cosine, 1.0, leading))
        every = {*amplitudes}
        for patch, shake in zip(self.system.patches, fast):
            for share in _ABOVE if shake else ():
                above = float(abs(patch.surface @ still) / shake * (1.0 + share))
                if amplitudes[0] < above < amplitudes[-1]:
                    every.add(above)
        return sorted(every)

    def averaged(self, amplitudes: Sequence[float], leading: bool) -> float:
        """Return the amplitude from which on averaged sliding is stable; 0 if it is at all, inf if it is at none."""

        @cache
        def growths(amplitude: float) -> Growth | None:
            at = averaged(self.system, self.sine, self.cosine, amplitude, leading)
            rates = at.eigenvalues()
            return Growth(rates[:1].real, none(rates)[:1]) if at.exists else None

        lost, kept = _last(lambda amplitude: grows(growths(amplitude)), self._closely(amplitudes, leading))
        if not lost < kept < math.inf:
            return kept
        boundary, _ = limits([lost, kept], growths)[-1]
        return boundary

    def simulated(self, amplitudes: Sequence[float]) -> tuple[float, float]:
        """Return the largest amplitude at which sliding is lost, and the smallest one above it at which it is kept."""
        lost, kept = _last(self._lost, self._closely(amplitudes, False))
        return edge(lost, kept, self._lost, _CLOSE * kept) if lost < kept < math.inf else (lost, kept)

    def _lost(self, amplitude: float) -> bool:
        """Whether a run leaves sliding; a run that has to stop counts as lost."""
        at = averaged(self.system, self.sine, self.cosine, amplitude)
        rates, shapes = at.eigenvectors()
        nq = len(self.system.coordinates)
        shape = shapes[:, 0]
        length = float(np.linalg.norm(shape[:nq]))
        size = OFFSET * float(np.linalg.norm(at.x[:nq])) / length
        fast = fast_motion(self.system, self.sine, self.cosine, amplitude).real
        start = at.x + fast + size * shape.real
        step_ns = round(2.0 * math.pi / self.omega / _SAMPLES * 1e9)
        speeds = np.abs(rates)
        slowest = 2.0 * math.pi / float(speeds[speeds > _STILL * speeds.max()].min())
        third = round((self.longest or SLOW * slowest) / 3.0 / (step_ns * 1e-9) / _SAMPLES) * _SAMPLES
        motion = self.rig.in_motion(start, step_ns, longest=third)
        along = shape[:nq].conj() / length**2 / size
        swings = []
        try:
            for _ in range(3):
                motion.advance(third)
                means = motion.states[:, :nq].reshape(-1, _SAMPLES, nq).mean(axis=1) @ along
                swings.append(float(means.std()))
                if swings[-1] > _LOST:
                    return True
        except NumericsError:
            return True
        return swings[-1] > swings[0]
