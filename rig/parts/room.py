"""The parts of one kind by name: those in the folder of a package, entry points of other packages, files."""

from __future__ import annotations

import importlib
import json
import pkgutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

from pydantic import BaseModel, PydanticUndefinedAnnotation, PydanticUserError, TypeAdapter, create_model

from rig.errors import PartError, kind_and_text
from rig.parts.binary import binaries
from rig.parts.code import Code, calling, file_of, keep, trust, trust_hashes
from rig.units import brief

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

T = TypeVar("T")
Parts = Mapping[tuple[str, str], Code]
"""Foreign parts that a recording contains: (kind of part, name) -> code."""
_NAMED: dict[tuple[Any, ...], Any] = {}


class Room(Mapping[str, T], Generic[T]):
    """The parts of one kind (`what`: "plants"). Only what is asked for is imported.

    room[name]  a part of the package `package`, else an entry point of the group `friction_rig.<what>`, else, for a
                name that ends in .py, a file, which is then trusted. Raises KeyError for an unknown name, PartError
                for a part that fails
    iteration   the names of all but files

    `read(module, name)` makes of a module what the room hands out.
    """

    def __init__(self, what: str, package: str, path: Iterable[str], read: Callable[[ModuleType, str], T]) -> None:
        self.what = what
        self._package = package
        self._path = path
        self._read = read
        self._made: dict[str, T] = {}

    @cached_property
    def shipped(self) -> tuple[str, ...]:
        """Names of the parts in the package: its modules, none of which is imported for that."""
        return tuple(sorted(module.name for module in pkgutil.iter_modules(self._path) if not module.ispkg))

    @cached_property
    def installed(self) -> dict[str, tuple[EntryPoint, ...]]:
        """Parts of other packages: name -> entry points; with several the name is ambiguous."""
        from importlib.metadata import entry_points  # 10 ms: only where a name is not in the folder

        entries: dict[str, tuple[EntryPoint, ...]] = {}
        for entry in entry_points(group=f"friction_rig.{self.what}"):
            entries[entry.name] = (*entries.get(entry.name, ()), entry)
        return entries

    def __iter__(self) -> Iterator[str]:
        return iter(sorted({*self.shipped, *self.installed}))

    def __len__(self) -> int:
        return len({*self.shipped, *self.installed})

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and (name in self.shipped or is_file(name) or name in self.installed)

    def __getitem__(self, name: str) -> T:
        if not is_file(name):
            return self.get_from(name, {})
        path = Path(name)
        code = Code.read(path)
        trust([code])
        return self._of(code.module(path), path.name)

    def get_from(self, name: str, parts: Parts) -> T:
        """What `room[name]` is for a recording with the parts `parts`: these come first, and no file is read."""
        code = parts.get((self.what, name))
        if code is not None:
            installed = self._import(name) if self._same(name, code) else None
            return self._of(installed or code.module(), name)
        if is_file(name):
            raise PartError(f"the recording lacks the source of {name}")
        if name not in self._made:
            if name in self.shipped:
                self._made[name] = self._of(importlib.import_module(f"{self._package}.{name}"), name)
            elif name in self.installed:
                self._made[name] = self._of(self._import(name), name)
            else:
                raise KeyError(name)
        return self._made[name]

    def _of(self, module: ModuleType, name: str) -> T:
        with calling(module):
            return self._read(module, name)

    def trusted(self, name: str, code: Code) -> bool:
        """Whether a part of a recording may be run: its text is trusted, or is what is installed under its name."""
        return code.trusted or self._same(name, code)

    def _same(self, name: str, code: Code) -> bool:
        if is_file(name) or len(self.installed.get(name, ())) != 1:
            return False
        installed_code = _code(self.installed[name][0])
        return installed_code is not None and installed_code.sha256 == code.sha256

    def _import(self, name: str) -> ModuleType:
        entry, *others = self.installed[name]
        if others:
            packages = " and ".join(package_of(point) for point in (entry, *others))
            remedy = "uninstall all but one, or name the file of the part"
            raise PartError(f"several packages have installed a part {name}: {packages}; {remedy}")
        try:
            module = importlib.import_module(entry.module)
            code = _code(entry)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            where = f"part {name} of {package_of(entry)}"
            raise PartError(f"{where} cannot be imported: {kind_and_text(error)}") from error
        if code is not None:
            keep(module, code)
        return module


