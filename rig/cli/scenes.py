"""Commands that look at scenes without running them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.cli import printing
from rig.cli.options import Changes, Force, Json, SceneName, changes, the_scene
from rig.cli.outputs import held, named, new
from rig.errors import SceneError, UsageError

if TYPE_CHECKING:
    from rig.qualify.effects_measured import Part, Told
    from rig.scenes.explain import Value
    from rig.scenes.scene import Scene

Figure = Annotated[
    Path | None, typer.Option(metavar="FILE", callback=new, help="Draw the result of --measure (PNG, SVG, PDF).")
]


Folder = Annotated[
    Path | None, typer.Argument(metavar="[FOLDER]", help="A folder with scene files of yours; else the shipped ones.")
]


def list_scenes(folder: Folder = None, as_json: Json = False) -> None:
    """List the shipped scenes, or those in a folder; and parts that other packages have installed."""
    from rig.scenes import names
    from rig.scenes.shipped import card
    from rig.scenes.shipped import cards as cards_of

    cards = [card(name) for name in names()] if folder is None else cards_of(folder)
    if as_json:
        printing.report(cards)
        return
    rows = [(c["name"], c["plant"], c["pace_limit"] or "", c["title"]) for c in cards]
    printing.table("", ("scene", "plant", "largest pace", "title"), rows)
    for what, name, package in _installed():
        printing.line(f"installed: {name} ({what}) of {package}")
    printing.line("\nnext: rig explain SCENE | rig run SCENE --view | rig simulate SCENE")


def _installed() -> Iterator[tuple[str, str, str]]:
    """Kind, name and package of each part that another package has installed. None of them is imported."""
    from importlib.metadata import entry_points

    for what in ("plants", "effects", "sensors", "controllers"):
        for one in sorted(entry_points(group=f"friction_rig.{what}"), key=lambda one: one.name):
            yield what, one.name, f"{one.dist.name} {one.dist.version}" if one.dist else "an unknown package"


def explain(
    scene: SceneName,
    p: Changes = None,
    everything: Annotated[bool, typer.Option("--all", help="Show default values too.")] = False,
    measure: Annotated[
        bool,
        typer.Option("--measure", help="Measure each effect: compute time per step in ns, and change of the motion."),
    ] = False,
    figure: Figure = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Show the contents of a scene: effects, state variables, origin of every value.

    For a recording (FILE.mcap): show which effects had no influence in the
    run, and which were missing.
    """
    from rig.scenes.explain import explain as take_apart

    if figure is not None and not measure:
        raise UsageError("--figure: draws the result of --measure; add --measure")
    if scene.endswith(".mcap"):
        _audited(scene, as_json)
        return
    told = take_apart(the_scene(scene, changes(p)))
    if measure:
        _measured(told.scene, figure, as_json)
        return
    values = [v for v in told.values if everything or as_json or v.place or v.key in told.scene.origins]
    if as_json:
        printing.report(
            {
                "scene": told.scene.name,
                "title": told.scene.title,
                "about": told.scene.about,
                "based_on": told.scene.bases,
                "notes": told.scene.notes,
                "plant": told.scene.plant,
                "states": told.states,
                "frame_s": told.scene.frame_ns / 1e9,
                "step_s": told.scene.step_ns / 1e9,
                "slow": told.scene.slow,
                "duration_s": None if told.scene.duration_ns is None else told.scene.duration_ns / 1e9,
                "effects": [vars(effect) for effect in told.effects],
                "actuators": [vars(actuator) for actuator in told.actuators],
                "values": [_value(v) for v in values],
            }
        )
        return
    printing.line(f"{told.scene.title} ({told.scene.name})\n")
    if told.scene.about:
        printing.line(f"{told.scene.about}\n")
    if told.scene.bases:
        printing.line(f"Based on {', which is based on '.join(told.scene.bases)}\n")
    if told.scene.slow:
        printing.line(f"Paced, {told.scene.slow}\n")
    if told.scene.assemble().film is not None:
        printing.line("After the first opening of a contact point the motion is chaotic: only statistics count. "
                  f"Their spread: rig simulate {scene} --repeat 8 -p noise.force=1e-6\n")  # fmt: skip
    rows = [(e.name, "on" if e.on else "absent", len(e.states), e.told, e.about) for e in told.effects]
    printing.table(
        f"effects: {told.states} state{'s' * (told.states != 1)}", ("effect", "", "states", "", "about"), rows
    )
    printing.line()
    actuators = [
        (a.name, f"{a.low:g} .. {a.high:g}", a.unit if a.unit != "1" else "", f"{a.start:g}", f"{a.safe:g}")
        for a in told.actuators
    ]
    printing.table("actuators", ("actuator", "range", "unit", "at the start", "safe value"), actuators)
    printing.line()
    shown = [
        (v.key, _text(v.value), v.unit if v.unit != "1" else "", v.origin.origin, v.origin.note, str(v.place or ""))
        for v in values
    ]
    printing.table("values", ("key", "value", "unit", "origin", "note", "file"), shown)
    left = len(told.values) - len(values)
    printing.line(f"\n{left} more values have defaults; to list them: rig explain {scene} --all" if left else "")


