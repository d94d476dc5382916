"""Which method serves a system, and the system as each method sees it.

The method smooth sees smoothed friction: T = mu(|w|) N tanh(w / scale), without stick and without events. A stuck
contact creeps at scale atanh(T / (mu N)) forever. The jump from static to kinetic friction has no smooth form. As in
the literature it becomes a decay over 5 scales, whose maximum is a sixth below the static coefficient for any scale.
The result is finite, smooth and wrong; the method exists to show this error.

Source: the form of Liu and Ouyang, Mechanical Systems and Signal Processing (2022), with tanh(50 v).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from rig.model import assembly, friction_law
from rig.model.friction_law import Law
from rig.model.system import System

_FALL = 5.0  # number of scales over which static friction falls to kinetic
METHODS = ("exact", "dopri5", "dop853", "rosenbrock", "rk4", "kick", "smooth")
ADAPTIVE = ("dopri5", "dop853", "rosenbrock")
"""Methods whose steps a tolerance determines."""
TIGHT = 1e-9
"""Tolerance from which on long steps of high order take less time than those of dopri5."""
MANY = 1 << 22
"""Largest number of mode sets that a system may have: 20 contacts of one friction force that open one by one, or 8 that
stick, slip and open one by one. Their index then takes 16 MB; only mode sets that a run visits are built."""
CROWD = 1 << 14
"""Number of mode sets beyond which a run keeps meeting new ones, each of which has to be built: 6 contacts that stick,
slip and open one by one exceed it."""
FILM_HELPS = "make the contacts points of a film, which have no mode sets (structure.film = true; Assembly.film)"


def smoothed(system: System, scale: float) -> System:
    """The system with every friction law smoothed over `scale` [m/s]."""
    patches = tuple(replace(patch, law=_smooth(patch.law, scale)) for patch in system.patches)
    sectors = []
    for sector in system.sectors:
        laws = tuple(_smooth(law, scale) for law in sector.laws)
        sectors.append(replace(sector, laws=laws))
    return replace(system, patches=patches, sectors=tuple(sectors))


def _smooth(law: Law, scale: float) -> Law:
    if law.constant and law.static > law.numbers[0]:
        law = friction_law.stribeck(law.static, law.numbers[0], _FALL * scale)
    return friction_law.smoothed(law, scale)


def too_many(system: System) -> str:
    """Why no method follows the contacts of this system one by one; "" if one does, or if they are a film."""
    if system.film is not None or system.keys <= MANY:
        return ""
    contacts = max(len(system.patches), sum(normal.opens for normal in system.normals))
    return (
        f"{contacts} contacts that stick, slip and open one by one have {system.keys:.1e} mode sets; "
        f"a run can distinguish {MANY:.1e}"
    )


def chosen(method: str, system: System, tolerance: float = math.inf) -> str:
    """The method that "auto" selects, for an analysis with its own `tolerance`.

    kick for a film; otherwise exact if every mode set is linear; otherwise rosenbrock if a law has memory, because its
    bristles are stiff; otherwise dopri5, or dop853 if the tolerance is tight.
    """
    if method != "auto":
        return method
    if system.film is not None:
        return "kick"
    if system.linear:
        return "exact"
    if system.remembers:
        return "rosenbrock"
    return "dop853" if tolerance <= TIGHT else "dopri5"


def as_integrated(system: System, method: str, smoothing: float) -> System:
    """The system as `method` sees it. `smoothing` [m/s]: of the method smooth.

    Raises ValueError if the method does not support the system.
    """
    if method not in METHODS:
        raise ValueError(f"unknown method {method!r}; known: {', '.join(METHODS)}")
    if why := too_many(system):
        raise ValueError(f"{why}: {FILM_HELPS}; eigenvalues (rig modes) need no run")
    if system.film is not None:
        if method != "kick":
            raise ValueError(f"method {method} does not support a film of contact points: use kick")
        why = assembly.refusal(system)
        if why:
            raise ValueError(f"kick: {why}")
        return assembly.with_film_contacts(system)
    if method == "kick":
        raise ValueError("method kick supports a film of contact points only, and this rig has none: use auto")
    if method == "smooth":
        directional = _with_law(system, lambda law: bool(law.backward))
        if directional:
            raise ValueError(f"smooth: the law of {', '.join(directional)} depends on the direction of slip: use auto")
        remembering = [patch.name for patch in system.patches if patch.memory]
        if remembering:
            raise ValueError(f"smooth: the law of {', '.join(remembering)} has memory and is smooth already: use auto")
        system = smoothed(system, smoothing)
    if method == "exact" and not system.linear:
        curved = _with_law(system, lambda law: not law.constant)
        curved += [product.name for product in system.products]
        raise ValueError(
            f"method exact requires linear equations in every mode set; not linear: {', '.join(curved)}; use auto"
        )
    return system


def _with_law(system: System, condition: Callable[[Law], bool]) -> list[str]:
    """The names of the patches one of whose laws meets a condition."""
    return [patch.name for p, patch in enumerate(system.patches) if any(map(condition, system.laws(p)))]
