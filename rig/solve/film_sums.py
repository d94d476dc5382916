"""The sums over the points of a film."""

from __future__ import annotations

SUMS = ("normal", "friction", "fraction", "centre_x", "centre_y", "openings")
"""Over the points: forces [N], share of them that is closed, where they press in the middle [m], and how often one has
opened so far."""
NORMAL, FRICTION, FRACTION, CENTRE_X, CENTRE_Y, OPENINGS = range(len(SUMS))
COUNTED = 2.0**-20
"""What an opening adds to its state, exactly: a million of them are no state beyond `clock.limit`."""