def _value(value: Value) -> dict[str, Any]:
    """A value for JSON; `file` and `line` that give it: null for a default, "-p" for a change."""
    place = value.place
    where = {"file": place and (place.file or "-p"), "line": place and (place.line or None)}
    plain = {"key": value.key, "value": value.value, "unit": value.unit}
    return {**plain, "origin": value.origin.origin, "note": value.origin.note, **where}


def _audited(log: str, as_json: bool) -> None:
    from rig.cli.logs import opened

    judged = opened(Path(log)).summary.get("audit", [])
    if as_json:
        printing.report({"log": log, "effects": judged})
        return
    state = ["on" if e["on"] else f"absent, as in {e['like']}" if e["like"] else "absent" for e in judged]
    rows = [(e["effect"], now, f"{e['share']:.2g}", e["text"] if e["noted"] else "") for e, now in zip(judged, state)]
    printing.table(
        f"{log}: influence of each effect in this run", ("effect", "", "share of the forces", "remark"), rows
    )
    if not judged:
        printing.line(
            "no result: the run was too short, or no shipped scene of its plant has values for the absent effects"
        )
        printing.line("(rig explain SCENE --measure uses values of other plants too)")


def _measured(scene: Scene, figure: Path | None, as_json: bool) -> None:
    from rig.qualify import effects_measured

    with printing.bar("effects") as progress:
        parts = effects_measured.parts(scene, report=progress)
    methods, signals, topics = (
        effects_measured.methods(scene),
        [*effects_measured.signals(scene)],
        [*effects_measured.topics(scene)],
    )
    if as_json:
        told = {"signals": [vars(one) for one in signals], "topics": [vars(one) for one in topics]}
        effects = [one.to_json() for one in parts]
        printing.report({"scene": scene.name, "states": scene.assemble().system().n - 1, "effects": effects,
                     "methods": methods, **told})  # fmt: skip
    else:
        _tell(scene, parts, methods, signals, topics)
    if figure is not None:
        from rig.qualify.effects_figure import draw

        draw(parts, scene, figure)


def _tell(
    scene: Scene, parts: Sequence[Part], methods: Mapping[str, str], signals: Sequence[Told], topics: Sequence[Told]
) -> None:
    """What was measured, for a reader."""
    rows = []
    for one in parts:
        cost = "" if one.paired.fault else one.paired.cost()
        rows.append((one.name, "on" if one.on else "absent", one.paired.states, cost, one.paired.change(), one.why))
    columns = ("effect", "", "states", "cost per sample step", "largest change without it", "remark")
    printing.table(f"{scene.name}: effects, measured with and without each in turns", columns, rows)
    if any(one.paired.measurable and one.paired.tick.value < -one.paired.noise for one in parts):
        printing.line(
            "negative cost: without the effect the motion has more events, and these cost more than the effect"
        )
    printing.line(
        "change: difference of the two values over the larger one; < x ns: below the noise floor of this machine"
    )
    from rig.analysis.text_table import columns as columns_of

    printing.line("\nmethods")
    for line in columns_of(methods.items(), "<<"):
        printing.line(line)
    for title, computed in (("outputs", signals), ("topics of rig run", topics)):
        printing.line()
        rates = [(one.name, f"{one.rate:g}" if one.rate else "", one.asked) for one in computed]
        printing.table(title, ("", "per s", "used by"), rates)


def _text(value: Any) -> str:
    return ", ".join(map(printing.number, value)) if isinstance(value, list) else printing.number(value)


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
    scene = load(based_on)
    shipped = based_on in names()
    if not shipped and file.exists() and file.samefile(based_on):
        raise UsageError(f"{name}: is the scene to start from; name another file")
    base = based_on if shipped else os.path.relpath(based_on, file.parent)
    with held("NAME", file, force):
        file.write_text(draft(scene, base, str(file)), encoding="utf-8")
    if as_json:
        printing.report({"file": str(file), "based_on": base})
        return
    printing.line(f"{file}: based on {base}\nnext: edit it | rig explain {file} | rig simulate {file}")


def migrate(
    file: Annotated[str, typer.Argument(metavar="FILE", help="Scene file (TOML) to rewrite.")], as_json: Json = False
) -> None:
    """Rewrite a scene file in the newest format. Comments and layout stay; only renamed keys change.

    An older file can be used as it is too: it is then migrated as it is read, with a note.
    """
    from rig.scenes import migration, source
    from rig.scenes import shipped as shelf

    path = shelf.path(file)
    text = source.text(path)
    try:
        since = migration.written(source.parsed(path, text))
    except ValueError as fault:
        raise SceneError(file, [str(fault)]) from None
    made, renamed = migration.rewritten(text)
    if made != text:
        path.write_bytes(made.encode())
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
    "explain": (explain, 'rig explain pendulum -p drive.speed="2 rpm"'),
}
