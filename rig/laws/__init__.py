"""Friction laws, one per file: the coefficient mu over the slip speed, at rest, and over internal states.

A law is the table `[friction]` of a rig, whose key `law` names it: a module of this package, a part that another
package has installed, or a file (`law = "./my_law.py"`). Its class is derived from `FrictionLaw`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from contextvars import ContextVar
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, Self

from pydantic import GetCoreSchemaHandler, ModelWrapValidatorHandler, create_model, model_validator
from pydantic_core import CoreSchema, PydanticKnownError, core_schema

from rig.about import About
from rig.errors import PartError
from rig.model.friction_law import Law
from rig.parts import Room, code_of, is_file, named, one_class
from rig.quantities import Section

LAW = "law"
"""Key of a table that names a friction law."""
_CARRIED: ContextVar[Mapping[str, type[FrictionLaw]] | None] = ContextVar("carried", default=None)
"""Laws from elsewhere that a rig which is just read has: name -> class."""


class FrictionLaw(Section):
    """The table of a friction law. As the type of a field it stands for all of them: the key `law` says which."""

    declares: ClassVar = About("a coefficient over the slip speed; stick and slip")

    law: str

    def friction(self) -> Law:
        """The law for the solver."""
        raise NotImplementedError

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


_MADE: dict[tuple[Any, ...], type[Section]] = {}


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


def _law(module: ModuleType, name: str) -> type[FrictionLaw]:
    """The class of a law, with the key `law`."""
    what = "class derived from rig.laws.FrictionLaw"
    own: type[FrictionLaw] = one_class(module, lambda kind: issubclass(kind, FrictionLaw), "Law", what)
    return own if code_of(module) is None else named(module, (own,), LAW, name)


LAWS: Room[type[FrictionLaw]] = Room("laws", __name__, __path__, _law)
"""Friction laws by name: `LAWS["coulomb"]` is that of rig/laws/coulomb.py."""
