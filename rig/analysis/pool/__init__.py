"""Many independent units of work, on all cores or on a cluster, with results in a folder from which they continue.

work       what a work is: a pure function over numbered items; batches, and the second attempt after a lost worker;
           results in a folder, one file for each batch
carry_out  what is not in the store is computed, here, by worker processes or on a cluster
worker     a worker process of this machine
cluster    the workers of a dask cluster

The numbers of a unit depend on the work alone: neither the worker nor the number of workers changes them.
"""

from __future__ import annotations

from rig.analysis.pool.carry_out import Ask, asking, carry_out, pool, temporary
from rig.analysis.pool.work import Arrays, Progress, Store, Work, digest, packed, unpacked

__all__ = [
    "Arrays",
    "Ask",
    "Progress",
    "Store",
    "Work",
    "asking",
    "carry_out",
    "digest",
    "packed",
    "pool",
    "temporary",
    "unpacked",
]
