"""What the commands state of a structure: its mass, how much of each contact meets, doubts, and where modes move."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.printable import counted

if TYPE_CHECKING:  # they import scipy, which every scene would pay for at its start
    from rig.structure.full import Array, Doubt, Met
    from rig.structure.reduced import Reduced


@dataclass(frozen=True)
class Contact:
    """One contact: how many `points` it has, and how its nodes meet."""

    points: int
    met: Met

    @property
    def text(self) -> str:
        """The contact in one line."""
        met = self.met
        points = f"{self.points} of {met.asked} points" if met.asked else counted(self.points, "point")
        if met.offered is None:
            pairs = f"{counted(met.nodes, 'slave node')}; area {met.met:.4g} m^2 as its rows give it"
        else:
            area = f"area met {met.met:.4g} m^2 of {met.offered:.4g} m^2 offered"
            pairs = f"{met.pairs} of {met.nodes} nodes meet; {area}"
        gap = "on the ground"
        if met.gap is not None:
            gap = "gap not known without a mesh" if math.isnan(met.gap) else f"largest gap {met.gap:.3g} m"
        return f"{points}; {pairs}; {gap}"


@dataclass(frozen=True)
class Stated:
    """What is stated of a reduced structure.

    `total` [kg]: None where no direction of motion is known. `contacts` by name: those of a mesh. `masses` [coordinate,
    coordinate]: of each body or node set; `mass` [coordinate, coordinate]: of the whole.
    """

    total: float | None
    contacts: Mapping[str, Contact]
    doubts: tuple[Doubt, ...]
    masses: Mapping[str, Array]
    mass: Array

    @classmethod
    def of(cls, reduced: Reduced) -> Stated:
        """What is stated of this structure."""
        model = reduced.model
        contacts = {}
        for points in model.contacts:
            if points.met is not None:
                contacts[points.name] = Contact(len(points.area), points.met)
        mass = model.matrix("mass", dict.fromkeys(model.keys, 1.0))
        return cls(model.total, contacts, model.all_doubts, reduced.masses, mass)

    def lines(self) -> Iterator[tuple[str, str]]:
        """What it is of, and the words."""
        if self.total is not None:
            yield "total mass", f"{self.total:.6g} kg"
        for name, contact in self.contacts.items():
            yield f"contact {name}", contact.text

    def warnings(self) -> Iterator[tuple[str, str]]:
        """A word, and what may be wrong with what to do."""
        for what, remedy in self.doubts:
            yield "warning", f"{what}; {remedy}"

    def to_json(self) -> dict[str, Any]:
        """The statement as JSON values."""
        contacts = {}
        for name, contact in self.contacts.items():
            met = {of.name: getattr(contact.met, of.name) for of in fields(contact.met) if of.compare}
            del met["doubts"]
            if met["gap"] is not None and math.isnan(met["gap"]):
                met["gap"] = None
            contacts[name] = {"points": contact.points, **met}
        return {"total_mass": self.total, "contacts": contacts, "doubts": [what for what, _ in self.doubts]}

    def shares(
        self, shape: Mapping[str, complex], energy: Mapping[str, float], names: Sequence[str]
    ) -> dict[str, float]:
        """The share of each body or node set, and of each network state, in the energy of a mode, the largest first.

        `shape`: amplitude of each state; `energy`: share of each coordinate and network state; `names`: of the states,
        the coordinates first. Empty for a structure without bodies, and for a mode that does not move it.
        """
        if not self.masses:
            return {}
        coordinates = names[: len(self.mass)]
        displacements = np.array([shape.get(name, 0.0) for name in coordinates], dtype=np.complex128)
        whole = _kinetic(self.mass, displacements)
        if not whole:
            return {}
        beside = {name: share for name, share in energy.items() if name not in coordinates}
        of_structure = 1.0 - sum(beside.values())
        shares = dict(beside)
        for name, mass in self.masses.items():
            shares[name] = of_structure * _kinetic(mass, displacements) / whole
        return dict(sorted(shares.items(), key=lambda share: -share[1]))


def _kinetic(mass: Array, displacements: NDArray[np.complex128]) -> float:
    return float((displacements.conj() @ mass @ displacements).real)
