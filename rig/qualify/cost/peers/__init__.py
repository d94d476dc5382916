"""Comparison with other solvers on the same problem, in one interleaved run: `rig cost SCENE --peers`.

    oscillator   the problem: one mass, one contact, constant load and speed
    race         all solvers alternating; cost at an error

One module for each peer: `ladder()` gives its settings, `prepare(oscillator, setting)` a function that runs once and
returns the times of its mode set changes, with samples every millisecond. Every peer that can stop at an event gets the
closed form of stick: only slip and its events are measured.
"""

from rig.qualify.cost.peers.race import Entry, race

__all__ = ["Entry", "race"]
