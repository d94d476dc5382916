"""Eigenvalues of a rig at its sliding equilibrium: growth rate, frequency and shape of every vibration mode.

    exp(lambda t),  growth rate Re lambda [1/s], frequency Im lambda / 2 pi [Hz],
    damping ratio -Re lambda / |lambda|

The equilibrium belongs to the scene's own values, with commands held, lags settled and controllers left out. Dither
counts as switched off there; its effect at the stated amplitude is reported separately: averaged if the dither is fast
(rig.analysis.averaged), else as Floquet exponents of the forced motion (rig.analysis.floquet).

The report of `rig modes`: a sliding equilibrium and its vibration modes, as records, text, table and JSON.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rig.analysis.averaged import averaged, not_fast
from rig.analysis.floquet import Forced, forced
from rig.bench.run.before import findings
from rig.design.linearised import energy_form
from rig.errors import RigError, SceneError, Singular
from rig.model.assembly import Accuracy, Assembly, Nodes
from rig.model.formulation import signal_rows
from rig.model.system import Finding, System
from rig.printable import columns
from rig.record.film_points import grouped
from rig.results import Result
from rig.scenes.left_out import left_out
from rig.scenes.rooms import assembled
from rig.scenes.scene import Scene
from rig.stability.linearisation import Steady, sliding_key, steady
from rig.structure.eigenvalues import DAMPED

_REST = 1e-11  # rounding error of a zero, relative to the sum of its terms or to the largest rate
Array = NDArray[np.float64]
GENERATOR = ("dither.sin", "dither.cos")
_LEAST = 0.01  # of the energy: smallest share shown of a long shape, and how many at most
_LONG, _MOST = 4, 6


class Slow(RigError):
    """The friction cannot be averaged over the dither of a scene, for the reason in words."""


def at_rest(scene: Scene, moved: Mapping[str, str] | None = None) -> tuple[Assembly, Steady]:
    """Return the rig of `scene` and its sliding equilibrium, with dither off and without controllers.

    `moved`: actuators that are states, as for a plant; by default those that the scene moves.
    """
    given = scene.moved if moved is None else moved
    assembly = assembled(scene.parameters, scene.frame_ns, given, random=False, limits=scene.limits)
    system = assembly.sliding()
    if GENERATOR[0] in system.names:
        quiet = system.start.copy()
        quiet[[system.names.index(name) for name in GENERATOR]] = 0.0
        system = replace(system, start=quiet)
    return assembly, steady(system, sliding_key(system))


def under_dither(scene: Scene) -> Steady:
    """Return the sliding equilibrium with the friction averaged over the dither of `scene`.

    Raises Slow if the dither is not fast.
    """
    assembly, at = at_rest(scene)
    sine, cosine = (at.system.names.index(name) for name in GENERATOR)
    if why := not_fast(at.system, sine, cosine):
        raise Slow(why)
    return averaged(at.system, sine, cosine, assembly.inputs["dither.amplitude"].value)


def dithers(scene: Scene, key: str) -> bool | None:
    """Return whether an analysis over `key` averages the friction over dither; None if `scene` has no dither.

    It does if the key belongs to the dither or the scene switches its dither on.
    """
    dither = getattr(scene.parameters, "dither", None)
    return None if dither is None else dither.enable or key.startswith("dither.")


def modes(scene: Scene) -> Modes:
    """Compute the eigenvalues of `scene` at its sliding equilibrium.

    Raises SceneError if its equations are singular.
    """
    try:
        assembly, at = at_rest(scene)
    except Singular as error:
        raise SceneError(scene.name, [error.why]) from None
    system = at.system
    rests = bool(at.exists and len(at.speed) and not at.speed.any())
    accuracy = assembly.accuracy(at.A[np.ix_(at.moving, at.moving)], False) if assembly.accuracy is not None else None
    result = Modes(
        scene=scene.name,
        mode=system.describe(at.modes.key) + ", at rest on its bristles" * rests,
        sliding=_sliding(assembly, at) if accuracy is None else _estimated(_sliding(assembly, at), accuracy),
        up_to=assembly.up_to,
        nodes=assembly.nodes() if assembly.nodes is not None else None,
        units={name: output.unit for name, output in assembly.outputs.items()},
        findings=tuple(findings(scene, system if assembly.film is None else None)),
        free=assembly.free,
        limits=assembly.limits,
        notes=accuracy.notes if accuracy is not None else (),
        left_out=left_out(scene),
    )
    if GENERATOR[0] not in system.names:
        return result
    sine, cosine = (system.names.index(name) for name in GENERATOR)
    generator = assembly.inputs["dither.amplitude"]
    slow = not_fast(system, sine, cosine) if generator.value else ""
    return replace(
        result,
        dithered=_forced(assembly, at, forced(scene, assembly, at, sine, cosine, generator.value))
        if slow
        else _sliding(assembly, averaged(system, sine, cosine, generator.value)),
        slow=slow,
        amplitude=generator.value,
        unit=generator.unit,
        hertz=assembly.inputs["dither.frequency"].value,
    )


def _estimated(sliding: Sliding, accuracy: Accuracy) -> Sliding:
    """The same with the estimated error of each eigenvalue that has one."""
    rates = np.array([complex(mode.growth, 2.0 * math.pi * mode.frequency) for mode in sliding.modes])
    errors = [None if math.isnan(error) else error for error in accuracy.of(rates).tolist()]
    return replace(sliding, modes=tuple(replace(mode, error=e) for mode, e in zip(sliding.modes, errors)))


def _forced(assembly: Assembly, at: Steady, motion: Forced) -> Sliding:
    """A forced motion, with means over its period in the place of the equilibrium."""
    form, means, coefficient = energy_form(at), {}, {}
    if motion.means is not None:
        x, T, friction, load = motion.means
        over_x, over_t = signal_rows(at.system, at.modes, [output.row for output in assembly.outputs.values()])
        means = dict(zip(assembly.outputs, (over_x @ x + over_t @ T).tolist()))
        coefficient = {
            p.name: abs(float(rubbed)) / float(pressed) if pressed > 0.0 else math.nan
            for p, rubbed, pressed in zip(at.system.patches, friction, load)
        }
    return Sliding(
        exists=motion.exists,
        why=motion.why,
        counts=motion.counts,
        equilibrium=means,
        coefficient=coefficient,
        modes=tuple(
            _mode(at.system, rate, shape, form)
            for rate, shape in zip(motion.exponents, motion.shapes.T)
            if rate.imag >= 0.0
        ),
    )


def _sliding(assembly: Assembly, at: Steady) -> Sliding:
    system = at.system
    forces = at.modes.normal @ at.x + at.modes.normal_t @ at.T
    film: dict[str, float] = {}
    if assembly.film is not None:  # it drags the structure in the direction of sliding
        state = dict(zip(system.names, at.x.tolist()))
        speed = sum(rate * state[name] for name, rate in assembly.signals[assembly.film.slid].items())
        film = assembly.film.sliding(forces, assembly.film.reach * speed)
    pressed = {n: o.row for n, o in assembly.outputs.items() if film and film.keys() >= o.row.keys() and o.row}
    outputs = {name: output for name, output in assembly.outputs.items() if name not in pressed}
    over_x, over_t = signal_rows(system, at.modes, [output.row for output in outputs.values()])
    values = over_x @ at.x + over_t @ at.T
    rounding = _REST * (np.abs(over_x) @ np.abs(at.x) + np.abs(over_t) @ np.abs(at.T))
    units = np.array([output.unit for output in outputs.values()])
    largest = np.array([np.abs(values[units == unit]).max() for unit in units])
    values[np.abs(values) <= np.maximum(rounding, _REST * largest)] = 0.0
    rates, shapes = at.eigenvectors()
    zero = _REST * float(np.abs(rates).max(initial=0.0))
    form = energy_form(at)
    return Sliding(
        exists=at.exists,
        why="" if at.exists else missing(at),
        counts=at.counts,
        equilibrium=dict(zip(outputs, values.tolist()))
        | {name: sum(share * film[of] for of, share in row.items()) for name, row in pressed.items() if film},
        coefficient={
            p.name: abs(float(T)) / float(N) if N > 0.0 else math.nan
            for p, T, N in zip(system.patches, at.friction, at.load)
        },
        modes=tuple(
            _mode(system, 0.0 if abs(rate) <= zero else rate, shape, form)
            for rate, shape in zip(rates, shapes.T)
            if 0.0 <= rate.imag <= 2.0 * math.pi * assembly.up_to
            and (math.isinf(assembly.up_to) or rate.real > 0.0 or abs(rate.real) <= DAMPED * rate.imag)
        ),
        pulls=int(np.sum(forces < 0.0)) if film else 0,
    )


def missing(at: Steady) -> str:
    """Return the reason why a rig has no steady sliding."""
    if at.beyond:
        return at.beyond
    contacts = list(zip(at.system.patches, at.speed.tolist(), at.load.tolist()))
    for patch, speed, load in contacts:
        if speed == 0.0:
            return f"the surface at {patch.name} does not move"
        if load < 0.0 and at.balanced:
            return f"where all forces balance, {patch.name} would have to pull (normal force {load:.4g} N)"
    if at.inertia <= 0.0:
        return "friction takes up all of the inertia"
    if at.unheld:
        return at.unheld
    for patch, _, load in contacts:
        if load == 0.0:
            return f"nothing presses {patch.name}"
    return "the solver finds no such equilibrium"


def _mode(system: System, rate: complex, vector: Any, form: Array) -> Mode:
    amplitudes, energy = motion(system.names, vector, form, rate, len(system.coordinates))
    return Mode(
        growth=float(rate.real),
        frequency=float(rate.imag / (2.0 * math.pi)),
        damping=float(-rate.real / abs(rate)) if rate else 0.0,
        shape=amplitudes,
        energy=energy,
    )


def motion(
    names: Sequence[str], vector: Any, form: Array, rate: complex, coordinates: int
) -> tuple[dict[str, complex], dict[str, float]]:
    """Return amplitudes of an eigenvector by name, and the share of each coordinate and network state in its energy.

    `form`: over the first of the states (`energy_form`), which begin with the `coordinates`. Energy makes metres,
    radians and volts comparable. At a rate of zero nothing moves: there the masses weigh the displacements, which is
    the limit of a rate that goes to zero. The amplitude with most of the energy is 1; without energy it is the largest
    amplitude, and no share is returned.
    """
    amplitudes = np.array(vector, dtype=np.complex128)
    weighed, velocities = amplitudes.copy(), slice(coordinates, 2 * coordinates)
    if not rate:
        weighed[velocities], amplitudes[velocities] = amplitudes[:coordinates], 0.0
    energy = _shares(names, weighed[: len(form)], form)
    first = names.index(max(energy, key=lambda name: energy[name])) if energy else int(np.abs(amplitudes).argmax())
    return {name: complex(v) for name, v in zip(names, amplitudes / amplitudes[first]) if v}, energy


def _shares(names: Sequence[str], amplitudes: Any, form: Array) -> dict[str, float]:
    parts = np.abs(amplitudes.conj() * (form @ amplitudes))
    weighed = np.flatnonzero(form.any(axis=0)).tolist()
    total = float(parts.sum())
    return {names[i].removesuffix("'"): float(parts[i]) / total for i in weighed} if total > 0.0 else {}


@dataclass(frozen=True)
class Mode:
    """One vibration mode about the equilibrium.

    `energy`: share of each coordinate in the kinetic energy, and of each network state in the network's energy, which
    makes metres, radians and volts comparable. `shape`: amplitude of each state; the one with the largest share is 1.
    `error`: of a reduced structure, the estimated error of the eigenvalue over its size; None if it is not known.
    """

    growth: float
    frequency: float
    damping: float
    shape: dict[str, complex]
    energy: dict[str, float]
    error: float | None = None

    @property
    def kind(self) -> str:
        """The kind of mode, in words; undecided where the growth is smaller than its estimated error."""
        if self.growth == 0.0 == self.frequency:
            return "stays"
        if abs(self.growth) <= 1e-9 * 2.0 * math.pi * self.frequency:
            return "neutral"
        if self.error is not None and abs(self.growth) <= self.error * 2.0 * math.pi * self.frequency:
            return "undecided"
        if self.growth > 0.0:
            return "flutter" if self.frequency else "divergence"
        return "decays"


@dataclass(frozen=True)
class Sliding:
    """A sliding equilibrium and the modes about it, least stable first.

    `exists` is false without steady sliding, and `why` has the reason. The numbers are then invalid, with one
    exception: at constant coefficients the modes do not depend on the place of the equilibrium, so that they `count`
    also where the contact would have to pull. `equilibrium`: plant outputs; `coefficient`: friction over normal force
    of each contact. `pulls`: number of points of a film that would have to pull; the modes are those with all points
    closed.
    """

    exists: bool
    why: str
    counts: bool
    equilibrium: dict[str, float]
    coefficient: dict[str, float]
    modes: tuple[Mode, ...]
    pulls: int = 0

    @property
    def growth(self) -> float:
        """The largest growth rate [1/s]."""
        return max((mode.growth for mode in self.modes), default=math.nan)

    @property
    def stable(self) -> bool:
        """Whether every mode decays."""
        return self.exists and all(mode.growth < 0.0 for mode in self.modes)


@dataclass(frozen=True)
class Modes(Result):
    """The vibration modes of a scene at steady sliding (`rig.analysis.modes.modes`).

    `dithered`: the same with averaged dither of `amplitude` [unit] at `hertz`; None for a scene without dither. `slow`:
    why the dither cannot be averaged; `dithered` is then the forced motion, and its modes are Floquet exponents.
    `free`: natural frequencies [Hz] of a part of the rig by itself. `limits`: critical coefficients of friction in
    closed form (infinite: never reached). `notes`: what the reduction of a structure leaves open, a sentence each;
    `up_to` [Hz]: it holds up to it; modes above, and heavily damped ones, are left out. `nodes`: of shapes.
    `left_out`: the controllers that do not act, in words.
    """

    FIGURE: ClassVar = "rig.analysis.figures:modes_figure"

    scene: str
    mode: str
    sliding: Sliding
    units: dict[str, str]
    findings: tuple[Finding, ...]
    dithered: Sliding | None = None
    amplitude: float = 0.0
    unit: str = ""
    hertz: float = 0.0
    slow: str = ""
    free: Mapping[str, float] = field(default_factory=dict)
    limits: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    up_to: float = math.inf
    nodes: Nodes | None = field(default=None, compare=False)
    left_out: str = ""

    COLUMNS: ClassVar = ("mode", "growth 1/s", "frequency Hz", "damping ratio", "shape (share of the energy)")

    def table(self) -> list[tuple[str, float, float, float, str]]:
        """Return a row for each mode, in the order of COLUMNS."""
        rows, how = [(mode.kind, mode) for mode in self.sliding.modes], "forced" if self.slow else "dithered"
        rows += [(f"{mode.kind}, {how}", mode) for mode in (self.dithered.modes if self.dithered else ())]
        return [
            (
                kind,
                vibration.growth,
                vibration.frequency,
                vibration.damping,
                shape_text(vibration.shape, vibration.energy),
            )
            for kind, vibration in rows
        ]

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {
            "scene": self.scene,
            "mode": self.mode,
            "units": self.units,
            **_plain(self.sliding),
            "dither": None
            if self.dithered is None
            else {
                "amplitude": self.amplitude,
                "unit": self.unit,
                "hertz": self.hertz,
                "slow": self.slow,
                **_plain(self.dithered),
            },
            "free": dict(self.free),
            "limits": dict(self.limits),
            "findings": [finding.to_json() for finding in self.findings],
            "left_out": self.left_out,
            **({"notes": list(self.notes), "up_to": self.up_to} if math.isfinite(self.up_to) else {}),
        }

    def text(self) -> str:
        """Return the report as text."""
        what = "steady sliding" if self.sliding.coefficient else "at rest"
        lines = [f"{self.scene}: {'' if self.sliding.exists else 'no '}{what} ({self.mode})"]
        lines += [f"  {self.left_out}"] if self.left_out else []
        if not self.sliding.exists:
            lines += [f"  no steady sliding at these values: {self.sliding.why}"]
        else:
            lines += self._outputs()
        if self.sliding.pulls:
            lines += [f"  {self.sliding.pulls} points would have to pull; the modes below count all points as closed"]
        if self.sliding.exists or self.sliding.counts:
            rows = [(k, f"{g:.6g}", f"{f:.6g}", f"{d:.4g}", s) for k, g, f, d, s in self.table()]
            errors = [mode.error for mode in self.sliding.modes]
            if any(error is not None for error in errors):
                shown = ["estimated error", *("" if error is None else f"{error:.1e}" for error in errors)]
                cells = [*shown, *[""] * (1 + len(rows) - len(shown))]
                wider = [(*row[:4], cell, row[4]) for row, cell in zip([self.COLUMNS, *rows], cells)]
                lines += ["", *columns(wider, "<>>>><")]
            else:
                lines += ["", *columns([self.COLUMNS, *rows], "<>>><")]
            if math.isfinite(self.up_to):
                lines += [f"  the reduction of the structure holds up to {self.up_to:g} Hz; "
                          "higher and heavily damped modes are left out"]  # fmt: skip
        lines += ["", *(f"  warning: {note}" for note in self.notes)] if self.notes else []
        if self.free:
            free = [(name, f"{hertz:.6g}") for name, hertz in self.free.items()]
            lines += ["", "  natural frequencies of parts by themselves [Hz]:", *columns(free, "<>")]
        if self.limits:
            known = ", ".join(
                f"{name} {mu:.6g}" if math.isfinite(mu) else f"{name} never" for name, mu in self.limits.items()
            )
            lines += ["", f"  coefficients of friction at the limits: {known}"]
        if self.dithered is not None:
            effect = ", ".join(f"{v:.4g} at {name}" for name, v in self.dithered.coefficient.items())
            lines += ["", f"  dithered: {self.amplitude:g} {self.unit} at {self.hertz:g} Hz"]
            if not self.slow:
                lines[-1] += f", friction {effect} (averaged)"
            else:
                forced = (
                    "Floquet exponents of the forced motion"
                    if self.dithered.exists or self.dithered.counts
                    else "no result"
                )
                lines += [f"    not averaged: {self.slow}", f"    {forced}"]
                lines[-1] += f", mean friction {effect}" if effect else ""
                if self.dithered.why:
                    held = self.dithered.counts and not self.dithered.exists
                    closed = "; they are those of the contact held closed" if held else ""
                    lines[-1] += f": {self.dithered.why}{closed}"
        lines += ["", *(f"  {f.level}: {f.what}\n    {f.remedy}" for f in self.findings)] if self.findings else []
        return "\n".join(lines)

    def summary(self) -> str:
        """Return the stability in one sentence: the mode that grows fastest, or that decays most slowly."""
        what = "steady sliding" if self.sliding.coefficient else "rest"
        told = [f"{what} {_stability(self.sliding)}"]
        if self.dithered is not None:
            told.append(f"with dither it {_stability(self.dithered)}")
        return "; ".join([*told, *filter(None, [self.left_out])])

    def _outputs(self) -> Iterator[str]:
        """The outputs at equilibrium; a row of places (`pressure_3_2`) as a range."""
        for common, names in grouped(self.sliding.equilibrium).items():
            unit, values = self.units[names[0]], [self.sliding.equilibrium[name] for name in names]
            if len(names) == 1:
                yield f"  {names[0]} = {values[0]:.6g} {unit}"
            else:
                span = f"{min(values):.6g} to {max(values):.6g} {unit}"
                yield f"  {common.removesuffix('_of')} of {len(names)} points: {span}"


def _stability(sliding: Sliding) -> str:
    """Predicate of a sentence on the stability of an equilibrium."""
    if not sliding.exists:
        return f"does not exist at these values: {sliding.why}" if sliding.why else "does not exist at these values"
    if not sliding.modes:
        return "has no vibration mode"
    mode = max(sliding.modes, key=lambda mode: mode.growth)
    at = f" at {mode.frequency:.4g} Hz" if mode.frequency else ""
    if mode.growth > 0.0:
        return f"is unstable: {mode.kind} grows with {mode.growth:.4g} 1/s{at}"
    if mode.growth == 0.0:
        return f"neither decays nor grows: {mode.kind}{at}"
    return f"is stable: the slowest mode decays with {-mode.growth:.4g} 1/s{at}"


def shape_text(shape: Mapping[str, complex], energy: Mapping[str, float]) -> str:
    """Return a shape as text: energy share and angle of each coordinate and network state; only the large ones of many.

    Without energy: size and angle of each state.
    """
    if not energy:
        return ", ".join(f"{name} {abs(v):.3g} at {_degrees(v)} deg" for name, v in shape.items())
    least = max(_LEAST, sorted(energy.values())[-min(_MOST, len(energy))] if len(energy) > _LONG else 0.0)
    large = {name: share for name, share in energy.items() if share >= least}
    parts = [f"{name} {100.0 * share:.3g} % at {_degrees(shape[name])} deg" for name, share in large.items()]
    left = sum(share > 0.0 for share in energy.values()) - len(large)
    return ", ".join(parts) + (f"; {left} with less than {100.0 * least:.2g} %" if left else "")


def _degrees(v: complex) -> int:
    """The angle of an amplitude; half a turn always has the same sign, whatever the rounding."""
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
        "pulls": sliding.pulls,
        "modes": [
            {
                "kind": mode.kind,
                "growth": mode.growth,
                "frequency": mode.frequency,
                "damping": mode.damping,
                "shape": {name: [v.real, v.imag] for name, v in mode.shape.items()},
                "energy": mode.energy,
                **({} if mode.error is None else {"error": mode.error}),
            }
            for mode in sliding.modes
        ],
    }
