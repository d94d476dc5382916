"""Recordings for other programs: CSV, Parquet, MATLAB, HDF5, netCDF, WAV; frames of pandas and datasets of xarray.

files         the formats, and writing of files: completely or not at all
tables        a run as tables, which all formats share
lower_rate    signals at a lower rate, behind a filter against aliasing
description   what a file says about its run
frames        tables for pandas and xarray
arrow_files   CSV and Parquet
mat_file      MATLAB
package       the description of a folder of files (Frictionless Data Package)
"""

from __future__ import annotations

from rig.record.export.files import FORMATS, Written, export
from rig.record.export.tables import Table, Tables, tables

__all__ = ["FORMATS", "Table", "Tables", "Written", "export", "tables"]
