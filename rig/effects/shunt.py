"""An electrical network on the electrodes of a piezo stack, part of the plant.

    series    L i' = -U - R i,  U = U_p + U_C    R, L and C = Cps/delta in one loop; delta < 0: a negative capacitance
    parallel  U' = -(U/R + i + e dx')/((1 + ratio) Cps),  L i' = U      R, L and C = ratio Cps side by side
    open, short

The states of the series shunt are the loop voltage U and the current i,

    U' = (1 + delta) i/Cps - e dx'/Cps        U_p = (U + delta s)/(1 + delta),  U_C = delta (U - s)/(1 + delta)

with s = V0 - e dx/Cps and V0 = (q - q_C)/Cps. The charge is not a state, because it would be a small difference of
large numbers, also in the guards of contacts. V0 changes only if a resistor discharges the stack (`leak`) or the
capacitor (`bleed`, whose sign a negative capacitance inverts as well); it matters when the stack is connected again.
R = 0, L = 0 or both remove their states. So do values without influence on the structure: L omega^2 below 1e-8 of
(1 + delta)/Cps.

The switch is a command and needs no new matrix: when it is open, the charges stay and the current is zero. The energy
of the inductor is lost and is a term of the energy balance. The op-amp of a negative capacitance limits U_C to
`saturation`.
Source: Kroeger, Neubauer, Popp, Phil. Trans. R. Soc. A 366 (2008) 785, equations 4.14 to 4.19; loop voltage, switching
and bleeding are derived here.

The stability report states the static limit of a series shunt and its time constants. A negative capacitance softens
the stack to the static stiffness c33 + kappa delta/(1 + delta). The rig becomes statically unstable where this change
cancels the stiffness k_b between the ends of the shorted stack, at delta = -k_b/(k_b + kappa). This limit is above that
of the loop alone, delta = -1.
Source: Kroeger, Neubauer, Popp (2008), section 4 d; the limit in the structure is derived here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from annotated_types import Gt
from numpy.typing import NDArray
from pydantic import Field, model_validator

from rig.about import About
from rig.effects.drive import command_range
from rig.errors import SceneError
from rig.model.assembly import Assembly, Input, Output
from rig.model.named_rows import Circuit, Row
from rig.model.named_rows import add as add_row
from rig.model.singular import assembled
from rig.model.system import Finding, Judge, System
from rig.picture import IN_FIGURE, Plot
from rig.quantities import Henry, Number, Ohm, PositiveHenry, PositiveOhm, PositiveVolt, Section, at_least, quantity
from rig.stability.linearisation import sliding_key

TOLERANCE = 0.1
"""Relative variation of a stack's capacitance with temperature [calibrated]."""
_SINGULAR = 1e-12  # share of the largest stiffness below which there is none
VOLTAGE = "shunt.voltage"
CURRENT = "shunt.current"
OFFSET = "shunt.offset"
POSITION = "shunt.position"
OP_AMP = "op-amp"
_UNNOTICED = 1e-8  # impedance over that of the capacitance: a smaller one has no influence [chosen]
Beyond: Any = quantity("1", Gt(-1.0))
Bank = Annotated[tuple[PositiveHenry, ...], Field(min_length=2)]


@dataclass(frozen=True)
class Stack:
    """A piezo stack: coupling e [N/V], clamped capacitance Cps [F], extension dx [m] as a row over coordinates."""

    e: float
    capacitance: float
    path: Row

    @property
    def kappa(self) -> float:
        """The stiffness that open electrodes add, e^2/Cps [N/m]."""
        return self.e**2 / self.capacitance

    @property
    def open_voltage(self) -> Row:
        """Voltage [V] by which the extension lowers the voltage of the open stack, e dx / Cps, as a row."""
        return scaled(self.path, self.e / self.capacitance)

    @property
    def open_voltage_rate(self) -> Row:
        """The rate of `open_voltage`, e dx' / Cps [V/s], as a row."""
        return {f"{c}'": value for c, value in self.open_voltage.items()}

    def couple(self, a: Assembly, voltage: Row) -> None:
        """Add the force e U on the ends and the energy that the stack stores. `voltage`: U as a row over states."""
        for c, f in self.path.items():
            add_row(a.coupling.setdefault(c, {}), scaled(voltage, f * self.e))
        a.stores.append((self.capacitance, voltage))
        a.outputs["stack_voltage"] = Output(voltage, "V", Plot(place=IN_FIGURE))


def scaled(row: Row, factor: float) -> Row:
    """`factor` times a row."""
    return {name: factor * value for name, value in row.items()}


