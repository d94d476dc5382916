"""Options that functions of `rig` state with their parameters: what typer reads of them, and what it becomes."""

from __future__ import annotations

import builtins
import collections.abc
import math
import typing
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from inspect import Parameter, signature
from pathlib import Path
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints

import typer

from rig import parameters
from rig.cli.options import SHORTEST, assigned, changes, paired, recording, scene_file, seconds, separated
from rig.cli.printing import new_folder
from rig.parameters import Argument, Option

TEXTS: Mapping[str, Callable[[str, str, float], object]] = {
    "TIME": seconds,
    "TIMES": lambda given, flag, low: [seconds(text, flag, low) for text in separated(given)],
    "LIST": lambda given, flag, low: tuple(separated(given)),
    "NAMES": lambda given, flag, low: separated(given),
    "RATE": lambda given, flag, low: given,
    "KEY=VALUES, ...": lambda given, flag, low: given,
}
"""What is typed -> how its text becomes the value of the parameter; others stay what they are."""
SEVERAL: Mapping[str, Callable[[list[str] | None, str], object]] = {
    "KEY=VALUE": changes,
    "KEY=VALUES": assigned,
    "KEY=FROM:TO": assigned,
    "KEY=RANGE": assigned,
    '"ACTUATOR = CHANNEL"': assigned,
    '"CHANNEL = SIMULATED, FACTOR"': assigned,
}
"""The same for options that may be repeated."""
_NAMES = {**vars(typing), **vars(collections.abc), **vars(parameters)}
_CHECKS: Mapping[type[Option], Mapping[str, Callable[..., Any]]] = {
    Argument: {"SCENE": scene_file, "LOG": recording},
    Option: {"KEY=VALUE": paired, "FOLDER": new_folder},
}
"""What is typed -> its check."""


class Stated(NamedTuple):
    """An option of a command: its flag, its description, its default, and the types that its parameter may have."""

    flag: str
    option: Option
    default: Any = None
    types: frozenset[Any] = frozenset({str})

    @property
    def _several(self) -> bool:
        """Whether it may be repeated."""
        many = list in self.types or (Path not in self.types and not self.types.isdisjoint((Mapping, Iterable)))
        return many and self.option.value not in TEXTS

    @property
    def _is_text(self) -> bool:
        return self.option.value in TEXTS and not self._several

    @property
    def check(self) -> Callable[..., Any] | None:
        """What typer calls when it has read it."""
        return self.option.check or _CHECKS[type(self.option)].get(self.option.value)

    def read(self, given: Any) -> Any:
        """Return the value for what was typed. Raises UsageError."""
        value = self.option.value
        if self._several:
            return SEVERAL[value](given, self.flag) if value in SEVERAL else given or []
        if given is None or not self._is_text:
            return self.default if given is None else given
        return TEXTS[value](given, self.flag, SHORTEST if self.option.low is None else self.option.low)

    def parameter(self, name: str) -> Parameter:
        """Return the parameter of the function that typer calls."""
        value, about, _, low, high, _ = self.option
        default = self.default
        kind: Any = str
        if self._several:
            kind = list[Path] if Path in self.types else list[str]
            default = default if list in self.types else None
        elif self._is_text:
            default = _text(default)
        elif value != "SCENE":
            kind = next((kind for kind in (bool, int, Path, float) if kind in self.types), str)
        how: dict[str, Any] = {"metavar": value or None, "help": about, "callback": self.check}
        if isinstance(self.option, Argument):
            info = typer.Argument(**how)
        else:
            if kind is int:
                how |= {"min": low, "max": high}
            info = typer.Option(self.flag, show_default=default != "", is_eager=name == "force", **how)
        kind = kind | None if default is None else kind
        return Parameter(name, Parameter.KEYWORD_ONLY, annotation=Annotated[kind, info], default=default)


def _text(default: Any) -> str | None:
    """A default as it is typed; None for one that the help does not show."""
    if isinstance(default, float):
        return f"{default:g}" if 0.0 < default < math.inf else None
    return ",".join(default) if isinstance(default, tuple) else None


@cache
def stated(function: Callable[..., object]) -> dict[str, Stated]:
    """Return the parameters of a function that are options."""
    options: dict[str, Stated] = {}
    given = signature(function).parameters
    for name, hint in hints(function).items():
        if get_origin(hint) is Annotated:
            kind, option = get_args(hint)
            types = {kind, get_origin(kind), *get_args(kind)}
            types |= {get_origin(inner) for inner in types}
            flag = option.flag or f"--{name.replace('_', '-')}"
            options[name] = Stated(flag, option, given[name].default, frozenset(types))
    return options


def hints(function: Callable[..., object]) -> dict[str, Any]:
    """Return the types of the parameters of a function; those that only type checkers import are Any."""
    return get_type_hints(function, localns=_Known(function), include_extras=True)


class _Known(dict[str, Any]):
    """What the names of types in the module of a function mean."""

    def __init__(self, function: Any) -> None:
        super().__init__(_NAMES | function.__globals__)

    def __missing__(self, name: str) -> Any:
        return getattr(builtins, name, Any)
