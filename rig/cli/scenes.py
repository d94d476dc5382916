"""Commands that list, write and rewrite scene files.

The command that shows what a scene contains, or what its effects did in a recording.

The command that writes a scene as an FMU.
"""

from __future__ import annotations

import os
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.cli import printing
from rig.cli.options import Changes, Force, Json, SceneName, changes, the_scene
from rig.cli.printing import held, named, new
from rig.errors import SceneError, UsageError
from rig.machine.files import write_file

if TYPE_CHECKING:
    pass
    from rig.qualify.effects_measured import Part, Rate
    from rig.scenes.explain import Value
    from rig.scenes.scene import Scene


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


Figure = Annotated[
    Path | None, typer.Option(metavar="FILE", callback=new, help="Draw the result of --measure (PNG, SVG, PDF).")
]


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
    from rig.scenes.sections import dump

    if figure is not None and not measure:
        raise UsageError("--figure: draws the result of --measure; add --measure")
    if scene.endswith(".mcap"):
        _audited(scene, as_json)
        return
    explanation = take_apart(the_scene(scene, changes(p)))
    if measure:
        _measured(explanation.scene, figure, as_json)
        return
    values = [v for v in explanation.values if everything or as_json or v.place or v.key in explanation.scene.origins]
    if as_json:
        printing.report(
            {
                "scene": explanation.scene.name,
                "title": explanation.scene.title,
                "about": explanation.scene.about,
                "based_on": explanation.scene.bases,
                "notes": explanation.scene.notes,
                "plant": explanation.scene.plant,
                "states": explanation.states,
                "frame_s": explanation.scene.frame_ns / 1e9,
                "step_s": explanation.scene.step_ns / 1e9,
                "slow": explanation.scene.slow,
                "duration_s": None if explanation.scene.duration_ns is None else explanation.scene.duration_ns / 1e9,
                "effects": [vars(effect) for effect in explanation.effects],
                "actuators": [vars(actuator) for actuator in explanation.actuators],
                "faults": {name: dump(fault) for name, fault in explanation.scene.faults.items()},
                "network": {topic: dump(link) for topic, link in explanation.scene.network.links.items()},
                "values": [_value(v) for v in values],
            }
        )
        return
    printing.line(f"{explanation.scene.title} ({explanation.scene.name})\n")
    if explanation.scene.about:
        printing.line(f"{explanation.scene.about}\n")
    if explanation.scene.bases:
        printing.line(f"Based on {', which is based on '.join(explanation.scene.bases)}\n")
    if explanation.scene.slow:
        printing.line(f"Paced, {explanation.scene.slow}\n")
    if explanation.scene.assemble().film is not None:
        printing.line("After the first opening of a contact point the motion is chaotic: only statistics count. "
                  f"Their spread: rig simulate {shlex.quote(scene)} --repeat 8 -p noise.force=1e-6\n")  # fmt: skip
    rows = [(e.name, "on" if e.on else "absent", len(e.states), e.states_text, e.about) for e in explanation.effects]
    printing.table(
        f"effects: {explanation.states} state{'s' * (explanation.states != 1)}",
        ("effect", "", "states", "", "about"),
        rows,
    )
    printing.line()
    actuators = [
        (a.name, f"{a.low:g} .. {a.high:g}", a.unit if a.unit != "1" else "", f"{a.start:g}", f"{a.safe:g}")
        for a in explanation.actuators
    ]
    printing.table("actuators", ("actuator", "range", "unit", "at the start", "safe value"), actuators)
    printing.line()
    if explanation.scene.network:
        _print_network(explanation.scene)
    if explanation.scene.faults:
        _print_faults(explanation.scene)
    shown = [
        (v.key, _text(v.value), v.unit if v.unit != "1" else "", v.origin.origin, v.origin.note, str(v.place or ""))
        for v in values
    ]
    printing.table("values", ("key", "value", "unit", "origin", "note", "file"), shown)
    left = len(explanation.values) - len(values)
    printing.line(
        f"\n{left} more values have defaults; to list them: rig explain {shlex.quote(scene)} --all" if left else ""
    )


def _print_network(scene: Scene) -> None:
    """The impaired links of a scene, with the time under way as the frames of the scene round it."""
    from rig.scenes.network import described
    from rig.scenes.sections import dump

    rows = []
    for topic, link in scene.network.links.items():
        least, most = link.ticks(scene.frame_ns)
        frames = f"{least} .. {most}" if most > least else f"{most}"
        rows.append((topic, described(dump(link)), f"{frames} frame{'s' * (most != 1)}"))
    seed = scene.seed if scene.network.seed is None else scene.network.seed
    printing.table(f"impaired links, seed {seed}", ("link", "", "time under way"), rows)
    printing.line("a message arrives at a frame: its transmission time is rounded up to whole frames\n")


