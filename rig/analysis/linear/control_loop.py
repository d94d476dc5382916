"""A control loop of a scene, linearised: closed-loop eigenvalues, gain range, phase margin and delay margin.

The loop contains the controller with its own parameters, its sensor, its delay, and sample and hold, all discretised
exactly (rig.design.sampled_loops). Margins come from the exact frequency response L(exp(i w T)) of the open loop. A rig
with friction may be unstable without control. Therefore the gain has a range instead of one margin: below it friction
destabilises the rig, above it the loop does.

    gain range     gains of both signs between which every eigenvalue decays
    phase margin   the smallest phase at |L| = 1 that makes L = -1
    delay margin   the same phase as a delay, phase / w

The plant is the rig at the sliding equilibrium of the scene's own values, from actuators to outputs. Limits of the
actuators are left out, and dither is off.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rig import controllers
from rig.analysis.linear.eigenvalue_curves import Spectrum, absent, of_matrix
from rig.analysis.linear.modes import at_rest, missing
from rig.analysis.linear.sweep import Sweep, along
from rig.design import numbers
from rig.design.linearised import Plant, linear, linear_form
from rig.design.sampled_loops import ControlLoop, Sampled, sampled
from rig.errors import PartError, SceneError, Singular
from rig.quantities import unit_of
from rig.results import Column, Result, Table
from rig.scenes.axis import Axis
from rig.scenes.belief import lines as belief_lines
from rig.scenes.belief import of_varied
from rig.scenes.faults import near
from rig.scenes.left_out import left_out
from rig.scenes.rooms import assembled
from rig.scenes.scene import Scene

if TYPE_CHECKING:
    from control import StateSpace

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
VANISHED = 1e-8  # |exp(lambda T)| below which a mode has decayed within one period: commands under way
MOST = 8  # modes listed in the report
GRID = 400  # frequencies between the slowest pole and that of Nyquist, evenly in the logarithm
ORDER = 8
"""Of the Pade approximation of a delay."""


@dataclass(frozen=True)
class Loop(Result):
    """A closed loop about steady sliding. `unit`: of the gain; `delay` [s]: of its sensor and of the loop together.

    `gain`: gain of the controller; a controller without a gain parameter gets a factor on its input, nominally 1.
    `model`: the loop at a gain of one. `energy`: form over the states of the rig (rig.analysis.linear.control_loop).
    `left_out`: controllers of the scene that are left open, in words. `belief`: lines on what the controller believes
    of the rig.
    """

    FIGURE: ClassVar = "rig.analysis.linear.figures:loop_figure"

    scene: str
    controller: str
    through: str
    gain: float
    unit: str
    delay: float
    model: Sampled
    energy: Array
    left_out: str = ""
    belief: tuple[str, ...] = ()

    @cached_property
    def spectrum(self) -> Spectrum:
        """Eigenvalues lambda = ln(z) / T of the closed loop, least stable first, without those that decay within a
        period.
        """
        z, right, left = of_matrix(self.model.closed(self.gain))
        rates, columns = lasting(z, self.model.period)
        states = self.model.states
        nq = sum(f"{name}'" in states for name in states)
        return Spectrum(rates, right[:, columns], left[:, columns], states, nq, self.model.own, energy=self.energy)

    @property
    def growth(self) -> float:
        """The largest growth rate [1/s]."""
        return float(self.spectrum.rates[0].real)

    def response(self, omega: Array) -> Complex:
        """Return the open-loop response L at `omega` [rad/s], signed such that -1 is the limit of stability."""
        return self.gain * self._unit_response(omega)

    @cached_property
    def _triangular(self) -> tuple[Complex, Complex, Complex]:
        """F, G and H of the open loop over states in which F is triangular: a response without a factorisation."""
        from scipy.linalg import matrix_balance, schur

        F, scales = matrix_balance(self.model.F, permute=False, separate=True)
        F, turn = schur(F, "complex")
        return F, turn.conj().T @ (self.model.G / scales[0]), (self.model.H * scales[0]) @ turn

    def _unit_response(self, omega: Array) -> Complex:
        z = np.exp(1j * omega * self.model.period)
        F, G, H = self._triangular
        held = np.zeros((len(F), len(z)), dtype=np.complex128)
        for i in reversed(range(len(F))):
            held[i] = (G[i] + F[i, i + 1 :] @ held[i + 1 :]) / (z - F[i, i])
        return -(H @ held)

    def state_space(self) -> StateSpace:
        """Return the open loop as python-control's StateSpace, sampled with the period; unity feedback closes it."""
        import control

        m = self.model
        return control.ss(m.F, m.G[:, None], -self.gain * m.H[None, :], [[0.0]], m.period, name=self.controller)

    @cached_property
    def gain_ranges(self) -> list[tuple[float, float]]:
        """Return the gains of both signs between which the loop is stable, rising; ends may be infinite."""
        limits = sorted({0.0, *self._limits()})
        ranges: list[tuple[float, float]] = []
        for low, high in pairwise([-math.inf, *limits, math.inf]):
            z = np.linalg.eigvals(self.model.closed(_inside(low, high)))
            if not np.abs(z).max() < 1.0:
                continue
            if ranges and ranges[-1][1] == low:
                low, _ = ranges.pop()
            ranges.append((low, high))
        return ranges

    @cached_property
    def gain_range(self) -> tuple[float, float] | None:
        """Return the stable range that contains the controller's own gain; None if the loop is unstable."""
        return next((ends for ends in self.gain_ranges if ends[0] < self.gain < ends[1]), None)

    @cached_property
    def margins(self) -> dict[str, float] | None:
        """Return the least phase margin [rad] and delay margin [s], each with its frequency [Hz]; None if unstable.

        Infinite if the loop gain never reaches one.
        """
        if self.growth >= 0.0:
            return None
        at = np.array(self._roots(lambda w: np.abs(self.response(w)) - 1.0))
        if not len(at):
            return {"phase": math.inf, "phase_hertz": math.nan, "delay": math.inf, "delay_hertz": math.nan}
        turn = np.mod(np.angle(self.response(at)) + math.pi, 2.0 * math.pi)  # clockwise to -1
        back = np.minimum(turn, 2.0 * math.pi - turn)
        phase = int(back.argmin())
        delay = int((turn / at).argmin())
        hertz = at / (2.0 * math.pi)
        return {
            "phase": float(back[phase]),
            "phase_hertz": float(hertz[phase]),
            "delay": float(turn[delay] / at[delay]),
            "delay_hertz": float(hertz[delay]),
        }

    def _limits(self) -> list[float]:
        """Gains at which an eigenvalue lies on the unit circle."""
        top = math.pi / self.model.period
        turning = [1e-9 * top, *self._roots(lambda w: self._unit_response(w).imag), top]
        real = self._unit_response(np.array(turning)).real
        return [float(-1.0 / value) for value in real if value]

    def _roots(self, f: Callable[[Array], Array]) -> list[float]:
        """Frequencies [rad/s] below the Nyquist frequency at which f passes zero."""
        from scipy.optimize import brentq

        def at(omega: float) -> float:
            return float(f(np.array([omega]))[0])

        w = self.frequencies
        values = f(w)
        roots = []
        for i in np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0.0):
            root = float(brentq(at, w[i], w[i + 1], xtol=1e-14 * w[i + 1]))
            if abs(at(root)) <= abs(values[i]) + abs(values[i + 1]):  # not a pole
                roots.append(root)
        return roots

    @cached_property
    def frequencies(self) -> Array:
        """Angular frequencies up to that of Nyquist [rad/s], dense where a phase changes fast."""
        top = math.pi / self.model.period
        z = np.concatenate([np.linalg.eigvals(self.model.F), np.linalg.eigvals(self.model.closed(self.gain))])
        poles, _ = lasting(z, self.model.period)
        slowest = max(float(np.abs(poles).min()), 1e-6 * top)
        widths = np.linspace(-8.0, 8.0, 49)
        around = [p.imag + max(abs(p.real), 1e-9 * abs(p)) * widths for p in poles]
        w = np.concatenate([np.geomspace(1e-2 * slowest, top, GRID), *around])
        return np.unique(w[(w > 0.0) & (w < top)])

    def facts(self) -> dict[str, Any]:
        """Return gains and margins."""
        ends = self.gain_range
        return {
            "scene": self.scene,
            "controller": self.controller,
            "through": self.through,
            "gain": self.gain,
            "gain_unit": self.unit,
            "period": self.model.period,
            "delay": self.delay,
            "stable": self.growth < 0.0,
            "gain_range": None if ends is None else list(ends),
            "gain_ranges": [list(limits) for limits in self.gain_ranges],
            "margins": self.margins,
            "belief": list(self.belief),
            "left_out": self.left_out,
        }

    def _closed_modes(self) -> list[tuple[float, float]]:
        """Growth [1/s] and frequency [Hz] of each mode; a complex pair counts once."""
        rates = [rate for rate in self.spectrum.rates if rate.imag >= 0.0]
        return [(float(rate.real), float(rate.imag) / (2.0 * math.pi)) for rate in rates]

    def shown(self) -> Iterator[str | Table]:
        """Yield the modes of the closed loop, the gains and the margins."""
        late = f"delay {1e3 * self.delay:g} ms, " if self.delay else ""
        hold = f"{late}sample and hold at {1e3 * self.model.period:g} ms"
        yield f"{self.scene}: loop of {self.controller} ({self.through}), gain {self.gain:g} {self.unit}".rstrip()
        yield f"  linearised about steady sliding, within all limits; {hold}, exactly discretised"
        if self.left_out:
            yield f"  {self.left_out}"
        yield from (f"  {line}" for line in self.belief)
        yield ""
        columns = (Column("kind"), Column("growth", "1/s", ".6g"), Column("frequency", "Hz", ".6g"))
        rows = [("grows" if g > 0.0 else "decays", g, f) for g, f in self._closed_modes()]
        yield Table("modes", columns, rows, MOST)
        yield ""
        yield from self._ranges()
        if self.margins:
            yield from self.margin_lines("ms more, then it grows at {delay_hertz:.5g} Hz")

    def margin_lines(self, delay: str) -> Iterator[str]:
        """Lines of text on the margins; `delay`: what follows the delay margin."""
        margins = self.margins
        if margins is None:
            yield "  no margins: the loop is unstable with the mean delay of its links"
        elif math.isinf(margins["delay"]):
            yield "  no phase margin and no delay margin: the loop gain never reaches 1"
        else:
            yield f"  phase margin {math.degrees(margins['phase']):.4g} deg at {margins['phase_hertz']:.5g} Hz"
            yield f"  delay margin {1e3 * margins['delay']:.5g} {delay.format_map(margins)}"

    def _times_its_own(self, low: float, high: float) -> str:
        """A range of gains over the controller's own; "" where it has another sign, or both."""
        finite = sum(end for end in (low, high) if math.isfinite(end))
        of_one_sign = low * high >= 0.0  # also false from zero to infinity
        if not self.gain or not of_one_sign or self.gain * finite <= 0.0:
            return ""
        least, most = sorted((low / self.gain, high / self.gain))
        return f" ({least:.4g} to {most:.4g} times its own)"

    def _ranges(self) -> Iterator[str]:
        """Lines of text on the stable gain ranges, and on the controller's own gain."""
        unit = f" {self.unit}" if self.unit else ""
        for low, high in self.gain_ranges:
            first = _gain(low)
            last = f"{_gain(high)}{unit}" if math.isfinite(high) else _gain(high)
            yield f"  stable with a gain from {first} to {last}{self._times_its_own(low, high)}"
        if not self.gain_ranges:
            yield "  stable with no gain of either sign"
        elif self.gain_range is None:
            sign = math.copysign(1.0, self.gain)
            reached = any(max(sign * low, sign * high) > 0.0 for low, high in self.gain_ranges)
            wrong = self.gain and not reached
            yield f"  its own gain, {self.gain:g}{unit}, {'has the wrong sign' if wrong else 'lies outside'}"


