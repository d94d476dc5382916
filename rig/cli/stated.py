"""Options that functions of `rig` state with their parameters: what typer reads of them, and what it becomes."""

from __future__ import annotations

import builtins
import collections.abc
import typing
from collections.abc import Callable, Iterable, Mapping
from inspect import Parameter, signature
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, NamedTuple, Union, get_args, get_origin, get_type_hints

import typer

from rig import parameters
from rig.cli.options import SHORTEST, assigned, changes, paired, recording, scene_file, seconds, separated
from rig.cli.printing import new_folder
from rig.parameters import Argument, Option

TEXTS: Mapping[str, Callable[[str, str], object]] = {
    "TIME": lambda given, flag: seconds(given, flag, 0.0 if flag == "--from" else SHORTEST),
    "TIMES": lambda given, flag: [seconds(text, flag, 0.0) for text in separated(given)],
    "LIST": lambda given, flag: tuple(separated(given)),
    "NAMES": lambda given, flag: separated(given),
    "KEY=VALUES, ...": lambda given, flag: given,
}
"""What is typed -> how its text becomes the value of the parameter, given the flag too; others stay what they are."""
SEVERAL: Mapping[str, Callable[[list[str] | None, str], object]] = {
    "KEY=VALUE": changes,
    "KEY=VALUES": assigned,
    "KEY=FROM:TO": assigned,
    '"ACTUATOR = CHANNEL"': assigned,
    '"CHANNEL = SIMULATED, FACTOR"': assigned,
}
"""The same for options that may be repeated."""
_CHECKS = {"SCENE": scene_file, "LOG": recording, "KEY=VALUE": paired, "FOLDER": new_folder}
"""What is typed -> its check, which typer calls when it has read it."""


class Stated(NamedTuple):
    """An option: its flag, its description, its default, and the types that the parameter may have."""

    flag: str
    option: Option
    default: Any = None
    types: frozenset[Any] = frozenset({str})

    @property
    def _reader(self) -> Callable[[Any, str], object] | None:
        if isinstance(self.option, Argument):
            return None
        return (SEVERAL if self._several else TEXTS).get(self.option.value)

    @property
    def _several(self) -> bool:
        """Whether the option may be repeated."""
        many = not self.types.isdisjoint((Mapping, Iterable))
        return many and Path not in self.types and self.option.value not in TEXTS

    def read(self, given: Any) -> Any:
        """Return the value for what was typed. Raises UsageError."""
        if given is None and not self._several:
            return self.default
        return given if self._reader is None else self._reader(given, self.flag)

    def parameter(self, name: str) -> Parameter:
        """Return the parameter of the function that typer calls."""
        default = self.default
        if self._several:
            kind: Any = list[str]
            default = None
        elif self._reader is not None:
            kind = str
            default = ",".join(default) if isinstance(default, tuple) else None
        elif self.option.value == "SCENE":
            kind = str
        else:
            kind = next((kind for kind in (bool, int, Path, float) if kind in self.types), str)
            default = Path(default) if kind is Path and isinstance(default, str) else default
        value, about, _, low, high = self.option
        how: dict[str, Any] = {"metavar": value or None, "help": about, "callback": _CHECKS.get(value)}
        if isinstance(self.option, Argument):
            info = typer.Argument(**how)
        else:
            info = typer.Option(self.flag, min=low, max=high, show_default=default != "", **how)
        kind = kind | None if default is None else kind
        return Parameter(name, Parameter.KEYWORD_ONLY, annotation=Annotated[kind, info], default=default)


def stated(function: Callable[..., object]) -> dict[str, Stated]:
    """Return the parameters of a function of `rig` that are options."""
    options: dict[str, Stated] = {}
    for name, hint in hints(function).items():
        if get_origin(hint) is Annotated:
            kind, option = get_args(hint)
            kinds = get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)
            types = frozenset(get_origin(kind) or kind for kind in kinds)
            default = signature(function).parameters[name].default
            options[name] = Stated(option.flag or f"--{name.replace('_', '-')}", option, default, types)
    return options


def hints(function: Callable[..., object]) -> dict[str, Any]:
    """Return the types of the parameters of a function; those that only type checkers import are Any."""
    return get_type_hints(function, localns=_Known(function), include_extras=True)


class _Known(dict[str, Any]):
    """What the names of types in the module of a function mean."""

    def __init__(self, function: Any) -> None:
        super().__init__({**vars(typing), **vars(collections.abc), **vars(parameters), **function.__globals__})

    def __missing__(self, name: str) -> Any:
        return getattr(builtins, name, Any)
