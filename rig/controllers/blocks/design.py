"""The design step and the linear form of a controller: optional methods of its class, and the rig that they get.

    @staticmethod
    def design(rig: Rig, section: ...) -> dict[str, Any]: ...      its numbers, as plain JSON values
    def linear(self) -> Linear: ...                                its arithmetic, if that is linear within limits

A class without `design` gets no numbers; `rig modes` reports no margins for one without `linear`. `design` raises
ValueError ("key: fault") for a rig on which the controller cannot work.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from rig.controllers.blocks.base import Controller


class Actuator(NamedTuple):
    """An actuator: its unit, its value at the start, and the range of its commands."""

    unit: str
    value: float
    low: float
    high: float


class Linear(NamedTuple):
    """A controller as a linear map: `step(states, sample) -> (next states, command)`, without its nominal command.

    `states`: number of states; all are zero at rest. `gain`: name of the parameter to which the command is
    proportional; "" if there is none.
    """

    states: int
    step: Callable[[Sequence[float], float], tuple[Sequence[float], float]]
    gain: str = ""


class Feedback(Controller, Protocol):
    """A controller with a linear form."""

    def linear(self) -> Linear:
        """See `Linear`."""


class Rig(Protocol):
    """The quantities of a rig for the design step (rig.design.rig), in SI units.

    Its methods raise ValueError ("key: fault") if the rig does not have the quantity.
    """

    @property
    def frequency(self) -> float:
        """Lowest natural frequency of the structure [Hz]."""

    @property
    def inertia(self) -> float:
        """Effective mass at the contact along the friction force [kg]."""

    @property
    def surface_speed(self) -> float:
        """Surface speed at the start, without dither [m/s]."""

    def read_scale(self, sensor: str) -> float:
        """Contact velocity per unit of a sensor that measures a velocity."""

    def speed_scale(self, sensor: str) -> float:
        """Surface speed per unit of a sensor that follows the drive."""

    def sample_period(self, sensor: str) -> float:
        """Time between two samples [s]."""

    def observer(self, section: Any) -> dict[str, Any]:
        """The Kalman observer of a section's sensor for the contact velocity (controllers.blocks.observer)."""

    def commands_load(self, actuator: str) -> dict[str, float]:
        """Numbers `nominal`: normal force at the start [N]; `drive_scale`: the command per unit of it."""

    def commands_surface(self, actuator: str) -> dict[str, float]:
        """Numbers `nominal`: surface speed at the start [m/s]; `drive_scale`: the command per unit of it."""

    def actuator(self, name: str) -> Actuator | None:
        """The actuator `name`; None if the rig has none of this name."""

    def value(self, key: str) -> Any:
        """The value of a key of the plant, for example `piezo.capacitance`, in SI; None if the scene has none."""

    def pushed_by(self, state: str) -> bool:
        """Whether a state of the rig, for example `dither.sin`, is a force on the structure."""

    def frequencies(self) -> list[float]:
        """Frequencies [Hz] of the vibration modes about steady sliding, ascending."""

    def modes(
        self, sensor: str, drive: str, delay: float, low: float, high: float
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Eigenvalues [1/s] and residues [mode] of the vibration modes between two frequencies [Hz].

        The residue is the amplitude of the mode in the sensor per unit of the command, including lags, instrument and
        `delay` [s].
        """

    def closed(self, controller: Feedback, sensor: str, delay: float) -> tuple[float, float]:
        """Largest growth rate [1/s] and its frequency [Hz] of the closed loop with a linear controller."""


def sampling_numbers(rig: Rig, section: Any) -> dict[str, Any]:
    """The number `sample_period` [s] for a controller that gets every sample of its sensor.

    Raises ValueError for a sensor that is slower than the controller, or with less than twice the sample rate of the
    controller's frequency.
    """
    period = rig.sample_period(section.sensor)
    if period > section.period * 1e-9:
        raise ValueError(
            f"sensor: {section.sensor} gives a sample every {period:g} s; expected one at least in each period of "
            f"{section.period * 1e-9:g} s"
        )
    if 2.0 * section.frequency * period >= 1.0:
        raise ValueError(f"frequency: {section.frequency:g} Hz is beyond half the sample rate of {section.sensor}")
    return {"sample_period": period}
