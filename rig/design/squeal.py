"""Numbers for the controllers of a squealing brake: sample periods, the stack, and the modes of a band.

A command u moves mode i of the sliding rig, and a sensor sees it, by

    xi_i' = lambda_i xi_i + r_i u,   y = 2 Re sum xi_i,   r_i = (c x_i)(y_i^H b) / (y_i^H x_i)

x_i, y_i: right and left eigenvector, b: what a unit of u does to the rig (its lag included), c: what the sensor reads.
Instrument and delays turn r_i further. From these modes follow a feedback (least v^2 + (u/effort)^2) and an observer.
Source: Kroeger, Neubauer, Popp (2008), section 4a, figure 21; linear quadratic design, see any text on control.
"""

from __future__ import annotations

import cmath
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.controllers.narrow_band import NarrowBandFeedback
from rig.design.designer import Designer
from rig.design.linearised import linear
from rig.design.sampled import sampled
from rig.stability.linearisation import Steady, sliding_key, steady

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
LEAST = 1e-6  # of what the disturbance does to all modes: what each is shaken at least


def heard(designer: Designer, section: Any) -> dict[str, Any]:
    """The sample period of the sensor that a controller hears sample by sample."""
    period = 1e-9 * designer.sensors[section.sensor].instants.period_ns
    if period > section.period * 1e-9:
        raise ValueError(
            f"sensor: {section.sensor} gives a sample every {period:g} s; expected one at least in each period of "
            f"{section.period * 1e-9:g} s"
        )
    if 2.0 * section.frequency * period >= 1.0:
        raise ValueError(f"frequency: {section.frequency:g} Hz is beyond half the sample rate of {section.sensor}")
    return {"sample_period": period}


def tuner(designer: Designer, section: Any) -> dict[str, Any]:
    """The stack's capacitance and the relative negative capacitance of its shunt."""
    piezo, shunt = (getattr(designer.parameters, name, None) for name in ("piezo", "shunt"))
    if piezo is None or shunt is None or not hasattr(shunt, "delta"):
        raise ValueError('kind: tunes a shunt of kind "series" on a piezo stack, and the scene has none')
    told = {"capacitance": piezo.capacitance, "delta": shunt.delta, "inductance": shunt.inductance}
    return heard(designer, section) | told


def narrow_band(designer: Designer, section: Any) -> dict[str, Any]:
    """Observer and feedback of the modes in the band, as pairs (real, imaginary part), one for each mode.

    Raises ValueError where a mode of the rig, in the band or outside, would grow with it.
    """
    import control

    rig = steady(designer.system, sliding_key(designer.system))
    values, right = np.linalg.eig(rig.A[np.ix_(rig.moving, rig.moving)])
    near = np.abs(values.imag / (2.0 * math.pi) - section.frequency) < 0.5 * section.bandwidth
    near &= values.imag > 0.0
    if not near.any():
        found = ", ".join(f"{f}" for f in sorted({round(v.imag / (2.0 * math.pi)) for v in values if v.imag > 0.0}))
        raise ValueError(f"frequency: no mode is in the band about {section.frequency:g} Hz; there are {found} Hz")
    modes, period = values[near], section.period * 1e-9
    residues = _residues(designer, section, rig, values, right)[near]
    residues = residues * np.array([_path(designer.sensors[section.sensor], section, s) for s in modes])
    poles = np.exp(modes * period)
    driven = residues * (poles - 1.0) / modes
    F, G, C = _real(np.diag(poles)), _parts(driven)[:, None], np.tile([2.0, 0.0], len(modes))[None, :]
    k, _, _ = control.dlqr(F, G, C.T @ C, np.array([[section.effort**-2]]))
    shaken = section.disturbance**2 * G @ G.T
    least = LEAST * np.trace(shaken) * np.eye(len(F))  # a mode that nothing shakes would never be corrected
    _, P, _ = control.dlqe(F, np.eye(len(F)), C, shaken + least, np.array([[section.noise**2]]))
    corrected = (P @ C.T / (C @ P @ C.T + section.noise**2)).ravel()
    pairs = {"driven": driven, "corrected": _complex(corrected), "fed_back": _complex(k.ravel())}
    numbers = {"poles": _pairs(poles)} | {name: _pairs(values) for name, values in pairs.items()}
    _stable(rig, designer, section, numbers)
    return numbers


def _residues(designer: Designer, section: Any, rig: Steady, values: Complex, right: Complex) -> Complex:
    """What a unit of the command does to each mode, measured in what the sensor reads of it."""
    given = designer.assembly.inputs.get(section.drive)
    if given is None or not given.state:
        raise ValueError(f"drive: {section.drive} is no actuator that a state carries")
    command, A, moving = designer.system.names.index(given.state), rig.A, rig.moving
    rest = np.setdiff1d(np.arange(len(A)), [*moving, command])
    left = np.linalg.inv(right)
    seen = _reading(designer, section)[moving] @ right
    pushed = np.empty(len(values), dtype=complex)
    for i, s in enumerate(values):  # through the lags behind the command, at the pace of the mode
        behind = np.linalg.solve(s * np.eye(len(rest)) - A[np.ix_(rest, rest)], A[rest, command])
        pushed[i] = left[i] @ (A[moving, command] + A[np.ix_(moving, rest)] @ behind)
    return seen * pushed


def _reading(designer: Designer, section: Any) -> Array:
    """What the sensor reads, as a row over the states of the rig."""
    row = np.zeros(designer.system.n)
    over = designer.row(designer.sensors[section.sensor].reads)[: 2 * designer.nq]
    row[: len(over)] = over
    return row


def _path(sensor: Any, section: Any, s: complex) -> complex:
    """What instrument and delays make of a vibration exp(s t)."""
    return complex(sensor.front_end().response(s) * cmath.exp(-s * 1e-9 * section.delay))


def _stable(rig: Steady, designer: Designer, section: Any, numbers: dict[str, Any]) -> None:
    """Close the loop around the whole rig, with instrument, delays, sample and hold; ValueError where it grows."""
    sensor, feedback = designer.sensors[section.sensor], NarrowBandFeedback(section, numbers)
    model = sampled(linear(designer.assembly, rig), feedback, sensor.reads, sensor.front_end(), section.delay)
    z = np.linalg.eigvals(model.closed())
    worst = z[np.argmax(np.abs(z))]
    if abs(worst) > 1.0 + 1e-12:
        rate, frequency = math.log(abs(worst)) / model.period, abs(cmath.phase(worst)) / (2.0 * math.pi * model.period)
        raise ValueError(
            f"effort: with {section.effort:g} V s/m a mode at {frequency:.0f} Hz grows with {rate:.3g} 1/s; "
            "less effort, more noise, or a wider band"
        )


def _pairs(numbers: Complex) -> list[list[float]]:
    return [[float(z.real), float(z.imag)] for z in numbers]


def _parts(numbers: Complex) -> Array:
    """[re, im, re, im, ...]"""
    return np.column_stack([numbers.real, numbers.imag]).ravel()


def _complex(parts: Array) -> Complex:
    return np.asarray(parts[0::2] + 1j * parts[1::2])


def _real(matrix: Complex) -> Array:
    """A complex matrix as a real one over real and imaginary parts in turn."""
    turned = np.array([[0.0, -1.0], [1.0, 0.0]])
    return np.asarray(np.kron(matrix.real, np.eye(2)) + np.kron(matrix.imag, turned))
