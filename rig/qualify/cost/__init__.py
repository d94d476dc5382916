"""Error against compute time, for any scene, on this machine: `rig cost`.

The simulation problem, its measures and the settings are in rig.analysis.cycles.motion_measures.

references  reference solutions                      measuring  measures of each setting
timing      the compute time of a setting            table      rows, kept as CSV and Parquet; recommended setting
report      the table as text and figure             effects    cost of each effect, change without it
"""

from rig.qualify.cost.measuring import FOLDER, chosen, cost, folder_of
from rig.qualify.cost.table import WORST, Row, Table, front, recommended

__all__ = ["FOLDER", "WORST", "Row", "Table", "chosen", "cost", "folder_of", "front", "recommended"]
