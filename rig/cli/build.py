"""Makes a command: its options, some of them those of a function of `rig`; prints, draws and writes what it returns.

Made      a command in the tables of the modules
Answer    what the function of a command returns, if that is more than a result
Told      a result that only a command has
build     the function that typer calls
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from inspect import Parameter, Signature, signature
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, NamedTuple

import typer

from rig import parameters
from rig.cli import printing
from rig.cli.options import added, linked, named, the_scene
from rig.cli.printing import new, new_folder, new_recording
from rig.cli.stated import Stated, stated
from rig.errors import ExitCode, Faults
from rig.parameters import Option

JSON = Annotated[bool, Option("", "Print the report as JSON.", "--json")]
_FILES = ("figure", "page", "csv")
_WRITERS = (new, new_folder, new_recording)
_LAST = (*_FILES, "trust", "force", "as_json")
"""Options that the help shows last."""
_OF_SCENE = ("overrides", "untold", "redesign")
"""What changes a scene; its command gets the changed scene."""


class Made(NamedTuple):
    """A command: its function, an example, and the function of `rig` whose options it has.

    `files`: which of figure, page and csv it can write of the result that it returns; `more`: further options.
    """

    work: Callable[..., Any]
    example: str
    of: Callable[..., object] | None = None
    files: str = ""
    more: Mapping[str, Stated] = MappingProxyType({})

    @property
    def answers(self) -> bool:
        """Whether it returns a result, which is printed."""
        return self.work.__annotations__.get("return") not in (None, "None")


@dataclass(frozen=True)
class Answer:
    """What a command has found.

    `result` has `to_json`, and `text` or `show`; `more`: what its JSON has beside that. `draw` writes the figure, if
    `result.plot` is not it; `title`: of the page. `then` is called when the result is printed and drawn: it writes
    further files, and what it yields is printed below the text. `notes`: for standard error. `code`: the exit code;
    that of a failed check, if the result is not `good`.
    """

    result: Any
    good: bool = True
    more: Mapping[str, object] = field(default_factory=dict)
    draw: Callable[[Path], object] | None = None
    title: str = ""
    then: Callable[[], Iterable[str]] = tuple
    notes: Sequence[str] = ()
    code: int = ExitCode.DONE


class Told:
    """A result that only a command has: `values` as JSON, and lines, or a function that prints them, for a reader."""

    def __init__(self, values: Any, *lines: str, show: Callable[[], object] | None = None) -> None:
        self._values = values
        self.show = show or (lambda: printing.line("\n".join(lines)))

    def to_json(self) -> Any:
        """Return the values; a function that computes them is called."""
        return self._values() if callable(self._values) else self._values


def build(made: Made) -> Callable[..., None]:
    """Return the function that typer calls for a command, with all its options."""
    own = signature(made.work).parameters
    options = _options(made, own)
    read = {name: option.parameter(name) for name, option in options.items()}
    if "context" in own:
        read["context"] = own["context"].replace(annotation=typer.Context, kind=Parameter.KEYWORD_ONLY)

    def command(**typed: Any) -> None:
        faults = Faults()
        for name, option in options.items():
            typed[name] = faults(partial(option.read, typed[name]), option.default)
        if "faults" in own:
            typed["faults"] = faults
        else:
            faults.raise_found()
        if _loads(own):
            _load(typed)
        unasked = {*_FILES, "as_json", "force", "scene_name", *_OF_SCENE} - own.keys()
        answer = made.work(**{name: value for name, value in typed.items() if name not in unasked})
        if made.answers:
            written = {name: typed[name] for name in made.files.split()}
            deliver(answer if isinstance(answer, Answer) else Answer(answer), typed["as_json"], written)

    command.__doc__ = made.work.__doc__
    command.__annotations__ = {name: parameter.annotation for name, parameter in read.items()}
    command.__signature__ = Signature(sorted(read.values(), key=_place))  # type: ignore[attr-defined]
    return command


def _options(made: Made, own: Mapping[str, Parameter]) -> dict[str, Stated]:
    """The options that a command states, those of a function of `rig`, and those that several commands have.

    The command may have a default of its own.
    """
    shared = stated(parameters.common) | stated(_of_results)
    asked = {*own, *made.files.split()}
    asked |= {name for name, yes in (("overrides", _loads(own)), ("as_json", made.answers)) if yes}
    options = {name: option for name, option in shared.items() if name in asked}
    options |= {**(stated(made.of) if made.of else {}), **made.more, **stated(made.work)}
    if any(option.check in _WRITERS for option in options.values()):
        options["force"] = shared["force"]
    for name in options.keys() & own.keys():
        if own[name].default is not Parameter.empty:
            options[name] = options[name]._replace(default=own[name].default)
    return options


def _of_results(
    figure: Annotated[Path | None, Option("FILE", "Draw the result (PNG, SVG, PDF).", check=new)] = None,
    page: Annotated[
        Path | None, Option("FILE", "Write the report with its figure as a page (HTML).", check=new)
    ] = None,
    csv: Annotated[Path | None, Option("FILE", "Write all numbers as CSV.", check=new)] = None,
    force: Annotated[bool, Option("", "Overwrite existing files.")] = False,
    as_json: JSON = False,
) -> None:
    """Options of commands that print a result or write files."""


def _loads(own: Mapping[str, Parameter]) -> bool:
    """Whether the function of a command gets a scene, not its name."""
    return "scene" in own and own["scene"].annotation == "Scene"


def _load(typed: dict[str, Any]) -> None:
    """Replace the name of the scene by the scene, with the changes that the options make."""
    given, untold, redesign = (typed.get(name) or {} for name in _OF_SCENE)
    loop = typed.get("controller")
    by_option: dict[str, Mapping[str, object]] = {
        "--controller": added([loop] if loop else typed.get("controllers")),
        "--net": linked(typed.pop("net", None), given),
    }
    typed["scene_name"] = typed["scene"]
    typed["scene"] = the_scene(typed["scene_name"], given, by_option, untold, bool(redesign))
    if loop:
        [typed["controller"]] = named([loop])


def deliver(answer: Answer, as_json: bool, files: Mapping[str, Path | None]) -> None:
    """Print what a command has found, write its files, and leave with its exit code."""
    result = answer.result
    more = {**answer.more, **files}

    def values() -> Any:
        return result.to_json() | more if more else result.to_json()

    printing.reported(as_json, values, getattr(result, "show", lambda: printing.line(result.text())))
    for text in answer.notes:
        printing.note(text)
    for name, path in files.items():
        if path is not None:
            _write(answer, name, path)
    for text in answer.then():
        if not as_json:
            printing.line(text)
    code = answer.code if answer.good else ExitCode.FAILED
    if code:
        raise typer.Exit(code)


def _write(answer: Answer, name: str, path: Path) -> None:
    """Write a file of a result."""
    from rig.machine.files import write_file

    if name == "csv":
        write_file(path, answer.result.csv().encode())
    elif name == "page":
        from rig.analysis.report.page import result_page

        write_file(path, result_page(answer.result, answer.title).encode())
    elif answer.draw is not None:
        answer.draw(path)
    else:
        from rig.view.palette import put

        put(answer.result.plot(), path)


def _place(parameter: Parameter) -> int:
    """Where an option stands in the help."""
    name = parameter.name
    return _LAST.index(name) if name in _LAST else -1 - (name == "overrides")
