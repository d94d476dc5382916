"""The torture test: a matrix of hard cases by methods by steps; each cell is green, amber or red with one reason.

case                  a case: a TOML file in `cases`
rigs                  small rigs that no scene has
case_scene            the scene of a case, with outputs of each contact
outcome               the result of a run
film_checks           checks of the points of a film
user_run              a run as a user makes it: recorded and verified, and as processes
trial                 one run with a check of every step
rk4_without_events    Runge-Kutta across the sign of the slip speed: for comparison
wrong_methods         contact forces by other failing methods: for comparison
cell_result           green, amber or red
cells                 the cells and their results
case_cells            all cases, in worker processes
figure                the matrix as a picture
report                JSON and JUnit
search                random search over the boxes of the cases
"""

from rig.qualify.torture.cells import Cell, matrix

__all__ = ["Cell", "matrix"]
