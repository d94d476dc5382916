"""Eigenvalues of a rig at its sliding equilibrium: growth rate, frequency and shape of every vibration mode.

    exp(lambda t),  growth rate Re lambda [1/s], frequency Im lambda / 2 pi [Hz],
    damping ratio -Re lambda / |lambda|

The equilibrium belongs to the scene's own values, with commands held, lags settled and controllers left out. Dither
counts as switched off there; its effect at the stated amplitude is reported separately: averaged if the dither is fast
(rig.analysis.cycles.averaged), else as Floquet exponents of the forced motion (rig.analysis.cycles.floquet).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.analysis.cycles.averaged import averaged, not_fast
from rig.analysis.cycles.floquet import Forced, forced
from rig.analysis.linear.modes_report import Mode, Modes, Sliding
from rig.bench.run.before import findings
from rig.design.linearised import energy_form
from rig.errors import RigError, SceneError, Singular
from rig.model.assembly import Accuracy, Assembly, Output
from rig.model.formulation import signal_rows
from rig.model.system import System
from rig.scenes.left_out import left_out
from rig.scenes.rooms import assembled
from rig.scenes.scene import Scene
from rig.stability.linearisation import Steady, sliding_key, steady
from rig.structure.eigenvalues import DAMPED
from rig.structure.stated import Stated

Array = NDArray[np.float64]
GENERATOR = ("dither.sin", "dither.cos")
_REST = 1e-11  # rounding error of a zero, relative to the sum of its terms or to the largest rate


class Slow(RigError):
    """The friction cannot be averaged over the dither of a scene, for the reason in words."""


def at_rest(scene: Scene, moved: Mapping[str, str] | None = None, key: int | None = None) -> tuple[Assembly, Steady]:
    """Return the rig of `scene` and its sliding equilibrium, with dither off and without controllers.

    `moved`: actuators that are states, as for a plant; by default those that the scene moves. `key`: the mode set of
    sliding, where it is known.
    """
    states = scene.moved if moved is None else moved
    assembly = assembled(scene.parameters, scene.frame_ns, states, random=False, limits=scene.limits)
    system = assembly.sliding()
    if GENERATOR[0] in system.names:
        quiet = system.start.copy()
        quiet[[system.names.index(name) for name in GENERATOR]] = 0.0
        system = replace(system, start=quiet)
    return assembly, steady(system, sliding_key(system) if key is None else key)


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
    sliding = _sliding(assembly, at)
    notes: tuple[str, ...] = ()
    if assembly.accuracy is not None:
        moving = at.A[np.ix_(at.moving, at.moving)]
        accuracy = assembly.accuracy(moving, False)
        sliding = _estimated(sliding, accuracy)
        notes = accuracy.notes
    stated = scene.stated
    if stated is not None:
        sliding = replace(sliding, modes=tuple(_placed(mode, stated, system.names) for mode in sliding.modes))
    result = Modes(
        scene=scene.name,
        mode=system.describe(at.modes.key) + ", at rest on its bristles" * rests,
        sliding=sliding,
        up_to=assembly.up_to,
        nodes=assembly.nodes() if assembly.nodes is not None else None,
        units={name: output.unit for name, output in assembly.outputs.items()},
        findings=tuple(findings(scene, system if assembly.film is None else None)),
        free=assembly.free,
        limits=assembly.limits,
        notes=notes,
        left_out=left_out(scene),
        stated=stated,
    )
    if GENERATOR[0] not in system.names:
        return result
    sine, cosine = (system.names.index(name) for name in GENERATOR)
    generator = assembly.inputs["dither.amplitude"]
    slow = not_fast(system, sine, cosine) if generator.value else ""
    if slow:
        dithered = _forced(assembly, at, forced(scene, assembly, at, sine, cosine, generator.value))
    else:
        dithered = _sliding(assembly, averaged(system, sine, cosine, generator.value))
    return replace(
        result,
        dithered=dithered,
        slow=slow,
        amplitude=generator.value,
        unit=generator.unit,
        hertz=assembly.inputs["dither.frequency"].value,
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
    weighed = amplitudes.copy()
    if not rate:
        velocities = slice(coordinates, 2 * coordinates)
        weighed[velocities] = amplitudes[:coordinates]
        amplitudes[velocities] = 0.0
    energy = _shares(names, weighed[: len(form)], form)
    if energy:
        largest = names.index(max(energy, key=lambda name: energy[name]))
    else:
        largest = int(np.abs(amplitudes).argmax())
    shape = {name: complex(v) for name, v in zip(names, amplitudes / amplitudes[largest]) if v}
    return shape, energy


def _shares(names: Sequence[str], amplitudes: Any, form: Array) -> dict[str, float]:
    parts = np.abs(amplitudes.conj() * (form @ amplitudes))
    total = float(parts.sum())
    if not total > 0.0:
        return {}
    weighed = np.flatnonzero(form.any(axis=0)).tolist()
    return {names[i].removesuffix("'"): float(parts[i]) / total for i in weighed}


def _sliding(assembly: Assembly, at: Steady) -> Sliding:
    system = at.system
    forces = at.modes.normal @ at.x + at.modes.normal_t @ at.T
    film: dict[str, float] = {}
    if assembly.film is not None:  # it drags the structure in the direction of sliding
        state = dict(zip(system.names, at.x.tolist()))
        slid = assembly.signals[assembly.film.slid]
        speed = sum(rate * state[name] for name, rate in slid.items())
        film = assembly.film.sliding(forces, assembly.film.reach * speed)
    outputs: dict[str, Output] = {}
    pressures: dict[str, Output] = {}
    for name, output in assembly.outputs.items():
        of_film = film and film.keys() >= output.row.keys() and output.row
        (pressures if of_film else outputs)[name] = output
    equilibrium = _values(at, outputs)
    for name, output in pressures.items():
        equilibrium[name] = sum(share * film[point] for point, share in output.row.items())
    rates, shapes = at.eigenvectors()
    zero = _REST * float(np.abs(rates).max(initial=0.0))
    form = energy_form(at)
    vibrations = []
    for rate, shape in zip(rates, shapes.T):
        if _counts(rate, assembly.up_to):
            vibrations.append(_mode(system, 0.0 if abs(rate) <= zero else rate, shape, form))
    return Sliding(
        exists=at.exists,
        why="" if at.exists else missing(at),
        counts=at.counts,
        equilibrium=equilibrium,
        coefficient=_coefficient(system, at.friction, at.load),
        modes=tuple(vibrations),
        pulls=int(np.sum(forces < 0.0)) if film else 0,
    )


def _values(at: Steady, outputs: Mapping[str, Output]) -> dict[str, float]:
    """The outputs at an equilibrium; what is zero but for rounding is zero."""
    over_x, over_t = signal_rows(at.system, at.modes, [output.row for output in outputs.values()])
    values = over_x @ at.x + over_t @ at.T
    rounding = _REST * (np.abs(over_x) @ np.abs(at.x) + np.abs(over_t) @ np.abs(at.T))
    units = np.array([output.unit for output in outputs.values()])
    largest = np.array([np.abs(values[units == unit]).max() for unit in units])
    values[np.abs(values) <= np.maximum(rounding, _REST * largest)] = 0.0
    return dict(zip(outputs, values.tolist()))


def _coefficient(system: System, friction: Array, load: Array) -> dict[str, float]:
    """Friction over normal force of each contact; NaN where nothing presses."""
    ratios = {}
    for patch, tangential, normal in zip(system.patches, friction, load):
        ratios[patch.name] = abs(float(tangential)) / float(normal) if normal > 0.0 else math.nan
    return ratios


def _counts(rate: complex, up_to: float) -> bool:
    """Whether an eigenvalue is the upper one of a pair, and within what a reduction up to `up_to` [Hz] represents."""
    if not 0.0 <= rate.imag <= 2.0 * math.pi * up_to:
        return False
    return math.isinf(up_to) or rate.real > 0.0 or abs(rate.real) <= DAMPED * rate.imag


def _mode(system: System, rate: complex, vector: Any, form: Array) -> Mode:
    amplitudes, energy = motion(system.names, vector, form, rate, len(system.coordinates))
    return Mode(
        growth=float(rate.real),
        frequency=float(rate.imag / (2.0 * math.pi)),
        damping=float(-rate.real / abs(rate)) if rate else 0.0,
        shape=amplitudes,
        energy=energy,
    )


def _estimated(sliding: Sliding, accuracy: Accuracy) -> Sliding:
    """The same with the estimated error of each eigenvalue that has one."""
    rates = np.array([complex(mode.growth, 2.0 * math.pi * mode.frequency) for mode in sliding.modes])
    vibrations = []
    for mode, error in zip(sliding.modes, accuracy.of(rates).tolist()):
        vibrations.append(replace(mode, error=None if math.isnan(error) else error))
    return replace(sliding, modes=tuple(vibrations))


def _placed(mode: Mode, stated: Stated, names: Sequence[str]) -> Mode:
    """The same with the bodies or node sets that move."""
    return replace(mode, regions=stated.shares(mode.shape, mode.energy, names))


def _forced(assembly: Assembly, at: Steady, motion: Forced) -> Sliding:
    """A forced motion, with means over its period in the place of the equilibrium."""
    form = energy_form(at)
    means: dict[str, float] = {}
    coefficient: dict[str, float] = {}
    if motion.means is not None:
        x, T, friction, load = motion.means
        over_x, over_t = signal_rows(at.system, at.modes, [output.row for output in assembly.outputs.values()])
        means = dict(zip(assembly.outputs, (over_x @ x + over_t @ T).tolist()))
        coefficient = _coefficient(at.system, friction, load)
    upper = [(rate, shape) for rate, shape in zip(motion.exponents, motion.shapes.T) if rate.imag >= 0.0]
    return Sliding(
        exists=motion.exists,
        why=motion.why,
        counts=motion.counts,
        equilibrium=means,
        coefficient=coefficient,
        modes=tuple(_mode(at.system, rate, shape, form) for rate, shape in upper),
    )