def total(*rows: Row) -> Row:
    """Sum of rows."""
    out: Row = {}
    for row in rows:
        add_row(out, row)
    return out


def stiffness_between_ends(system: System, stack: Stack) -> float:
    """Static stiffness k_b [N/m] between the ends of the shorted stack in steady sliding; infinite if they are fixed.

    The friction force is taken as constant.
    """
    nq = len(system.coordinates)
    ends = np.array([stack.path.get(c, 0.0) for c in system.coordinates])
    push = np.zeros_like(system.coupling)
    push[:, system.one] = ends
    key = sliding_key(system)
    plain, pushed = (assembled(replace(system, coupling=c), key).A[nq : 2 * nq] for c in (0.0 * push, push))
    stiff = plain[:, :nq]
    pull = (plain - pushed)[:, system.one]
    yields = np.linalg.pinv(stiff, rcond=_SINGULAR) @ pull
    if np.abs(stiff @ yields - pull).max() > _SINGULAR * np.abs(pull).max():
        return 0.0  # no spring resists the stack
    given = float(ends @ yields)
    return 1.0 / given if given else math.inf


def static_limit(system: System, stack: Stack) -> float:
    """The delta below which the rig is statically unstable: -k_b/(k_b + kappa)."""
    k_b = stiffness_between_ends(system, stack)
    return -1.0 / (1.0 + stack.kappa / k_b) if k_b else 0.0


def judge(stack: Stack, delta: float, states: Sequence[str], dropped: Sequence[str]) -> Judge:
    """The check of a series shunt for the stability report. `dropped`: parameters without influence, set to zero."""
    return partial(_findings, stack, delta, states, dropped)  # not a closure: systems with it are compared and sent


def _findings(
    stack: Stack, delta: float, states: Sequence[str], dropped: Sequence[str], system: System, step: float
) -> Iterator[Finding]:
    if dropped:
        what = f"shunt: {' and '.join(dropped)} too small to influence any motion of the structure, taken as 0"
        yield Finding("info", what, 0.0, "nothing to do; it saves a state that would be very fast")
    if delta < 0.0:
        yield from _static(system, stack, delta)
    if states:
        yield from _fast(system, states, step)


def _static(system: System, stack: Stack, delta: float) -> Iterator[Finding]:
    k_b = stiffness_between_ends(system, stack)
    kappa = stack.kappa
    limit = static_limit(system, stack)
    safe = limit / (1.0 + TOLERANCE)
    where = f"the limit is -k_b/(k_b + kappa) = {limit:.4f} (k_b {k_b:.4g} N/m, kappa {kappa:.4g} N/m)"
    if delta <= limit:
        held = delta <= -1.0
        left = "even held at its ends" if held else f"stiffness left {k_b + kappa * delta / (1.0 + delta):.4g} N/m"
        what = f"shunt: with delta {delta:g} the stack is statically unstable, {left}; {where}"
        yield Finding("error", what, delta - limit, f"delta above {at_least(limit, 4)}, {at_least(safe)} to be safe")
    elif delta * (1.0 + TOLERANCE) <= limit:
        more = delta * (1.0 + TOLERANCE)
        what = f"shunt: a stack {TOLERANCE:.0%} above its capacitance makes delta {delta:g} to {more:.3f}"
        yield Finding("warning", f"{what}; {where}", delta - limit, f"delta above {at_least(safe)}")


def _fast(system: System, states: Sequence[str], step: float) -> Iterator[Finding]:
    """The time constant of the network with fixed ends of the stack, compared with the step."""
    at = [system.names.index(name) for name in states]
    key = sliding_key(system)
    patches, normals, limiters, sectors, thrown = system.modes(key)
    closed = [max(position, 1) for position in thrown]
    A = assembled(system, system.key(patches, normals, limiters, sectors, closed)).A[np.ix_(at, at)]
    values = np.linalg.eigvals(A)
    fastest = max(values, key=abs)
    if abs(fastest) == 0.0:
        return
    hertz = f"resonance {abs(fastest) / (2.0 * math.pi):.4g} Hz, " if fastest.imag else ""
    what = f"shunt: {hertz}time constant {1.0 / max(abs(fastest.real), 1e-300):.3g} s, step {step:g} s"
    yield Finding("info", what, abs(fastest) * step, "exact integrates it with any step; rk4 and dopri5 resolve it")


class _Network(Section):
    declares: ClassVar = About(
        "an electrical network on the stack's electrodes", hardware=True, needs=("piezo",), switch="connected"
    )


