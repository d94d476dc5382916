"""Commands that list, write and rewrite scene files."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.cli import printing
from rig.cli.options import Force, Json
from rig.cli.outputs import held, named
from rig.errors import SceneError, UsageError
from rig.user_files import write_file

if TYPE_CHECKING:
    pass

Folder = Annotated[
    Path | None, typer.Argument(metavar="FOLDER", help="A folder with scene files. Default: the shipped scenes.")
]


def list_scenes(folder: Folder = None, as_json: Json = False) -> None:
    """List the shipped scenes, or those in a folder; and parts that other packages have installed."""
    from rig.scenes import names
    from rig.scenes.shipped import card

    if folder is None:
        cards = [card(name) for name in names()]
    else:
        from rig.scenes.inherit import cards as cards_of  # slow to import

        cards = cards_of(folder)
    if as_json:
        printing.report(cards)
        return
    rows = [(c["name"], c["plant"] or "", c["pace_limit"] or "", c["title"]) for c in cards]
    printing.table("", ("scene", "plant", "largest pace", "title"), rows)
    _list_installed()
    printing.line("\nlargest pace: largest real-time factor of rig run; blank: not limited")
    printing.line("next: rig explain SCENE | rig run SCENE --view | rig simulate SCENE")


def _list_installed() -> None:
    """List the parts that other packages have installed. None of them is imported.

    A shipped part of the same name comes first, so the installed one is out of reach. A scene that names a part which
    two packages have installed is refused.
    """
    from importlib.metadata import entry_points

    for what in ("plants", "effects", "sensors", "controllers"):
        if not entry_points(group=f"friction_rig.{what}"):
            continue
        from rig.parts import package_of
        from rig.scenes.rooms import ROOMS  # slow to import: only where something is installed

        room = ROOMS[what]
        for name, entries in sorted(room.installed.items()):
            hidden = ", hidden by the shipped part of this name" if name in room.shipped else ""
            packages = [package_of(entry) for entry in entries]
            for package in packages:
                printing.line(f"installed: {name} ({what}) of {package}{hidden}")
            if len(packages) > 1 and not hidden:
                printing.note(f"warning: {name} ({what}) is a part of {' and of '.join(packages)}: a scene that names "
                              "it is refused; uninstall all but one")  # fmt: skip


def new_scene(
    name: Annotated[str, typer.Argument(metavar="NAME", help="File to write, with or without .toml.")],
    based_on: Annotated[
        str, typer.Option(metavar="SCENE", help="Shipped scene, or TOML file, on which the new one is based.")
    ],
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write a new scene file that is based on another scene and contains only what differs.

    The file lists the main values as comments, with unit, range and origin.
    """
    from rig.scenes import load
    from rig.scenes.draft import draft
    from rig.scenes.shipped import names

    named("NAME", Path(name))
    file = Path(name) if name.endswith(".toml") else Path(f"{name}.toml")
    if file.suffix != ".toml":
        raise UsageError(f"{name}: names no file; expected NAME or NAME.toml")
    scene = load(based_on)
    shipped = based_on in names()
    bases = [] if shipped else [Path(based_on), *(Path(based_on).parent / base for base in scene.bases)]
    if file.exists() and any(base.exists() and file.samefile(base) for base in bases):
        raise UsageError(f"{name}: is a scene that the new one would be based on; name another file")
    base = based_on if shipped else os.path.relpath(based_on, file.parent)
    with held("NAME", file, force):
        write_file(file, draft(scene, base, str(file)).encode())
    if as_json:
        printing.report({"file": str(file), "based_on": base})
        return
    typed = shlex.quote(str(file))
    printing.line(f"{file}: based on {base}\nnext: edit it | rig explain {typed} | rig simulate {typed}")


def migrate(
    file: Annotated[str, typer.Argument(metavar="FILE", help="Scene file (TOML) to rewrite.")], as_json: Json = False
) -> None:
    """Rewrite a scene file in the newest format. Comments and layout stay; only renamed keys change.

    An older file can be used as it is too: it is then migrated as it is read, with a note.
    """
    from rig.scenes import migration, shipped, source

    path = shipped.path(file)
    text = source.text(path)
    raw = source.parsed(path, text)
    try:
        since = migration.written(raw)
        if not raw.keys() & {"plant", "based_on"}:
            raise ValueError("is no scene: it has neither plant nor based_on; only scene files state a format")
        made, renamed = migration.rewritten(text)
    except ValueError as fault:
        raise SceneError(file, [str(fault)]) from None
    if made != text:
        write_file(path, made.encode())
    if as_json:
        printing.report({"file": str(path), "from": since, "to": migration.newest(), "renamed": renamed})
        return
    if made == text:
        printing.line(f"{file}: is in format {since}, the newest; nothing to change")
        return
    printing.line(f"{file}: rewritten from format {since} to {migration.newest()}")
    for line in renamed:
        printing.line(f"  {line}")


COMMANDS = {
    "list": (list_scenes, "rig list"),
    "new": (new_scene, "rig new mine --based-on belt"),
    "migrate": (migrate, "rig migrate mine.toml"),
}
