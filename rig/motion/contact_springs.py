"""The energy error of the contacts under the method kick.

A contact whose force depends on its compression is a spring. Its energy changes by force times motion. Kicks act at the
ends of steps only, so their work differs from this by an error of second order in the step. The energy balance of the
structure closes with the work of the kicks; this residual shows the error that the balance cannot show.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rig.model import energy_forms, kick_tables

if TYPE_CHECKING:
    from rig.motion.motion import Motion


class Springs:
    """The springs of the contacts of a motion by the method kick."""

    def __init__(self, motion: Motion) -> None:
        self._motion = motion
        self._given = self.held() - self._worked()  # energy at the start, plus later supplies other than by kicks

    def held(self) -> float:
        """The energy of the springs [J]."""
        return kick_tables.held(self._motion.system, self._motion.x)

    def _worked(self) -> float:
        """The work of the kicks on the springs, with the present matrices [J]."""
        flow = self._motion.mode_sets.tables.flow
        return float(flow.spring[0]) if flow is not None else 0.0

    def pause(self) -> None:
        """Begin a change of state or system: energy that the springs gain until `go_on` is not work of the kicks."""
        self._given += self._worked() - self.held()

    def go_on(self) -> None:
        """End a change that `pause` began."""
        self._given += self.held() - self._worked()

    def residual(self) -> dict[str, float]:
        """The energy error, `energy` [J], and its `share` of the largest energy of the vibration.

        `energy` is the energy of the springs minus the energy supplied to them. The share refers to the largest of:
        energy of structure, energy of springs, work of contacts and dampers.
        """
        motion = self._motion
        off = self.held() - self._given - self._worked()
        told = energy_forms.by_name(motion.system, motion.terms())
        sizes = [abs(told[name]) for name in ("damper", "forces", "normal")]
        sizes += [motion.stored_first, energy_forms.stored(motion.system, motion.x, motion.key), self.held()]
        return {"energy": off, "share": abs(off) / max(*sizes, 1e-30)}