class Open(_Network):
    """Open electrodes, with or without the resistance of their insulation."""

    kind: Literal["open"]
    leak: PositiveOhm | None = None


class Short(_Network):
    """Shorted electrodes."""

    kind: Literal["short"]


class Series(_Network):
    """R, L and C in one loop. `delta` = Cps/C; 0: no capacitor. `connected`: whether it is connected at the start.

    `bank`: inductances [H] that can be switched during the run; a command selects the nearest. Without a bank a new
    inductance needs new matrices. `leak`: resistor [ohm] across the stack; `bleed`: resistor [ohm] across the
    capacitor; `saturation`: largest voltage [V] of the op-amp that makes the capacitor.
    """

    kind: Literal["series"]
    resistance: Ohm = 0.0
    inductance: Henry = 0.0
    delta: Number = 0.0
    connected: bool = True
    bank: Bank | None = None
    leak: PositiveOhm | None = None
    bleed: PositiveOhm | None = None
    saturation: PositiveVolt | None = None

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if self.delta == -1.0:
            raise ValueError("delta -1 leaves the loop without capacitance; a stable shunt has delta above -1")
        if self.delta == 0.0 and (self.bleed is not None or self.saturation is not None):
            raise ValueError("bleed and saturation belong to the capacitor; with delta 0 there is no capacitor")
        if self.saturation is not None and self.resistance == 0.0:
            raise ValueError("saturation needs a resistance above 0 ohm: nothing else would limit the current")
        if self.bank is not None and self.inductance not in self.bank:
            raise ValueError(f"inductance {self.inductance:g} H is not in the bank; give one of its values")
        return self


class Parallel(_Network):
    """R, L and C = `ratio` Cps in parallel; a ratio between -1 and 0 is a negative capacitance."""

    kind: Literal["parallel"]
    resistance: PositiveOhm | None = None
    inductance: PositiveHenry | None = None
    ratio: Beyond = 0.0
    connected: bool = True

    @model_validator(mode="after")
    def _something(self) -> Self:
        if self.resistance is None and self.inductance is None and self.ratio == 0.0:
            raise ValueError('a parallel shunt without resistance, inductance and ratio is open: state kind = "open"')
        return self


Shunt = Annotated[Open | Short | Series | Parallel, Field(discriminator="kind")]


def add(a: Assembly, stack: Stack, shunt: Open | Short | Series | Parallel, moved: Mapping[str, str]) -> None:
    """Add the network and its actuators `shunt.connected`, `shunt.inductance`, `shunt.resistance`, `shunt.delta`.

    Raises SceneError for a network that cannot be switched although the scene switches it.
    """
    if isinstance(shunt, Series) and (shunt.connected or shunt.bank or "shunt.connected" in moved):
        _series(a, stack, shunt, moved)
    elif isinstance(shunt, Parallel) and (shunt.connected or "shunt.connected" in moved):
        _parallel(a, stack, shunt, moved)
    elif isinstance(shunt, Short):
        stack.couple(a, {})
        a.outputs["shunt_current"] = Output(scaled(stack.open_voltage_rate, stack.capacitance), "A", Plot())
    else:
        _open(a, stack, None if isinstance(shunt, Parallel) else shunt.leak)
    if isinstance(shunt, Series | Parallel):
        a.inputs.setdefault("shunt.connected", Input("1", 0.0, 1.0, float(shunt.connected), float(shunt.connected)))
    if isinstance(shunt, Series):
        L = shunt.inductance
        R = shunt.resistance
        delta = shunt.delta
        bank = "a bank of coils for it to run through (shunt.bank)"
        a.inputs.setdefault("shunt.inductance", Input("H", *command_range(L, 0.0, math.inf, 1e4), L, L, ramped=bank))
        a.inputs["shunt.resistance"] = Input("ohm", *command_range(R, 0.0, math.inf, 1e9), R, R)
        a.inputs["shunt.delta"] = Input("1", *command_range(delta, min(-0.999, delta), math.inf, 1e3), delta, delta)


def _open(a: Assembly, stack: Stack, leak: float | None) -> None:
    """Add open electrodes: the extension charges the stack, which has no voltage at the start."""
    if leak is None:
        voltage = total(scaled(stack.open_voltage, -1.0), {"one": _at_start(a, stack)})
        stack.couple(a, voltage)
        a.keep[VOLTAGE] = _charge(stack, voltage)
        return
    a.network[VOLTAGE] = total(scaled(stack.open_voltage_rate, -1.0), {VOLTAGE: -1.0 / (leak * stack.capacitance)})
    a.own("shunt", VOLTAGE)
    a.losses.append((1.0 / leak, {VOLTAGE: 1.0}))
    stack.couple(a, {VOLTAGE: 1.0})


