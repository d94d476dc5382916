"""The sums over the points of a film."""

from __future__ import annotations

SUMS = ("normal", "friction", "fraction", "centre_x", "centre_y", "openings")
"""Sums over the points: normal and friction force [N], share of closed points, centre of pressure [m], number of
openings so far."""
NORMAL, FRICTION, FRACTION, CENTRE_X, CENTRE_Y, OPENINGS = range(len(SUMS))
COUNTED = 2.0**-20
"""Exact increment of the state per opening; a million openings stay below `clock.limit`."""
