"""The design step and the linear form of a controller: what its class may declare, and what it may ask of the rig.

    @staticmethod
    def design(rig: Rig, section: ...) -> dict[str, Any]: ...      its numbers, as plain JSON values
    def linear(self) -> Linear: ...                                its arithmetic, where that is linear within limits

A class without `design` gets no numbers; one without `linear` has no margins. `design` raises ValueError, "key: what is
wrong", for a rig that this controller cannot work on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from rig.controllers.blocks.base import Controller

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class Actuator(NamedTuple):
    """The unit of an actuator, and its value at the start."""

    unit: str
    value: float


class Linear(NamedTuple):
    """A controller as a linear map: `step(states, sample) -> (next states, command)`, without its nominal command.

    `states`: how many numbers; all are zero at rest. `gain`: the parameter that the command is proportional to; "" for
    a controller that has none.
    """

    states: int
    step: Callable[[Sequence[float], float], tuple[Sequence[float], float]]
    gain: str = ""


class Feedback(Controller, Protocol):
    """A controller that has a linear form."""

    def linear(self) -> Linear:
        """See `Linear`."""


class Rig(Protocol):
    """What the design step may ask of a rig (rig.design.asked). SI throughout; a fault is a ValueError."""

    @property
    def frequency(self) -> float:
        """Lowest natural frequency of the structure [Hz]."""

    @property
    def inertia(self) -> float:
        """Mass that the contact feels along the friction force [kg]."""

    @property
    def surface_speed(self) -> float:
        """Speed of the surface at the start, without dither [m/s]."""

    def read_scale(self, sensor: str) -> float:
        """Contact velocity per unit of a sensor that measures a velocity."""

    def speed_scale(self, sensor: str) -> float:
        """Speed of the surface per unit of a sensor that follows the drive."""

    def sample_period(self, sensor: str) -> float:
        """Time between two samples [s]."""

    def observer(self, section: Any) -> dict[str, Any]:
        """The Kalman observer of a section's sensor for the contact velocity (controllers.blocks.observer)."""

    def commands_load(self, actuator: str) -> dict[str, float]:
        """`nominal`: the normal force at the start [N]; `drive_scale`: the command per unit of it."""

    def commands_surface(self, actuator: str) -> dict[str, float]:
        """`nominal`: the speed of the surface at the start [m/s]; `drive_scale`: the command per unit of it."""

    def actuator(self, name: str) -> Actuator | None:
        """An actuator; None where the rig has none of this name."""

    def value(self, key: str) -> Any:
        """The value of a key of the plant, `piezo.capacitance`, in SI; None where the scene has none."""

    def pushed_by(self, state: str) -> bool:
        """Whether a state of the rig, `dither.sin`, is a force on the structure."""

    def frequencies(self) -> list[float]:
        """Of the vibrations about steady sliding [Hz], rising."""

    def modes(
        self, sensor: str, drive: str, delay: float, low: float, high: float
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Eigenvalues [1/s] of the vibrations between two frequencies [Hz], and of each its residue.

        The residue is what the sensor reads of the mode per unit of the command, through lags, instrument and `delay`.
        """

    def closed(self, controller: Feedback, sensor: str, delay: float) -> tuple[float, float]:
        """Largest growth rate [1/s] and its frequency [Hz] with the loop of a linear controller closed."""


def heard(rig: Rig, section: Any) -> dict[str, Any]:
    """`sample_period` [s] of the sensor that a controller hears sample by sample."""
    period = rig.sample_period(section.sensor)
    if period > section.period * 1e-9:
        raise ValueError(
            f"sensor: {section.sensor} gives a sample every {period:g} s; expected one at least in each period of "
            f"{section.period * 1e-9:g} s"
        )
    if 2.0 * section.frequency * period >= 1.0:
        raise ValueError(f"frequency: {section.frequency:g} Hz is beyond half the sample rate of {section.sensor}")
    return {"sample_period": period}