def _charge(stack: Stack, voltage: Row) -> Row:
    """The charge on the electrodes as a row; it is conserved when the network changes."""
    return total(scaled(voltage, stack.capacitance), scaled(stack.path, stack.e))


def _at_start(a: Assembly, stack: Stack) -> float:
    """Charge of the stack over Cps [V] at the start, for zero voltage."""
    return sum(value * a.start.get(c, 0.0) for c, value in stack.open_voltage.items())


def _series(a: Assembly, stack: Stack, given: Series, moved: Mapping[str, str]) -> None:
    shunt = _without_negligible(a, stack, given)
    Cps = stack.capacitance
    delta = shunt.delta
    R = shunt.resistance
    L = shunt.inductance
    thrown = shunt.bank is not None or "shunt.connected" in moved
    loop: Row = {VOLTAGE: 1.0} if L or R or thrown else {}
    if delta:
        drifts = shunt.leak is not None or shunt.bleed is not None
        offset: Row = {OFFSET: 1.0} if drifts else {"one": _at_start(a, stack)}
        inside = total(offset, scaled(stack.open_voltage, -1.0))
        voltage = scaled(total(loop, scaled(inside, delta)), 1.0 / (1.0 + delta))
        capacitor = scaled(total(loop, scaled(inside, -1.0)), delta / (1.0 + delta))
        a.stores.append((Cps / delta, capacitor))
        a.outputs["capacitor_voltage"] = Output(capacitor, "V", Plot())
    else:
        drifts = False
        voltage = loop
        capacitor = {}
    stack.couple(a, voltage)

    leaks = {}
    bleeds = {}
    if shunt.leak is not None:
        leaks = scaled(voltage, 1.0 / (shunt.leak * Cps))
        a.losses.append((1.0 / shunt.leak, voltage))
    if shunt.bleed is not None:
        bleeds = scaled(capacitor, math.copysign(1.0, delta) / (shunt.bleed * Cps))
        a.losses.append((math.copysign(1.0 / shunt.bleed, delta), capacitor))
    alone = scaled(
        total(stack.open_voltage_rate, leaks, scaled(bleeds, delta)), -1.0
    )  # U' without a current in the loop
    clamped = shunt.saturation is not None
    driving = voltage if clamped else loop
    rates: dict[str, Row] = {}
    if L:
        rates[VOLTAGE] = total(alone, {CURRENT: (1.0 + delta) / Cps})
        rates[CURRENT] = _coil(driving, R, L)
        current: Row = {CURRENT: 1.0}
    else:
        if loop:
            rates[VOLTAGE] = total(alone, scaled(driving, -(1.0 + delta) / (R * Cps))) if R else {}
        current = scaled(total({f"{VOLTAGE}'": 1.0} if loop else {}, scaled(alone, -1.0)), Cps / (1.0 + delta))
    if R:
        a.losses.append((R, current))
    if L and shunt.bank is None:
        a.stores.append((L, {CURRENT: 1.0}))
    a.network |= rates
    a.own("shunt", *rates)
    if drifts:
        a.network[OFFSET] = total(bleeds, scaled(leaks, -1.0))
        description = "resistors that discharge stack or capacitor; they change the offset of the charges"
        a.own("shunt leak", OFFSET, about=description)
        a.start[OFFSET] = _at_start(a, stack)
    if clamped:
        limit = float(shunt.saturation or 0.0)
        at, gain = (CURRENT, -1.0 / L) if L else (VOLTAGE, -(1.0 + delta) / (R * Cps))
        a.limit(OP_AMP, capacitor, -limit, limit, at, gain, excess=-Cps / delta)
        a.outputs["capacitor_voltage"] = Output({f"c:{OP_AMP}": 1.0}, "V", Plot())
    a.keep[VOLTAGE] = _charge(stack, voltage)
    a.outputs["shunt_current"] = Output(current, "A", Plot())
    dropped = [key for key in ("inductance", "resistance") if getattr(given, key) != getattr(shunt, key)]
    a.judges.append(judge(stack, delta, list(rates), dropped))
    if not thrown:
        return
    silent: dict[str, Row] = {name: {} for name in rates if name != VOLTAGE}
    opened = Circuit("open", {VOLTAGE: alone, **silent}, tuple(silent), {OP_AMP: 0.0} if clamped else {})
    coils = shunt.bank or (L,)
    closed = []
    for coil in coils:
        name = f"{coil:g} H" if shunt.bank else "connected"
        changed = {CURRENT: _coil(driving, R, coil)} if L else {VOLTAGE: rates[VOLTAGE]}
        still = () if L or R else (VOLTAGE,)
        gains = {OP_AMP: -1.0 / coil} if clamped and L else {}
        stores = ((coil, {CURRENT: 1.0}),) if shunt.bank else ()
        closed.append(Circuit(name, changed, still, gains, stores))
    _switch(a, opened, closed, shunt.connected, L, coils)
    if shunt.bank is not None:
        bounds = min(shunt.bank), max(shunt.bank)
        a.inputs["shunt.inductance"] = Input("H", *bounds, L, L, write=a.inputs["shunt.connected"].write)


