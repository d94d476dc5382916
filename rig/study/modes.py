"""The eigenvalues of a rig at its sliding equilibrium: does sliding grow into vibration, how fast, at what frequency.

    exp(lambda t),  growth rate Re lambda [1/s], frequency Im lambda / 2 pi [Hz], damping ratio -Re lambda / |lambda|

The equilibrium is that of the scene's own values, commands held, lags settled, controllers left out. Dither is taken
as switched off there; what it does at its stated amplitude is told beside it, averaged (rig.study.averaged).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from rig.errors import SceneError
from rig.scenes.scene import Scene, plant_module
from rig.solve.assembly import Assembly
from rig.solve.finding import Finding
from rig.solve.linear import Steady, sliding_key, steady
from rig.solve.method import chosen
from rig.solve.signals import signal_rows
from rig.solve.system import System
from rig.solve.verdict import verdict
from rig.study.averaged import averaged

_REST = 1e-11  # of the sum of its terms, of the largest rate: what rounding leaves of a zero
_LARGE = 0.05  # of the largest amplitude: what is told of a shape that is long, and how many at most
_LONG, _MOST = 4, 6
GENERATOR = ("dither.sin", "dither.cos")


@dataclass(frozen=True)
class Mode:
    """One motion about the equilibrium; `shape` holds the amplitude of each state, the largest coordinate being 1."""

    growth: float
    frequency: float
    damping: float
    shape: dict[str, complex]

    @property
    def kind(self) -> str:
        """What such a motion is called."""
        if self.growth == 0.0 == self.frequency:
            return "stays"
        if abs(self.growth) <= 1e-9 * 2.0 * math.pi * self.frequency:
            return "neutral"
        if self.growth > 0.0:
            return "flutter" if self.frequency else "divergence"
        return "decays"


@dataclass(frozen=True)
class Sliding:
    """An equilibrium in sliding and the motions about it, the least stable first.

    `exists` is false where nothing slides steadily, `why` then says what keeps it; the numbers mean nothing, except
    that at constant coefficients the motions are the same wherever the equilibrium lies: they `count` also where the
    contact would have to pull. `equilibrium`: plant outputs; `coefficient`: friction over normal force of each contact.
    """

    exists: bool
    why: str
    counts: bool
    equilibrium: dict[str, float]
    coefficient: dict[str, float]
    modes: tuple[Mode, ...]

    @property
    def growth(self) -> float:
        """The largest growth rate [1/s]."""
        return max((mode.growth for mode in self.modes), default=math.nan)

    @property
    def stable(self) -> bool:
        """Whether every motion decays."""
        return self.exists and self.growth < 0.0


@dataclass(frozen=True)
class Modes:
    """What `modes` finds. `dithered` is None for a scene without dither; `amplitude` [unit] and `hertz` go with it.

    `free`: natural frequencies [Hz] of a part of the rig by itself. `limits`: coefficients of friction at which
    something of the rig is used up, in closed form (infinite: never).
    """

    scene: str
    mode: str
    sliding: Sliding
    units: dict[str, str]
    findings: tuple[Finding, ...]
    dithered: Sliding | None = None
    amplitude: float = 0.0
    unit: str = ""
    hertz: float = 0.0
    free: Mapping[str, float] = field(default_factory=dict)
    limits: Mapping[str, float] = field(default_factory=dict)

    COLUMNS: ClassVar = ("motion", "growth 1/s", "frequency Hz", "damping ratio", "shape")

    def table(self) -> list[tuple[str, float, float, float, str]]:
        """A row for each motion, in the order of COLUMNS."""
        found = [(mode.kind, mode) for mode in self.sliding.modes]
        found += [(f"{mode.kind}, dithered", mode) for mode in (self.dithered.modes if self.dithered else ())]
        return [(kind, one.growth, one.frequency, one.damping, told(one.shape)) for kind, one in found]

    def to_json(self) -> dict[str, Any]:
        """As plain values."""
        return {
            "scene": self.scene,
            "mode": self.mode,
            "units": self.units,
            **_plain(self.sliding),
            "dither": None
            if self.dithered is None
            else {"amplitude": self.amplitude, "unit": self.unit, "hertz": self.hertz, **_plain(self.dithered)},
            "free": dict(self.free),
            "limits": dict(self.limits),
            "findings": [finding.to_json() for finding in self.findings],
        }

    def text(self) -> str:
        """For a reader."""
        what = "steady sliding" if self.sliding.coefficient else "at rest"
        lines = [f"{self.scene}: {'' if self.sliding.exists else 'no '}{what} ({self.mode})"]
        if not self.sliding.exists:
            lines += [f"  nothing slides steadily with these values: {self.sliding.why}"]
        else:
            lines += [f"  {name} = {v:.6g} {self.units[name]}" for name, v in self.sliding.equilibrium.items()]
            lines += [f"  friction coefficient at {name} = {v:.6g}" for name, v in self.sliding.coefficient.items()]
        if self.sliding.exists or self.sliding.counts:
            lines += ["", "  {:<22}{:>12}{:>14}{:>15}  {}".format(*self.COLUMNS)]
            lines += [f"  {k:<22}{g:>12.6g}{f:>14.6g}{d:>15.4g}  {s}" for k, g, f, d, s in self.table()]
        if self.free:
            lines += ["", "  by itself:", *(f"  {name:<36}{hertz:>12.6g}" for name, hertz in self.free.items())]
        if self.limits:
            known = ", ".join(
                f"{name} {mu:.6g}" if math.isfinite(mu) else f"{name} never" for name, mu in self.limits.items()
            )
            lines += ["", f"  coefficients of friction at the limits: {known}"]
        if self.dithered is not None:
            effect = ", ".join(f"{v:.4g} at {name}" for name, v in self.dithered.coefficient.items())
            lines += [
                "",
                f"  dithered: {self.amplitude:g} {self.unit} at {self.hertz:g} Hz, friction {effect} (averaged)",
            ]
        lines += ["", *(f"  {f.level}: {f.what}\n    {f.remedy}" for f in self.findings)] if self.findings else []
        return "\n".join(lines)


def at_rest(scene: Scene, moved: Mapping[str, str] | None = None) -> tuple[Assembly, Steady]:
    """The rig of `scene` and its sliding equilibrium, dither off, controllers left out.

    `moved`: actuators that are states, as for a plant; by default those that the scene moves.
    """
    given = scene.moved if moved is None else moved
    assembly: Assembly = plant_module(scene.plant).assemble(scene.parameters, given)
    system = assembly.system()
    if GENERATOR[0] in system.names:
        quiet = system.start.copy()
        quiet[[system.names.index(name) for name in GENERATOR]] = 0.0
        system = replace(system, start=quiet)
    return assembly, steady(system, sliding_key(system))


def modes(scene: Scene) -> Modes:
    """The eigenvalues of `scene` at its sliding equilibrium. Raises SceneError exactly where it jams."""
    try:
        assembly, at = at_rest(scene)
    except np.linalg.LinAlgError:
        raise SceneError(scene.name, ["jams: friction takes up all of the inertia at just these values"]) from None
    system = at.system
    clock = scene.clock
    method = chosen(clock.method, system)
    substeps = max(1, scene.step_ns // int(clock.rk4_step))
    found = Modes(
        scene=scene.name,
        mode=system.describe(at.modes.key),
        sliding=_sliding(assembly, at),
        units={name: output.unit for name, output in assembly.outputs.items()},
        findings=tuple(verdict(system, method, scene.step_ns * 1e-9, substeps)),
        free=assembly.free,
        limits=assembly.limits,
    )
    if GENERATOR[0] not in system.names:
        return found
    sine, cosine = (system.names.index(name) for name in GENERATOR)
    generator = assembly.inputs["dither.amplitude"]
    return replace(
        found,
        dithered=_sliding(assembly, averaged(system, sine, cosine, generator.value)),
        amplitude=generator.value,
        unit=generator.unit,
        hertz=assembly.inputs["dither.frequency"].value,
    )


def _sliding(assembly: Assembly, at: Steady) -> Sliding:
    system = at.system
    over_x, over_t = signal_rows(system, at.modes, [output.row for output in assembly.outputs.values()])
    values = over_x @ at.x + over_t @ at.T
    rounding = _REST * (np.abs(over_x) @ np.abs(at.x) + np.abs(over_t) @ np.abs(at.T))
    units = np.array([output.unit for output in assembly.outputs.values()])
    largest = np.array([np.abs(values[units == unit]).max() for unit in units])
    values[np.abs(values) <= np.maximum(rounding, _REST * largest)] = 0.0
    rates, shapes = at.eigenvectors()
    zero = _REST * float(np.abs(rates).max(initial=0.0))
    slides = bool(np.all(at.modes.sigma * at.speed > 0.0))
    return Sliding(
        exists=at.exists,
        why="" if at.exists else _why(at),
        counts=at.exists or (slides and at.modes.jam > 0.0 and not at.modes.nonlinear.any()),
        equilibrium=dict(zip(assembly.outputs, values.tolist())),
        coefficient={
            p.name: abs(float(T)) / float(N) if N > 0.0 else math.nan
            for p, T, N in zip(system.patches, at.friction, at.load)
        },
        modes=tuple(
            _mode(system, 0.0 if abs(rate) <= zero else rate, shape)
            for rate, shape in zip(rates, shapes.T)
            if rate.imag >= 0.0
        ),
    )


def _why(at: Steady) -> str:
    """What keeps a rig from sliding steadily."""
    for patch, speed, load in zip(at.system.patches, at.speed.tolist(), at.load.tolist()):
        if speed == 0.0:
            return f"the surface at {patch.name} stands still"
        if load == 0.0:
            return f"nothing presses {patch.name}"
        if load < 0.0:
            return f"where all forces balance, {patch.name} would have to pull (normal force {load:.4g} N)"
    return "no such equilibrium is found"


def _mode(system: System, rate: complex, vector: Any) -> Mode:
    return Mode(
        growth=float(rate.real),
        frequency=float(rate.imag / (2.0 * math.pi)),
        damping=float(-rate.real / abs(rate)) if rate else 0.0,
        shape=shape(system.names, vector, len(system.coordinates)),
    )


def shape(names: Sequence[str], vector: Any, count: int) -> dict[str, complex]:
    """Amplitudes of an eigenvector by name, the largest of the first `count`, the coordinates, being 1."""
    first = int(np.abs(vector[:count]).argmax()) if np.any(vector[:count]) else int(np.abs(vector).argmax())
    return {name: complex(v) for name, v in zip(names, vector / vector[first]) if v}


def told(shape: Mapping[str, complex]) -> str:
    """A shape for a reader: size and angle of each amplitude; of long ones the large. Velocities follow from them.

    Of long ones that move, only what moves: volts and amperes are not to be compared with metres.
    """
    places = {name: v for name, v in shape.items() if name.removesuffix("'") == name or name[:-1] not in shape}
    moved = {name: v for name, v in places.items() if f"{name}'" in shape}
    places = moved if moved and len(places) > _LONG else places
    most = max(map(abs, places.values()), default=0.0)
    least = max(_LARGE * most, sorted(map(abs, places.values()))[-min(_MOST, len(places))]) if places else 0.0
    large = {name: v for name, v in places.items() if len(places) <= _LONG or abs(v) >= least}
    parts = [f"{name} {abs(v):.3g} at {_degrees(v)} deg" for name, v in large.items()]
    left = len(places) - len(large)
    return ", ".join(parts) + (f"; {left} below {least:.2g}" if left else "")


def _degrees(v: complex) -> int:
    """The angle of an amplitude; half a turn is told as such, whatever the side that rounding leaves it on."""
    angle = round(math.degrees(math.atan2(v.imag, v.real)))
    return 180 if angle == -180 else angle


def _plain(sliding: Sliding) -> dict[str, Any]:
    return {
        "exists": sliding.exists,
        "stable": sliding.stable,
        "why": sliding.why,
        "counts": sliding.counts,
        "equilibrium": sliding.equilibrium,
        "coefficient": sliding.coefficient,
        "modes": [
            {
                "kind": mode.kind,
                "growth": mode.growth,
                "frequency": mode.frequency,
                "damping": mode.damping,
                "shape": {name: [v.real, v.imag] for name, v in mode.shape.items()},
            }
            for mode in sliding.modes
        ],
    }
