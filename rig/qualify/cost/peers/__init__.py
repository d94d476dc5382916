"""Comparison with other solvers on the same problem, in one interleaved run: `rig cost SCENE --peers`.

    oscillator   the problem: one mass, one contact, constant load and speed
    solvers      the solvers; samples every millisecond
    race         all solvers alternating; cost at an error

Every peer that can stop at an event gets the closed form of stick: only slip and its events are measured.
"""

from rig.qualify.cost.peers.race import Entry, race

__all__ = ["Entry", "race"]