def _coil(driving: Row, R: float, L: float) -> Row:
    return total(scaled(driving, -1.0 / L), {CURRENT: -R / L})


def _switch(
    a: Assembly, opened: Circuit, closed: list[Circuit], on: bool, coil: float, coils: tuple[float, ...]
) -> None:
    """Add the switch, with one closed position for each coil, and its actuator. `coil`: the position at the start."""
    wanted = np.array(coils)

    def position(on: float, inductance: float) -> float:
        return 1.0 + float(np.abs(wanted - inductance).argmin()) if on >= 0.5 else 0.0

    def write(x: NDArray[np.float64], values: Mapping[str, float], t: float) -> None:
        x[a.names.index(POSITION)] = position(values["shunt.connected"], values.get("shunt.inductance", coil))

    description = "connected or open, and which coil of a bank"
    a.signal(POSITION, {}, position(float(on), coil), "shunt switch", description)
    a.switch("shunt", POSITION, (opened, *closed))
    a.inputs["shunt.connected"] = Input("1", 0.0, 1.0, float(on), float(on), write=write)


def _without_negligible(a: Assembly, stack: Stack, shunt: Series) -> Series:
    """The shunt with an inductance, and then a resistance, of zero if it has no influence on the structure."""
    if shunt.bank is not None:
        return shunt
    ends = np.array([stack.path.get(c, 0.0) for c in a.coordinates])
    M = a.matrix("mass")
    K = stack.kappa * np.outer(ends, ends) + a.matrix("stiffness")
    fastest = math.sqrt(float(np.abs(np.linalg.eigvals(np.linalg.solve(M, K))).max()))
    least = _UNNOTICED * abs(1.0 + shunt.delta) / stack.capacitance
    L = shunt.inductance if shunt.inductance * fastest**2 >= least else 0.0
    keeps = L or shunt.saturation is not None or shunt.resistance * fastest >= least
    return shunt.model_copy(update={"inductance": L, "resistance": shunt.resistance if keeps else 0.0})


def _parallel(a: Assembly, stack: Stack, shunt: Parallel, moved: Mapping[str, str]) -> None:
    Cps = stack.capacitance
    R = shunt.resistance
    L = shunt.inductance
    if "shunt.connected" in moved and shunt.ratio:
        raise SceneError(
            "shunt.ratio", ["a parallel capacitor cannot be switched: its voltage would be an additional state"]
        )
    taken: Row = total({VOLTAGE: 1.0 / R} if R else {}, {CURRENT: 1.0} if L else {})
    rate = scaled(total(stack.open_voltage_rate, scaled(taken, 1.0 / Cps)), -1.0 / (1.0 + shunt.ratio))
    a.network[VOLTAGE] = rate
    if L:
        a.network[CURRENT] = {VOLTAGE: 1.0 / L}
        a.stores.append((L, {CURRENT: 1.0}))
    if R:
        a.losses.append((1.0 / R, {VOLTAGE: 1.0}))
    stack.couple(a, {VOLTAGE: 1.0})
    if shunt.ratio:
        a.stores.append((shunt.ratio * Cps, {VOLTAGE: 1.0}))
    a.own("shunt", *(name for name in (VOLTAGE, CURRENT) if name in a.network))
    a.outputs["shunt_current"] = Output(taken, "A", Plot())
    if "shunt.connected" in moved:
        silent: dict[str, Row] = {CURRENT: {}} if L else {}
        opened = Circuit("open", {VOLTAGE: scaled(stack.open_voltage_rate, -1.0), **silent}, tuple(silent))
        _switch(a, opened, [Circuit("connected", {})], shunt.connected, L or 0.0, (L or 0.0,))
