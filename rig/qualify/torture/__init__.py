"""Hard cases by methods by steps: each cell green, amber or red with one reason.

case      a case: a TOML file in `cases`
rigs      small rigs that no scene has
watched   the scene of a case, its contacts told by their own names
found     what a run has come to
points    points of a film, looked at
trial     one run, every step looked at
sign      Runge-Kutta across the sign of the slip speed: for comparison
verdict   what a run is worth
cells     what is run, and what came of it
figure    the matrix as a picture
report    JSON and JUnit
search    random search over the boxes of the cases
"""

from rig.qualify.torture.cells import Cell, matrix

__all__ = ["Cell", "matrix"]