def lasting(z: Complex, period: float) -> tuple[Complex, NDArray[np.int64]]:
    """Return the rates ln(z) / period of eigenvalues of one period, least stable first, and their places in z.

    Those that decay within a period are left out.
    """
    places = np.flatnonzero(np.abs(z) > VANISHED)
    rates = np.asarray(np.log(z[places].astype(np.complex128)) / period, dtype=np.complex128)
    order = np.lexsort((-rates.imag, -rates.real))
    return rates[order], places[order]


def ends(scene: Scene, name: str) -> tuple[str, str]:
    """Sensor and actuator of the loop of controller `name`, which has one of each."""
    section = scene.controllers[name]
    reads = controllers.controller_reads(section)
    return reads.get("sensor") or next(iter(reads.values())), controllers.controller_drives(section)[0]


def loop(scene: Scene, name: str, more_ns: int = 0, newer: int | None = 0) -> Loop:
    """Linearise the loop of controller `name` of `scene` about the equilibrium at the scene's own values; the others
    stay open.

    `more_ns`: delay in addition to that of the scene [ns]; `newer`: see `rig.design.sampled_loops.sampled`. Impaired
    links are left out.

    Raises SceneError for an unknown controller, for one that is not a linear feedback, and for a rig without steady
    sliding.
    """
    if name not in scene.controllers:
        raise SceneError(scene.name, [f"controller {name}: unknown; {near(name, scene.controllers)}"])
    section = scene.controllers[name]
    values = numbers(scene)[name]
    feedback: Any = controllers.build(section, values)
    if not hasattr(feedback, "linear"):
        linear_ones = []
        for other, of_other in scene.controllers.items():
            if hasattr(controllers.controller_class(of_other), "linear"):
                linear_ones.append(other)
        which = f"; {', '.join(linear_ones)} is" if linear_ones else ""
        why = f"{section.kind} is not a linear feedback: it has no margins{which}"
        raise SceneError(scene.name, [f"controllers.{name}: {why}"])
    gain = 1.0
    unit = "1"
    try:
        if key := linear_form(feedback).gain:
            gain = getattr(section, key)
            unit = unit_of(section.__class__, key)
            feedback = controllers.build(section.model_copy(update={key: 1.0}), values)
        (reads,) = feedback.reads
        (drives,) = feedback.drives
        sensor = scene.sensors[reads]
        end = sensor.front_end()
        rig = plant(scene)
        model = sampled(rig, ControlLoop(feedback, sensor.reads, end, section.delay + more_ns), newer)
    except PartError as fault:
        raise SceneError(scene.name, [f"controllers.{name}: {fault}"]) from None
    except ValueError as fault:
        raise SceneError(scene.name, [f"controllers.{name}.{fault}"]) from None
    return Loop(
        scene=scene.name,
        controller=name,
        through=f"{reads} to {drives}",
        gain=gain,
        unit="" if unit == "1" else unit,
        delay=(end.delay_ns + section.delay + more_ns) * 1e-9,
        model=model,
        energy=rig.energy,
        left_out=left_out(scene, name),
        belief=tuple(belief_lines(scene)),
    )