def _code(entry: EntryPoint) -> Code | None:
    """The code of an entry point, without running it."""
    spec = find_spec(entry.module)
    return Code.read(Path(spec.origin)) if spec is not None and spec.origin else None


def package_of(entry: EntryPoint) -> str:
    """Name and version of the package that has installed a part."""
    return f"{entry.dist.name} {entry.dist.version}" if entry.dist is not None else "an unknown package"


def is_file(name: str) -> bool:
    """Whether the name of a part is that of a file."""
    return name.endswith(".py")


def one_class(module: ModuleType, fits: Callable[[type], bool], called: str, what: str) -> Any:
    """The class of a part's module that `fits`; of several the one that is `called` so.

    Raises PartError if there are several, or none; `what` says in words what is looked for, "" if there may be none.
    """
    where = file_of(module)
    own = [
        member for member in vars(module).values() if isinstance(member, type) and member.__module__ == module.__name__
    ]
    classes = {kind.__name__: kind for kind in own if fits(kind)}
    if not classes and what:
        raise PartError(f"{where}: defines no {what}")
    if len(classes) > 1 and called not in classes:
        names = ", ".join(classes)
        raise PartError(f"{where}: defines {names}, of which only one can count; call that one {called}")
    return classes.get(called) or next(iter(classes.values()), None)


def carried(raw: Any) -> dict[tuple[str, str], Code]:
    """The foreign parts in the JSON of a scene. Raises PartError for what is no such list, or has another hash."""
    try:
        return {(str(part["part"]), str(part["name"])): Code.from_json(part) for part in raw}
    except (KeyError, TypeError, AttributeError):
        raise PartError("the recording describes its parts in an unknown form: it is damaged") from None


def trust_scene(text: str) -> None:
    """Let this process run the parts that the JSON `text` of a scene contains, on the user's word.

    Raises PartError for a part whose source does not have the hash that is stated; then none is trusted.
    """
    try:
        raw = json.loads(text)
    except ValueError:  # lost by damage: whoever needs the scene says so
        return
    if isinstance(raw, dict):
        compiled = list(binaries(raw.get("controllers")))
        trust(carried(raw.get("parts", [])).values())
        trust_hashes(binary.sha256 for binary in compiled)


def named(
    module: ModuleType,
    bases: tuple[type[BaseModel], ...],
    key: str,
    name: str,
    fields: Mapping[str, tuple[Any, Any]] | None = None,
) -> Any:
    """The table of a foreign part: the fields of `bases`, more `fields`, and `key`, the name of the part.

    One class for equal arguments, so that equal tables are equal. Raises PartError for a type that no value can have.
    """
    which = module.__name__, bases, key, name
    if which not in _NAMED:
        given: dict[str, Any] = {key: (Literal[name], name), **(fields or {})}
        made = create_model(
            bases[0].__name__, __base__=bases, __module__=module.__name__, __doc__=bases[0].__doc__, **given
        )
        require_types(made, module)
        _NAMED[which] = made
    return _NAMED[which]


def require_types(model: type[BaseModel], module: ModuleType) -> None:
    """Raise PartError for a table of a foreign part with a value whose type is unknown, or is none for a scene."""
    try:
        model.model_rebuild()
    except (PydanticUserError, PydanticUndefinedAnnotation) as error:
        wrong = [name for name, info in model.model_fields.items() if not _is_type(info.annotation)]
        value = f"{model.__name__}{f'.{wrong[0]}' if wrong else ''}"
        kinds = "a quantity, a number, a text, or tuples and dicts of these"
        why = brief(model.model_fields[wrong[0]].annotation) if wrong else error.message
        raise PartError(f"{file_of(module)}: {value} has no type that a scene can hold: {why}; use {kinds}") from error


def _is_type(annotation: Any) -> bool:
    try:
        TypeAdapter(annotation)
    except (PydanticUserError, PydanticUndefinedAnnotation):
        return False
    return True
