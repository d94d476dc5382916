"""The torture test: a matrix of hard cases by methods by steps; each cell is green, amber or red with one reason.

case            a case: a TOML file in `cases`; small rigs that no scene has; the scene of a case
trial           one run with a check of every step; a run as a user makes it: recorded and verified, and as processes
results         the outcome of a run; green, amber or red
cells           the cells and their results, of all cases in worker processes
report          JSON and JUnit
picture         the matrix as a picture
search          random search over the boxes of the cases
"""

from rig.qualify.torture.cells import Cell, matrix

__all__ = ["Cell", "matrix"]
