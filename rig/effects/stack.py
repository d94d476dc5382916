"""The electrical side of a piezo stack, as the networks on its electrodes see it."""

from __future__ import annotations

from dataclasses import dataclass

from rig.model.assembly import Assembly, Output
from rig.model.named_rows import Row
from rig.model.named_rows import add as add_row
from rig.picture import IN_FIGURE, Plot


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
