"""Friction laws, one per file: the coefficient mu over the slip speed, at rest, and over internal states.

A law is the table `[friction]` of a rig, whose key `law` names it: a module of this package, a part that another
package has installed, or a file (`law = "./my_law.py"`). Its class is derived from `FrictionLaw`.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextvars import ContextVar
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, Self

import numpy as np
from pydantic import GetCoreSchemaHandler, ModelWrapValidatorHandler, create_model, model_validator
from pydantic_core import CoreSchema, PydanticKnownError, core_schema

from rig.about import About
from rig.errors import PartError
from rig.model.friction_law import InternalState, Law, Origin, from_formula
from rig.model.row_checks import name_fault
from rig.parts import Room, calling, code_of, file_of, is_file, named, one_class, place_of
from rig.quantities import Section
from rig.units import brief, is_number, unit_fault

__all__ = ["LAWS", "Friction", "FrictionLaw", "InternalState"]
LAW = "law"
"""Key of a table that names a friction law."""
_CARRIED: ContextVar[Mapping[str, type[FrictionLaw]] | None] = ContextVar("carried", default=None)
"""Laws from elsewhere that a rig which is just read has: name -> class."""
_MADE: dict[tuple[Any, ...], type[Section]] = {}
_KEPT = 1000  # most laws from formulas that are remembered [chosen]
_LAWS: dict[tuple[Any, ...], Law] = {}
"""Laws from formulas that were made: class, numbers, static coefficient -> law; of the last ones."""


class FrictionLaw(Section):
    """The table of a friction law. As the type of a field it stands for all of them: the key `law` says which.

    A law is a formula: static methods, plain functions that numba compiles. p: the numbers of the law; w: slip speed
    [m/s], at least 0; N: load [N]; z: internal states in the direction of slip.

        mu(p, w), slope(p, w)       coefficient, and its derivative with respect to w; with `states`:
        mu(p, w, N, z)              coefficient
        rates(p, w, N, z, dz)       writes the rate of each state
        slopes(p, w, N, z, d)       writes derivatives, d[0] of mu and d[1 + i] of rate i, over w, N and each state
        stored(p, N, z)             optional: energy in the contact [J]

    states  internal states; none for a coefficient over the slip speed
    sticks  whether the contact sticks truly; False: it deflects instead (presliding)
    jumps   slip speeds at which mu jumps [m/s]
    """

    declares: ClassVar[About] = About("a coefficient over the slip speed; stick and slip")
    states: ClassVar[tuple[InternalState, ...]] = ()
    sticks: ClassVar[bool] = True
    jumps: ClassVar[tuple[float, ...]] = ()

    law: str

    def numbers(self) -> Any:
        """The numbers p of the formulas: a tuple; by default a named tuple of the values that are numbers."""
        from rig.laws.formulas.compiled import numbers_class

        values = {key: getattr(self, key) for key in type(self).model_fields if key != LAW}
        kept = {key: value for key, value in values.items() if isinstance(value, bool | int | float | tuple)}
        return numbers_class(type(self), tuple(kept))(*kept.values())

    def static(self) -> float | None:
        """The coefficient of a contact that sticks; None: mu at w = 0."""
        return None

    def friction(self) -> Law:
        """The law for the solver. Raises PartError, with every fault, for a law from elsewhere that is wrong."""
        return _from_formulas(self)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        if cls is not FrictionLaw:
            return handler(source)
        as_it_is: Callable[..., Any] = lambda law, serialise: serialise(law)  # noqa: E731
        written = core_schema.wrap_serializer_function_ser_schema(as_it_is, schema=core_schema.any_schema())
        return core_schema.no_info_plain_validator_function(_by_name, serialization=written)


Friction = FrictionLaw
"""The type of a field that contains a friction law."""


def _by_name(value: Any) -> FrictionLaw:
    """The law of a table."""
    if isinstance(value, FrictionLaw):
        return value
    if not isinstance(value, Mapping) or LAW not in value:
        raise PydanticKnownError("union_tag_not_found", {"discriminator": f"'{LAW}'"})
    if (kind := class_of(value, _CARRIED.get() or {})) is None:
        tag = {"discriminator": f"'{LAW}'", "tag": str(value[LAW]), "expected_tags": ", ".join(LAWS)}
        raise PydanticKnownError("union_tag_invalid", tag)
    name = value[LAW]
    return kind.model_validate({**value, LAW: Path(name).name if is_file(name) else name})


def class_of(table: Mapping[str, Any], carried: Mapping[str, type[FrictionLaw]]) -> type[FrictionLaw] | None:
    """The class of the law that a table names; None for an unknown name. `carried`: laws from elsewhere by name.

    Raises PartError for a law from elsewhere that fails, or whose source is not there.
    """
    name = table.get(LAW)
    if not isinstance(name, str) or (name not in {*carried, *LAWS} and not is_file(name)):
        return None
    if name in carried:
        return carried[name]
    if is_file(name) and os.path.basename(name) == name:  # the name in a recording: no file beside this process
        raise PartError(f"the source of {name} is missing")
    return LAWS[name]


class _Carrying(Section):
    """Parameters of a rig with friction laws from elsewhere, `laws`: name -> class."""

    laws: ClassVar[Mapping[str, type[FrictionLaw]]] = {}

    @model_validator(mode="wrap")
    @classmethod
    def _known(cls, value: Any, read: ModelWrapValidatorHandler[Self]) -> Self:
        token = _CARRIED.set(cls.laws)
        try:
            return read(value)
        finally:
            _CARRIED.reset(token)


def with_laws(model: type[Section], laws: Mapping[str, type[FrictionLaw]]) -> type[Section]:
    """The parameters of a rig, with friction laws from elsewhere that its tables name. Equal arguments, one class."""
    if not laws:
        return model
    which = model, tuple(sorted(laws.items(), key=lambda item: item[0]))
    if which not in _MADE:
        _MADE[which] = create_model(
            model.__name__, __base__=(model, _Carrying), __module__=model.__module__, __doc__=model.__doc__
        )
        _MADE[which].laws = dict(laws)  # type: ignore[attr-defined]
    return _MADE[which]


def laws_of(model: type[Section]) -> Mapping[str, type[FrictionLaw]]:
    """The friction laws from elsewhere that the parameters of a rig have: name -> class."""
    return model.laws if issubclass(model, _Carrying) else {}


def _from_formulas(section: FrictionLaw) -> Law:
    """The law of a section with formulas, checked if its class is from elsewhere."""
    from rig.laws.formulas import checks, compiled

    kind = type(section)
    module = sys.modules[type(section).__module__]
    with calling(module):
        numbers = section.numbers()
        states = tuple(section.states)
        jumps = tuple(map(float, section.jumps))
        rest = None if (static := section.static()) is None else float(static)
    if code_of(module) is not None:  # `states` may be a property, which depends on values
        if wrong := [*_wrong_states(states)]:
            raise PartError("\n".join(f"{file_of(module)}: {kind.__name__}.states {line}" for line in wrong))
    try:
        shape = compiled.shape_of(numbers)
    except TypeError as error:
        raise PartError(
            f"{file_of(module)}: numbers() contains {error}; expected a tuple of numbers, also named or nested"
        ) from None
    row = tuple(compiled.flat(numbers))
    which = kind, shape, row, rest, states, jumps
    if which in _LAWS:
        return _LAWS[which]
    foreign = code_of(module) is not None
    if foreign:
        compiled.try_in_python(kind, module, numbers, states)
    formula = compiled.formula_of(kind, module, shape, states, section.sticks)
    first = formula.evaluate(row, 0.0, 1.0, np.array([state.start for state in states]))[0]
    at_rest = float(first[0]) if rest is None else rest
    origin = None
    if foreign:
        values = ", ".join(f"{key} = {brief(value)}" for key, value in section if key != LAW)
        head = f"{file_of(module)}: friction law {section.law}" + (f" ({values})" if values else "")
        if lines := list(checks.faults(formula, row, at_rest, jumps)):
            raise PartError("\n".join(f"{head}: {line}" for line in lines))
        places = {name: place_of(function) for name, function in compiled.formulas_of(kind).items()}
        origin = Origin(head, places)
    if len(_LAWS) >= _KEPT:
        _LAWS.clear()
    _LAWS[which] = from_formula(at_rest, row, formula, origin)
    return _LAWS[which]


def _law(module: ModuleType, name: str) -> type[FrictionLaw]:
    """The class of a law, with the key `law`. Raises PartError, with every fault of one from elsewhere."""
    what = "class derived from rig.laws.FrictionLaw"
    own: type[FrictionLaw] = one_class(module, lambda kind: issubclass(kind, FrictionLaw), "Law", what)
    if code_of(module) is None:
        return own
    if lines := list(_misdeclared(own)):
        raise PartError("\n".join(f"{file_of(module)}: {line}" for line in lines))
    law: type[FrictionLaw] = named(module, (own,), LAW, name)
    if own.friction is not FrictionLaw.friction:
        law.friction = _friction_of(own, module)  # type: ignore[method-assign, assignment]
    return law


def _friction_of(own: type[FrictionLaw], module: ModuleType) -> Callable[[FrictionLaw], Law]:
    """The method `friction` of a class from elsewhere. It raises PartError for what is no law."""

    def friction(section: FrictionLaw) -> Law:
        with calling(module):
            law = own.friction(section)
        if not isinstance(law, Law):
            raise PartError(f"{file_of(module)}: friction() gives {brief(law)}; expected a rig.model.friction_law.Law")
        return law

    return friction


def _misdeclared(own: type[FrictionLaw]) -> Iterator[str]:
    """What is wrong with the class of a law, a line each."""
    from rig.laws.formulas.compiled import lacking

    states = own.states
    if isinstance(states, tuple):
        yield from (f"{own.__name__}.states {line}" for line in _wrong_states(states))
    elif not isinstance(states, property):
        yield f"{own.__name__}.states is {brief(states)}; expected a tuple of rig.laws.InternalState"
    if not isinstance(own.declares, About):
        yield f"{own.__name__}.declares is {brief(own.declares)}; expected a rig.about.About"
    for key, kind, text in (("sticks", bool, "True or False"), ("jumps", tuple, "a tuple of slip speeds in m/s")):
        if not isinstance(getattr(own, key), kind | property):
            yield f"{own.__name__}.{key} is {brief(getattr(own, key))}; expected {text}"
    if not own.sticks and not states:
        yield f"{own.__name__}.sticks is False without states; a contact that does not stick needs a deflection"
    if own.friction is FrictionLaw.friction:
        yield from (f"{line}" for line in lacking(own, bool(states)))


def _wrong_states(states: tuple[Any, ...]) -> Iterator[str]:
    """What is wrong with the internal states of a law, a line each: the end of a sentence."""
    for state in states:
        if not isinstance(state, InternalState):
            yield f"contains {brief(state)}; expected rig.laws.InternalState(NAME, UNIT)"
            return
    names = [state.name for state in states]
    for i, state in enumerate(states):
        if fault := name_fault(state.name):
            yield f"contains a state whose name {fault}"
        elif state.name in names[:i]:
            yield f"contains two states {state.name!r}; give each a name of its own"
        if fault := unit_fault(state.unit):
            yield f"contains {brief(state.name)}, whose unit {fault}"
        if not is_number(state.start):
            yield f"contains {brief(state.name)}, whose start is {brief(state.start)}; expected a finite number"
        if not isinstance(state.along, bool):
            yield f"contains {brief(state.name)}, whose along is {brief(state.along)}; expected True or False"


LAWS: Room[type[FrictionLaw]] = Room("laws", __name__, __path__, _law)
"""Friction laws by name: `LAWS["coulomb"]` is that of rig/laws/coulomb.py."""
