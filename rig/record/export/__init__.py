"""Recordings for other programs: CSV, Parquet, MATLAB, HDF5, netCDF, WAV; frames of pandas and datasets of xarray.

files   the formats, and writing of files: completely or not at all; what a file says about its run
tables  a run as tables, which all formats share; lower_rate: signals at a lower rate, behind a low-pass filter
"""

from __future__ import annotations

from rig.record.export.files import FORMATS, Written, export
from rig.record.export.tables import Table, Tables, tables

__all__ = ["FORMATS", "Table", "Tables", "Written", "export", "tables"]
