"""Which method serves a system, and the system as each method sees it."""

from __future__ import annotations

from rig.model import film_system, kick_tables, smooth
from rig.model.system import System

METHODS = ("exact", "dopri5", "rk4", "kick", "smooth")
MANY = 1 << 22
"""Largest number of mode sets that a system may have."""
CROWD = 1 << 14
"""Number of mode sets beyond which a run would build new ones all the time; 13 contacts that open exceed it."""


def crowded(system: System) -> bool:
    """Whether so many contacts open and close that their mode sets are not distinguished: opening is then no event."""
    return system.keys > CROWD and system.film is None and not kick_tables.refusal(system)


def chosen(method: str, system: System) -> str:
    """The method that "auto" selects.

    kick if very many contacts open and close or a film travels; otherwise exact if every mode set is linear; otherwise
    dopri5.
    """
    if method != "auto":
        return method
    if system.film is not None or crowded(system):
        return "kick"
    return "exact" if system.linear else "dopri5"


def as_integrated(system: System, method: str, smoothing: float) -> System:
    """The system as `method` sees it. `smoothing` [m/s]: of the method smooth.

    Raises ValueError if the method does not support the system.
    """
    if method not in METHODS:
        raise ValueError(f"unknown method {method!r}; known: {', '.join(METHODS)}")
    if system.film is not None:
        if method != "kick":
            raise ValueError(f"method {method} does not support a film of travelling contact points: use kick")
        why = film_system.refusal(system)
        if why:
            raise ValueError(f"kick: {why}")
        return film_system.with_film_contacts(system)
    if method == "kick":
        why = kick_tables.refusal(system)
        if why:
            raise ValueError(f"kick: {why}")
    if method == "kick" or (method in ("dopri5", "rk4") and crowded(system)):
        system = kick_tables.pressed(system)
    elif method == "smooth":
        system = smooth.smoothed(system, smoothing)
    if system.keys > MANY:
        raise ValueError(f"the rig has {system.keys:.3g} mode sets, method {method} supports {MANY:.3g}: use kick")
    if method == "exact" and not system.linear:
        bent = [p.name for i, p in enumerate(system.patches) if any(not law.constant for law in system.laws(i))]
        bent += [product.name for product in system.products]
        raise ValueError(
            f"method exact requires linear equations in every mode set; not linear: {', '.join(bent)}; use dopri5"
        )
    return system
