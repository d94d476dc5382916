"""Plants, one per file: from physical parameters to the rows of the equations of motion.

A plant is a module with a section `Parameters` and a function `assemble(parameters, moved)`, which returns a
`rig.model.assembly.Assembly`. `PLANTS` finds the module by its name; there is no list. Structures that several plants
use are in `structures`.

`PICTURES` of the module describes its picture (rig.picture). `HANDS`, a `rig.quantities.Hand` by key, names the values
that matter to a person at the bench; those that a scene does not have are left out. An optional table of a plant is an
effect and describes itself (rig.about).
"""

from __future__ import annotations

from types import ModuleType

from rig.errors import PartError
from rig.parts import Room, code_of, file_of, require_types
from rig.picture import Own, Picture
from rig.quantities import Hand, Section
from rig.units import brief


def _plant(module: ModuleType, name: str) -> ModuleType:
    where = file_of(module)
    model = getattr(module, "Parameters", None)
    if not (isinstance(model, type) and issubclass(model, Section)):
        raise PartError(f"{where}: defines no class Parameters derived from Section")
    if not callable(getattr(module, "assemble", None)):
        raise PartError(f"{where}: defines no function assemble(parameters, moved)")
    if code_of(module) is not None:
        require_types(model, module)
    pictures = getattr(module, "PICTURES", ())
    figure = getattr(module, "FIGURE", None)
    if not isinstance(pictures, tuple | list) or not all(isinstance(picture, Picture) for picture in pictures):
        raise PartError(f"{where}: PICTURES is {brief(pictures)}; expected a tuple of pictures of rig.picture")
    if figure is not None and not isinstance(figure, Own):
        raise PartError(f"{where}: FIGURE is {brief(figure)}; expected a rig.picture.Own")
    hands = getattr(module, "HANDS", {})
    if not isinstance(hands, dict) or not all(isinstance(hand, Hand) for hand in hands.values()):
        raise PartError(f"{where}: HANDS is {brief(hands)}; expected a rig.quantities.Hand by the key of each value")
    for own in (*pictures, figure):
        if isinstance(own, Own) and own.drawer.startswith(":") and not hasattr(module, own.drawer[1:]):
            raise PartError(f"{where}: names {own.drawer!r} as what draws it, and defines no {own.drawer[1:]}")
    return module


PLANTS = Room("plants", __name__, __path__, _plant)
"""Plants by name, as modules."""
