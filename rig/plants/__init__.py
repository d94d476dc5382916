"""What stands on the bench, one file each: physical parameters in, rows out.

A plant is a module with a section `Parameters` and a function `assemble(parameters, moved)`, which gives a
`rig.model.assembly.Assembly`. `PLANTS` finds it by its name; there is no list. What several plants are made of is in
`structures`.

`PICTURES` of the module says what is to be drawn of it (rig.picture). A table that the plant may be without is an
effect; it says what it is (rig.about).
"""

from __future__ import annotations

from types import ModuleType

from rig.errors import PartError
from rig.parts import Room, code_of
from rig.quantities import Section


def _plant(module: ModuleType, name: str) -> ModuleType:
    code = code_of(module)
    where = code.file if code is not None else module.__name__
    model = getattr(module, "Parameters", None)
    if not (isinstance(model, type) and issubclass(model, Section)):
        raise PartError(f"{where}: defines no class Parameters derived from Section")
    if not callable(getattr(module, "assemble", None)):
        raise PartError(f"{where}: defines no function assemble(parameters, moved)")
    return module


PLANTS = Room("plants", __name__, __path__, _plant)
"""Plants by name, as modules."""
