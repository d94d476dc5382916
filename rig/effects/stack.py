"""The electrical side of a piezo stack, as the networks on its electrodes see it."""

from __future__ import annotations

from dataclasses import dataclass

from rig.model.assembly import Assembly, Output
from rig.model.named_rows import Row
from rig.model.named_rows import add as add_row


@dataclass(frozen=True)
class Stack:
    """Coupling e [N/V], clamped capacitance Cps [F], extension dx as a row over coordinates."""

    e: float
    capacitance: float
    path: Row

    @property
    def kappa(self) -> float:
        """What open electrodes add to the stiffness, e^2/Cps [N/m]."""
        return self.e**2 / self.capacitance

    @property
    def held(self) -> Row:
        """Voltage [V] that the extension has the open stack take off, e dx / Cps."""
        return scaled(self.path, self.e / self.capacitance)

    @property
    def pumped(self) -> Row:
        """Its rate, e dx' / Cps [V/s]."""
        return {f"{c}'": value for c, value in self.held.items()}

    def couple(self, a: Assembly, voltage: Row) -> None:
        """The force e U on the ends, U a row over the states of a network; and what the stack stores."""
        for c, f in self.path.items():
            add_row(a.coupling.setdefault(c, {}), scaled(voltage, f * self.e))
        a.stores.append((self.capacitance, voltage))
        a.outputs["stack_voltage"] = Output(voltage, "V")


def scaled(row: Row, factor: float) -> Row:
    """`factor` times a row."""
    return {name: factor * value for name, value in row.items()}


def total(*rows: Row) -> Row:
    """Sum of rows."""
    out: Row = {}
    for row in rows:
        add_row(out, row)
    return out
