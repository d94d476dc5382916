"""A rig as plants and effects describe it: rows by name, its outputs, its inputs.

Outputs are extended rows: they may also name accelerations and forces (rig.model.named_rows).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rig.model.film_system import add_film_states
from rig.model.matrices import matrices
from rig.model.named_rows import Row, Rows
from rig.model.system import System
from rig.model.system_parts import Bound
from rig.picture import Plot

Write = Callable[[NDArray[np.float64], Mapping[str, float], float], None]


Role = Literal["", "displacement", "velocity", "drive"]


@dataclass(frozen=True)
class Output:
    """A quantity of the rig that a sensor may read: an extended row and its unit.

    `plot`: the plot in which it is drawn, by default that of its unit. `role`: "displacement" and "velocity" are the
    pair of the phase portrait, by default the first output with its rate of change; "drive" is the speed of a drive,
    which is no vibration.
    """

    row: Row
    unit: str
    plot: Plot | None = None
    role: Role = ""


def portrait(outputs: Mapping[str, Output]) -> tuple[str, str] | None:
    """The names of displacement and velocity that are declared, else of the first output with its rate of change.

    None if there is no such pair.
    """
    x, v = (next((n for n, one in outputs.items() if one.role == role), "") for role in ("displacement", "velocity"))
    if x and v:
        return x, v
    for name, output in outputs.items():
        rate = {f"{coordinate}'": factor for coordinate, factor in output.row.items()}
        if rate and (found := next((other for other, seen in outputs.items() if dict(seen.row) == rate), "")):
            return name, found
    return None


@dataclass(frozen=True)
class Input:
    """An actuator: its unit, its range, its value at the start and the safe value it takes without commands.

    A command comes into force by writing the state `state`; a ramp also writes `slope`, which is a state too, so that
    no command changes a matrix. `write(x, values, t)` serves inputs that act on several states: `values` holds the
    command of every input, t is the time [s]. An input without any of these changes the scene key of its own name.
    `lagging`: the state that follows the command; at the start of a run it equals the command. `ramped`: what a scene
    needs for a ramp of an input that takes steps only.
    """

    unit: str
    low: float
    high: float
    value: float
    safe: float
    state: str = ""
    slope: str = ""
    write: Write | None = None
    lagging: str = ""
    ramped: str = ""


@dataclass
class Assembly(Rows):
    """A rig under construction: its rows, its outputs and inputs. `system()` turns names into matrices.

    `free`: natural frequencies [Hz] of a part of the rig on its own, listed beside those of the rig. `limits`: friction
    coefficients at which the rig reaches a limit of its own, by name. `bounds`: the scene's limits of outputs, by name.
    """

    outputs: dict[str, Output] = field(default_factory=dict)
    inputs: dict[str, Input] = field(default_factory=dict)
    free: dict[str, float] = field(default_factory=dict)
    limits: dict[str, float] = field(default_factory=dict)
    bounds: Mapping[str, float] = field(default_factory=dict)

    def system(self) -> System:
        """The matrices. Raises SceneError if a row names an unknown state."""
        if self.film is not None:
            add_film_states(self, self.film)
        return self.sliding()

    def sliding(self) -> System:
        """The matrices without the time-dependent states of a film's points: enough for linearisation about sliding."""
        known = [(name, self.outputs[name], limit) for name, limit in self.bounds.items() if name in self.outputs]
        if self.film is not None:  # its forces are not known to linearised equations
            known = [entry for entry in known if entry[1].row.keys() <= {*self.names}]
        bounds = tuple(Bound(name, output.row, limit, output.unit) for name, output, limit in known)
        return replace(matrices(self), bounds=bounds)
