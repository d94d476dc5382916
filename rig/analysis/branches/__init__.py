"""Branches: the stable and unstable motions of a rig over a parameter, where they begin, turn and end.

compute     what is followed and from where; saved while it is computed
places      points of a branch: cycles with derivative and tangent, moved, cut into parts and rescaled
trace       pseudo-arclength along cycles, special points, boundaries between sequences of events
distances   how far a cycle is from other events
begin       the first place of a branch: Hopf points, simulations, maps, recordings, forced motions
curves      special points over two parameters
threshold   the unstable cycle as threshold: least knocks, shares of starts
result      branches as text, JSON, CSV, xarray
figure      their picture
"""

from rig.analysis.branches.begin import HOPF, SIMULATION, Start, values_of
from rig.analysis.branches.compute import FILE, POINTS, ROOT, Job, branches, job, store_of
from rig.analysis.branches.curves import Curve, Curves, curves, curves_store
from rig.analysis.branches.result import Branch, Branches, Point, SpecialPoint
from rig.analysis.branches.threshold import Asked, Knock, Share, Threshold

__all__ = [
    "FILE",
    "HOPF",
    "POINTS",
    "ROOT",
    "SIMULATION",
    "Asked",
    "Branch",
    "Branches",
    "Curve",
    "Curves",
    "Job",
    "Knock",
    "Point",
    "Share",
    "SpecialPoint",
    "Start",
    "Threshold",
    "branches",
    "curves",
    "curves_store",
    "job",
    "store_of",
    "values_of",
]
