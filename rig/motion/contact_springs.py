"""What the method kick leaves over: the energy of its contacts beside the work of its kicks.

A contact that presses by how far it is pressed is a spring, whose energy changes by force times motion. Kicks act at
the ends of steps only, so the work they do differs from that, by the square of the step. The energy balance of the
structure closes with the kicks as they are; this residual is what it cannot show.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rig.model import energy_forms, kick_tables

if TYPE_CHECKING:
    from rig.motion.motion import Motion


class Springs:
    """The springs of the contacts of a motion by kick."""

    def __init__(self, motion: Motion) -> None:
        self._motion = motion
        self._given = self.held() - self._worked()  # at the start, and since then in other ways than by kicks

    def held(self) -> float:
        """Their energy now [J]."""
        return kick_tables.held(self._motion.system, self._motion.x)

    def _worked(self) -> float:
        """The work of kicks on them with the matrices of now [J]."""
        flow = self._motion.mode_sets.tables.flow
        return float(flow.spring[0]) if flow is not None else 0.0

    def pause(self) -> None:
        """State or system are changed from here on to `go_on`: what that gives the springs is no work of kicks."""
        self._given += self._worked() - self.held()

    def go_on(self) -> None:
        """The end of a change."""
        self._given += self.held() - self._worked()

    def residual(self) -> dict[str, float]:
        """`energy` [J]: what they hold beyond what they were given; `share`: of the largest energy of the vibration.

        That is what structure and springs hold, and what contacts and dampers have exchanged.
        """
        motion = self._motion
        off = self.held() - self._given - self._worked()
        told = energy_forms.by_name(motion.system, motion.terms())
        sizes = [abs(told[name]) for name in ("damper", "forces", "normal")]
        sizes += [motion.stored_first, energy_forms.stored(motion.system, motion.x, motion.key), self.held()]
        return {"energy": off, "share": abs(off) / max(*sizes, 1e-30)}
