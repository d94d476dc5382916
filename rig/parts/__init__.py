"""Parts: plants, effects, friction laws, sensors and controllers, each one Python file that declares what others need.

    KINDS = Room("sensors", __name__, __path__, read)        in sensors/__init__.py
    KINDS["microphone"]                                      rig/sensors/microphone.py, imported now
    KINDS["toy"]                                             entry point `toy` of the group friction_rig.sensors
    KINDS["/path/to/my_sensor.py"]                          a file that a scene names

room    the parts of one kind, found by name        code    source text from elsewhere, run as a module if trusted
binary  compiled parts (libraries and FMUs) and data files

A part from a file or from another package is called foreign. A recording holds its source text and the SHA-256 of that.
"""

from __future__ import annotations

from rig.parts.binary import Binary, DataFile, is_binary
from rig.parts.code import Code, calling, code_of, file_of, foreign_fault, place_of, require, trust
from rig.parts.room import Parts, Room, carried, is_file, named, one_class, package_of, require_types, trust_scene

__all__ = [
    "Binary",
    "Code",
    "DataFile",
    "Parts",
    "Room",
    "calling",
    "carried",
    "code_of",
    "file_of",
    "foreign_fault",
    "is_binary",
    "is_file",
    "named",
    "one_class",
    "package_of",
    "place_of",
    "require",
    "require_types",
    "trust",
    "trust_scene",
]
