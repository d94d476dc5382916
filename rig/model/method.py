"""Which method carries a system on, and how each of them sees it."""

from __future__ import annotations

from rig.model import film, kick_tables, smooth
from rig.model.system import System

METHODS = ("exact", "dopri5", "rk4", "kick", "smooth")
MANY = 1 << 22
"""Mode sets that can be told apart."""
CROWD = 1 << 14
"""Mode sets of which a run would build one after the other as it meets them: those of 13 points and more."""


def crowded(system: System) -> bool:
    """Whether so many contacts open and close that their mode sets are not told apart: none is an event then."""
    return system.keys > CROWD and system.film is None and not kick_tables.refusal(system)


def chosen(method: str, system: System) -> str:
    """The method that "auto" stands for: exact where the motion is linear in every mode set, else dopri5.

    kick where a crowd of contacts opens and closes, or travels.
    """
    if method != "auto":
        return method
    if system.film is not None or crowded(system):
        return "kick"
    return "exact" if system.linear else "dopri5"


def seen(system: System, method: str, smoothing: float) -> System:
    """The system as a method sees it; `smoothing` [m/s] of the method smooth. Raises ValueError if it cannot serve."""
    if method not in METHODS:
        raise ValueError(f"unknown method {method!r}; known: {', '.join(METHODS)}")
    if system.film is not None:
        if method != "kick":
            raise ValueError(f"{method} cannot follow points that travel, and stick and slip each by itself: use kick")
        why = film.refusal(system)
        if why:
            raise ValueError(f"kick: {why}")
        return film.ridden(system)
    if method == "kick":
        why = kick_tables.refusal(system)
        if why:
            raise ValueError(f"kick: {why}")
    if method == "kick" or (method in ("dopri5", "rk4") and crowded(system)):
        system = kick_tables.pressed(system)
    elif method == "smooth":
        system = smooth.smoothed(system, smoothing)
    if system.keys > MANY:
        raise ValueError(f"{method} cannot tell {system.keys:.3g} mode sets apart: use kick")
    if method == "exact" and not system.linear:
        bent = [p.name for i, p in enumerate(system.patches) if any(not law.constant for law in system.laws(i))]
        bent += [product.name for product in system.products]
        raise ValueError(f"exact needs motion that is linear in every mode set, unlike {', '.join(bent)}: use dopri5")
    return system
