"""The same problem by other people's solvers, in one interleaved run: `rig cost SCENE --peers`.

    oscillator   what a peer is asked: one mass, one contact, constant load and speed
    race         everybody in turns; cost at an error

One module for each peer: `ladder()` gives its settings, `prepare(oscillator, setting)` a function that runs once and
returns the times of its mode changes, with samples every millisecond on the way. Stick is left to its closed form for
every peer that can be stopped at an event: what is measured is slip and its events.
"""

from rig.qualify.cost.peers.race import Entry, race

__all__ = ["Entry", "race"]
