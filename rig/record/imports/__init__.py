"""Measurements of any bench as recordings.

columns            what a file becomes: columns with units and time bases
measurement_file   files of data acquisition systems, block by block
hdf5_file          files that nest groups and tables
text_table         the form of a table in a text file: separator, decimal comma, header
channel_map        what each column becomes: name, scale, unit; the map that a TOML file keeps
import_run         several files joined to one run, its time base, and the recording
"""
