"""Reference of all commands, generated from the program itself."""

from collections.abc import Iterable, Iterator
from typing import Any

from generated import code, directive, plain, table
from sphinx.application import Sphinx

from rig.cli.app import GROUPS, PANELS, every, program


def _default(one: Any) -> str:
    if one.is_flag or one.default in (None, "", ()) or callable(one.default):
        return ""
    return code(str(getattr(one.default, "value", one.default)))


def _option(one: Any) -> str:
    names = ", ".join((*one.opts, *one.secondary_opts))
    return code(names if one.is_flag else f"{names} {one.metavar or one.name.upper()}")


def _command(name: str, command: Any, level: str) -> Iterator[str]:
    given = [one for one in command.params if one.name != "help" and not getattr(one, "hidden", False)]
    arguments = [one for one in given if one.param_type_name == "argument"]
    options = [one for one in given if one.param_type_name == "option"]
    usage = [f"{one.metavar}" if one.required else f"[{one.metavar}]" for one in arguments]
    yield from (f"{level} rig {name}", "")
    yield from ("```", " ".join([f"rig {name}", *(["[OPTIONS]"] if options else []), *usage]), "```", "")
    for paragraph in (command.help or "").split("\n\n"):
        yield from (plain(paragraph), "")
    yield from table(("argument", "meaning"), [(code(one.metavar), plain(one.help or "")) for one in arguments])
    rows = [(_option(one), plain(one.help or ""), _default(one)) for one in options]
    yield from table(("option", "meaning", "default"), rows)
    if command.epilog:
        example = command.epilog.removeprefix("Example:").strip()
        yield from ("Example:", "", "```", example, "```", "")


def commands() -> Iterable[str]:
    """The lines of the reference: a section for each panel of the help and each group, in it one for each command."""
    all_of_them = every()
    sections = {panel: [name for name in names if name not in GROUPS] for panel, names in PANELS.items()}
    for group, (about, _) in GROUPS.items():
        if group in program.commands:
            sections[f"rig {group}: {about}"] = [name for name in all_of_them if name.startswith(f"{group} ")]
    for section, names in sections.items():
        yield from (f"## {section}", "")
        for name in sorted(names):
            yield from _command(name, all_of_them[name], "###")


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive `commands`."""
    directive(app, "commands", commands)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
