"""Codes of contact states and of guards, as mode sets and kernels number them."""

from __future__ import annotations

SLIP_PLUS, SLIP_MINUS, STICK = range(3)
CLOSED, OPEN = range(2)
LINEAR, LOW, HIGH = range(3)
# kinds of guards: what happens when the guard falls through zero
G_SLIP, G_RELEASE_PLUS, G_RELEASE_MINUS, G_OPEN, G_CLOSE = range(5)
G_LIMIT_LOW, G_LIMIT_HIGH, G_LIMIT_BACK, G_NEXT, G_PREVIOUS = range(5, 10)
GUARD_NAMES = (
    "slip ends",
    "releases +",
    "releases -",
    "opens",
    "closes",
    "clamps low",
    "clamps high",
    "unclamps",
    "enters the next",
    "enters the one before",
)