def _print_faults(scene: Scene) -> None:
    """The faults of sensors and actuators of a scene, in order of time."""
    from rig.scenes.part_faults import described

    units = {name: one.unit for name, one in scene.assemble().inputs.items()}
    units |= {name: sensor.unit for name, sensor in scene.sensors.items()}
    rows = [
        (f"{fault.at / 1e9:g} s", "the end" if fault.end is None else f"{fault.end / 1e9:g} s", name,
         described(fault, units[fault.part]))
        for name, fault in sorted(scene.faults.items(), key=lambda one: one[1].at)
    ]  # fmt: skip
    printing.table("faults of sensors and actuators", ("from", "to", "fault", ""), rows)
    printing.line()


def _value(value: Value) -> dict[str, Any]:
    """A value for JSON; `file` and `line` that give it: null for a default, "-p" for a change."""
    place = value.place
    where = {"file": place and (place.file if place.line else "-p"), "line": place and (place.line or None)}
    plain = {"key": value.key, "value": value.value, "unit": value.unit}
    return {**plain, "origin": value.origin.origin, "note": value.origin.note, **where}


def _audited(log: str, as_json: bool) -> None:
    from rig.cli.recordings import opened

    run = opened(Path(log))
    judged, network = run.summary.get("audit", []), run.summary.get("network", {})
    faults = [(event["t_ns"] / 1e9, event["text"]) for event in run.plant_events if event["kind"] == "fault"]
    if as_json:
        happened = [{"t": t, "text": text} for t, text in faults]
        printing.report({"log": log, "effects": judged, "network": network, "faults": happened})
        return
    state = ["on" if e["on"] else f"absent, as in {e['like']}" if e["like"] else "absent" for e in judged]
    rows = [(e["effect"], now, f"{e['share']:.2g}", e["text"] if e["noted"] else "") for e, now in zip(judged, state)]
    printing.table(
        f"{log}: influence of each effect in this run",
        ("effect", "", "share of the forces (limits: of the time)", "remark"),
        rows,
    )
    if network:
        printing.line()
        counted = [(topic, *counts.values()) for topic, counts in network.items()]
        printing.table("impaired links, number of messages", ("link", *next(iter(network.values()))), counted)
    if faults:
        printing.line()
        printing.table("faults of sensors and actuators", ("t", ""), [(f"{t:g} s", text) for t, text in faults])
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
        measured = {"signals": [vars(one) for one in signals], "topics": [vars(one) for one in topics]}
        effects = [one.to_json() for one in parts]
        printing.report({"scene": scene.name, "states": scene.assemble().system().n - 1, "effects": effects,
                     "methods": methods, **measured})  # fmt: skip
    else:
        _print_measured(scene, parts, methods, signals, topics)
    if figure is not None:
        from rig.qualify.effects_measured import draw

        draw(parts, scene, figure)


def _print_measured(
    scene: Scene, parts: Sequence[Part], methods: Mapping[str, str], signals: Sequence[Rate], topics: Sequence[Rate]
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
    from rig.printable import columns as columns_of

    printing.line("\nmethods")
    for line in columns_of(methods.items(), "<<"):
        printing.line(line)
    for title, computed in (("outputs", signals), ("topics of rig run", topics)):
        printing.line()
        rates = [(one.name, f"{one.rate:g}" if one.rate else "", one.asked) for one in computed]
        printing.table(title, ("", "per s", "used by"), rates)


def _text(value: Any) -> str:
    return ", ".join(map(printing.number, value)) if isinstance(value, list) else printing.number(value)


def fmu(
    scene: SceneName,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", callback=new, help="FMU to write.")],
    p: Changes = None,
    inputs: Annotated[
        list[str] | None,
        typer.Option(
            "--input",
            metavar="ACTUATOR",
            help="Actuator that is an input; may be repeated. Default: all that can be commanded.",
        ),
    ] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write a scene as an FMU for co-simulation (FMI 2.0), for controllers in other tools.

    Inputs are actuators; outputs are the sensors and the plant's own outputs,
    with units. The rig runs in a child process of the program that imports the
    FMU: it needs this Python, or another one with friction-rig (parameter
    python). Controllers of the scene that drive an input are left out.
    """
    overrides = changes(p)
    from rig.plant_fmu.export import export

    loaded = the_scene(scene, overrides)
    found = export(loaded, out, inputs or ())
    if as_json:
        printing.report({"path": out, "inputs": found.inputs, "outputs": found.results})
        return
    for label, names in (("inputs", found.inputs), ("outputs", found.results)):
        printing.line(f"{label:9}{', '.join(f'{name} [{unit}]' for name, unit in names.items())}")
    printing.line(f"step     {loaded.frame_ns * 1e-9:g} s, or a whole number of these")
    printing.line(f"fmu      {out}")


COMMANDS = {
    "list": (list_scenes, "rig list"),
    "new": (new_scene, "rig new mine --based-on belt"),
    "migrate": (migrate, "rig migrate mine.toml"),
    "explain": (explain, 'rig explain pendulum -p drive.speed="2 rpm"'),
    "fmu": (fmu, "rig fmu belt --out plant.fmu"),
}