def sweep_loop(scene: Scene, axis: Axis, name: str) -> Sweep:
    """The eigenvalues of the closed loop of controller `name` over a parameter of the rig or of that controller.

    Where there is no loop (nothing slides steadily, periods that do not fit), the sweep says why.
    """

    def spectrum(value: float) -> Spectrum:
        try:
            return loop(axis.at(scene, value), name).spectrum
        except SceneError as error:
            return absent("no loop", "; ".join(error.faults))
        except Singular as error:
            return absent("no loop", error.why)

    belief = tuple(of_varied(scene, [axis.key]))
    return replace(along(scene.name, axis, spectrum, name), belief=belief, left_out=left_out(scene, name))


def plant(scene: Scene) -> Plant:
    """Linearise the rig of `scene`; inputs are the actuators whose command is a value (not a generator's).

    Raises SceneError without steady sliding.
    """
    actuators = assembled(scene.parameters, scene.frame_ns, random=False).inputs
    assembly, at = at_rest(scene, dict.fromkeys(actuators, "held"))
    if not at.exists:
        why = f"no steady sliding at these values ({missing(at)}), so the rig cannot be linearised"
        raise SceneError(scene.name, [why])
    return linear(assembly, at)


def state_space(scene: Scene, delay: float = 0.0, order: int = ORDER) -> StateSpace:
    """Return the linearised rig as python-control's StateSpace, continuous in time.

    Its inputs are the actuators, in their units (drive.speed is named drive_speed there: python-control takes no dots).
    `delay`: of a loop [s], the same for every command, as a Pade approximation of `order`: exact to 1e-8 up to a
    frequency at which the delay turns the phase by half the order in radians. A sampled loop with sample and hold has
    half a period more; rig.analysis.linear.control_loop treats it exactly. Raises SceneError without steady sliding.
    """
    import control

    p = plant(scene)
    A = p.A
    B = p.B
    D = p.D
    if delay > 0.0:
        num, den = control.pade(1.0, order)
        pade = control.tf2ss(control.tf(num, den))
        each = np.eye(len(p.inputs))
        late = np.kron(each, pade.A / delay)
        into = np.kron(each, pade.B / delay)
        out = np.kron(each, pade.C)
        through = np.kron(each, pade.D)
        zero = np.zeros((len(late), len(A)))
        A = np.block([[A, B @ out], [zero, late]])
        C = np.hstack([p.C, D @ out])
        B = np.vstack([B @ through, into])
        D = D @ through
    else:
        C = p.C
    inputs = [name.replace(".", "_") for name in p.inputs]
    return control.ss(A, B, C, D, inputs=inputs, outputs=list(p.outputs), name=scene.name)


def _inside(low: float, high: float) -> float:
    """A gain between two limits, of which one may be infinite."""
    if low == -math.inf:
        return 2.0 * high - 1.0
    if high == math.inf:
        return 2.0 * low + 1.0
    return 0.5 * (low + high)


def _gain(end: float) -> str:
    """An end of a range of gains as text."""
    if math.isfinite(end):
        return f"{end:.6g}"
    return "any positive gain" if end > 0.0 else "any negative gain"
