"""The linear form of a controller (rig.controllers.blocks.design.Linear), checked, and as matrices:

    xi+ = A xi + b y,   u = c xi + d y

y is the measurement, u the command.
"""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray

from rig.controllers.blocks.design import Feedback, Linear
from rig.errors import PartError
from rig.parts import calling, file_of
from rig.units import brief

Array = NDArray[np.float64]


def linear_form(controller: Feedback) -> Linear:
    """The linear form of a controller. Raises PartError if it fails, or is not one; ValueError unless the controller
    reads one sensor and drives one actuator.
    """
    for word, names in (("reads", controller.reads), ("drives", controller.drives)):
        if len(names) != 1:
            given = ", ".join(names) or "nothing"
            raise ValueError(f"{word}: {given}; a linear form needs one sensor and one actuator")
    module = sys.modules[type(controller).__module__]
    with calling(module):
        form = controller.linear()
    if not isinstance(form, Linear):
        expected = "a rig.controllers.blocks.design.Linear"
        raise PartError(f"{file_of(module)}: linear gives {brief(form)}; expected {expected}")
    parameters = getattr(type(getattr(controller, "section", None)), "model_fields", {})
    if form.gain and form.gain not in parameters:
        known = ", ".join(parameters) or "there are none"
        raise PartError(f"{file_of(module)}: linear names the gain {brief(form.gain)}; its parameters: {known}")
    return form


def arithmetic(controller: Feedback) -> tuple[Array, Array, Array, float]:
    """The matrices A, b, c, d of a controller, from its own linear update. Raises as `linear_form`."""
    form, module = linear_form(controller), sys.modules[type(controller).__module__]

    def step(xi: Array, y: float) -> tuple[Array, float]:
        with calling(module):
            after, u = form.step(xi.tolist(), y)
            found = np.array(after, dtype=float), float(u)
        if found[0].shape != (form.states,) or not np.isfinite([*found[0], found[1]]).all():
            expected = f"({form.states} states, command), all finite"
            raise PartError(f"{file_of(module)}: the step of linear gives {brief((after, u))}; expected {expected}")
        return found

    count = form.states
    b, d = step(np.zeros(count), 1.0)
    A, c = np.zeros((count, count)), np.zeros(count)
    for i, unit in enumerate(np.eye(count)):
        A[:, i], c[i] = step(unit, 0.0)
    seen = c != 0.0
    for _ in range(count):  # drop states without influence on commands, e.g. the copy for a prediction over zero time
        seen |= np.any(A[seen] != 0.0, axis=0)
    return A[np.ix_(seen, seen)], b[seen], c[seen], d
