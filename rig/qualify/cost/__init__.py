"""What accuracy costs in time, for any scene, on this machine: `rig cost`.

problem    what is measured of a scene              settings   methods with their steps and tolerances
measures   what a run comes to, physically          reference  what is taken for true
timing     what a setting costs                     table      rows, kept as CSV and Parquet
front      which setting to take                    order      order of errors, beside theory
"""

from rig.qualify.cost.choice import chosen
from rig.qualify.cost.measuring import FOLDER, cost, folder_of
from rig.qualify.cost.pareto import front, recommended
from rig.qualify.cost.table import WORST, Row, Table

__all__ = ["FOLDER", "WORST", "Row", "Table", "chosen", "cost", "folder_of", "front", "recommended"]
