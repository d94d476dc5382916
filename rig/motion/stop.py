"""Why a motion had to stop, and where, in words: what the statuses of the kernels mean, and what to do about it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.errors import Chatter, Diverged, Jammed, NumericsError
from rig.model.film import on
from rig.model.method import ADAPTIVE
from rig.model.mode_sets import FAST
from rig.model.system import System
from rig.motion.ready import Integration
from rig.solve.contact_state import CHATTER, JAM, LOST, OVERFULL, UNRESOLVED
from rig.solve.records import MotionLog, MotionState
from rig.stability.report import blame, fastest_eigenvalue

Why = tuple[type[NumericsError], str]


def why(status: int, system: System, integration: Integration, state: MotionState, log: MotionLog, room: int) -> Why:
    """The error that a status of the kernels means, and its text. `room`: for smooth segments in a frame."""
    if status == JAM:
        return Jammed, "no mode set satisfies the equations: jamming (Painleve)"
    if status == CHATTER:
        _, kind, owner, _ = log.event[int(state.progress[0]["events"]) - 1].tolist()
        what = f"more than {len(log.event)} events in one block; the last: {system.event_text(kind, owner)}"
        return Chatter, f"{what}. Raise clock.events_per_frame if this is meant"
    if status == OVERFULL:
        by_method = dict.fromkeys(("rk4", "kick"), "clock.rk4_step") | dict.fromkeys(ADAPTIVE, "clock.tolerance")
        finer = by_method.get(integration.method)
        what = f"more than {room} smooth segments in one frame, for the sensors to read"
        size = fastest_eigenvalue(system) * integration.step_ns * 1e-9
        if integration.method in ("exact", *ADAPTIVE) and size > FAST:
            what += f"; |lambda| step = {size:.3g}. Leave out the fast lag or the fast element of the network"
            return NumericsError, f"{what}, or shorten clock.frame"
        return NumericsError, f"{what}. Shorten clock.frame{f' or raise {finer}' if finer else ''}"
    if status == UNRESOLVED:
        what = "a contact creeps so slowly that its slip speed is lost in the rounding of the speeds of its two sides"
        what += ", and with it the friction force. Start nearer to steady slip, or use a law that sticks"
        return NumericsError, f"{what} or whose friction is less steep at small speeds (rate_state: a larger a)"
    assert status == LOST
    film = system.film
    if film is not None and film.travel:
        place = float(state.x[system.names.index(film.travel)])
        if place < 0.0:
            return NumericsError, "the slider runs backwards and has reached the rear end of its travel, 0 m"
        if not place <= film.longest:
            return NumericsError, f"the slider has reached the end of its travel, {film.longest:g} m"
    if np.all(np.abs(state.x) <= integration.limit):
        return Diverged, f"no step is short enough for the tolerance {integration.tolerance:g}"
    what = f"the state has left the limit of {integration.limit:g} or is not finite"
    if integration.method in ("rk4", "kick"):
        what += f"; {blame(system, integration.method, integration.step_ns * 1e-9, integration.substeps, state.x)}"
    return Diverged, what


def where(system: System, key: int, x: NDArray[np.float64]) -> tuple[str, dict[str, float]]:
    """The mode set in words and the state by name; for a rig with a film only the states of the structure."""
    own = system.names[: system.names.index(on(system.coordinates[0]))] if system.film else system.names
    return system.describe(key), dict(zip(own, x.tolist()))
