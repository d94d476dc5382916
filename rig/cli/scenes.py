"""Commands for scenes: list, write and rewrite files, explain what a scene contains, write it as an FMU."""

from __future__ import annotations

import os
import shlex
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.cli import printing
from rig.cli.build import Answer, Made, Told
from rig.cli.options import SceneName, the_scene
from rig.cli.printing import new, writable
from rig.errors import LogError, RigError, UsageError
from rig.machine.files import write_file
from rig.parameters import Argument, Option
from rig.printable import counted

if TYPE_CHECKING:
    from rig.qualify.cost.effects import Paired
    from rig.qualify.effects_measured import Rate
    from rig.scenes.explain import Effect, Explanation, Value
    from rig.scenes.scene import Scene

_CONTACT = "friction at "
_SOURCED = ("paper", "public", "derived", "measured")
"""Origins that another person can check."""
_MANY = 4  # numbers of a list that are shown one by one


def list_scenes(
    folder: Annotated[
        Path | None, Argument("FOLDER", "A folder with scene files. Default: the shipped scenes.")
    ] = None,
) -> Told:
    """List the shipped scenes, or those in a folder; and parts that other packages have installed."""
    from rig.scenes import names
    from rig.scenes.shipped import FIRST, card, groups

    if folder is None:
        by_name = {name: {**card(name), "group": groups()[name]} for name in names()}
        cards = [*by_name.values()]
        shown = [by_name[name] for name in groups()]
    else:
        from rig.scenes.inherit import cards as cards_of  # slow to import

        cards = shown = cards_of(folder)

    def show() -> None:
        if folder is None:
            printing.line(f"start with {FIRST}: rig run {FIRST} --view")
        _print_cards(shown)
        _list_installed()
        printing.line("\nnext: rig explain SCENE | rig simulate SCENE | rig run SCENE --view")

    return Told(cards, show=show)


def _print_cards(cards: Sequence[Mapping[str, Any]]) -> None:
    """Names and titles in groups by what happens; all names have one width."""
    width = max((len(card["name"]) for card in cards), default=0)
    for group, listed in groupby(cards, key=lambda card: card.get("group", "")):
        printing.line()
        printing.described(group, [(f"{card['name']:<{width}}", _title(card)) for card in listed])


def _title(card: Mapping[str, Any]) -> str:
    title = card["title"] or f"based on {card['based_on']}"
    if "group" not in card:
        title += f", plant {card['plant']}"
    limit = card["pace_limit"]
    return f"{title} (real-time factor up to {limit:g})" if limit else title


def _list_installed() -> None:
    """List the parts that other packages have installed. None of them is imported.

    A shipped part of the same name comes first, so the installed one is out of reach. A scene that names a part which
    two packages have installed is refused.
    """
    from importlib.metadata import entry_points

    installed = entry_points()
    for what in ("plants", "effects", "laws", "sensors", "controllers"):
        if not installed.select(group=f"friction_rig.{what}"):
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
                printing.note(
                    f"warning: {name} ({what}) is a part of {' and of '.join(packages)}: a scene that names "
                    "it is refused; uninstall all but one"
                )


def new_scene(
    context: typer.Context,
    name: Annotated[str, Argument("NAME", "File to write, with or without .toml.")],
    based_on: Annotated[str, Option("SCENE", "Shipped scene, or TOML file, on which the new one is based.")],
    force: bool,
) -> Told:
    """Write a new scene file that is based on another scene and contains only what differs.

    The file lists the main values as comments, with unit, range and origin.
    """
    from rig.scenes import load
    from rig.scenes.draft import draft
    from rig.scenes.shipped import names

    file = Path(name) if name.endswith(".toml") else Path(f"{name}.toml")
    if file.suffix != ".toml":
        raise UsageError(f"{name}: names no file; expected NAME or NAME.toml")
    scene = load(based_on)
    shipped = based_on in names()
    bases = [] if shipped else [Path(based_on), *(Path(based_on).parent / base for base in scene.bases)]
    if file.exists() and any(base.exists() and file.samefile(base) for base in bases):
        raise UsageError(f"{name}: is a scene that the new one would be based on; name another file")
    base = based_on if shipped else os.path.relpath(based_on, file.parent)
    writable(context, "NAME", file)
    write_file(file, draft(scene, base, str(file)).encode())
    typed = shlex.quote(str(file))
    next_steps = f"next: edit it | rig explain {typed} | rig simulate {typed}"
    return Told({"file": str(file), "based_on": base}, f"{file}: based on {base}", next_steps)


def explain(
    scene: SceneName,
    overrides: Mapping[str, object],
    untold: Mapping[str, object],
    everything: Annotated[bool, Option("", "Show default values too.", "--all")] = False,
    measure: Annotated[
        bool, Option("", "Measure each effect: compute time per step in ns, and change of the motion.")
    ] = False,
    *,
    figure: Path | None,
) -> Answer:
    """Show the contents of a scene: effects, state variables, origin of every value.

    For a recording (FILE.mcap): show which effects had no influence in the
    run, and which were missing.
    """
    from rig.scenes.belief import lines
    from rig.scenes.explain import explain as take_apart
    from rig.scenes.sections import dump

    if figure is not None and not measure:
        raise UsageError("--figure: draws the result of --measure; add --measure")
    if scene.endswith(".mcap"):
        return Answer(_audited(scene))
    explanation = take_apart(the_scene(scene, overrides, untold=untold))
    loaded = explanation.scene
    if measure:
        return _measured(loaded)

    def values() -> dict[str, Any]:
        return {
            "scene": loaded.name,
            "title": loaded.title,
            "about": loaded.about,
            "based_on": loaded.bases,
            "notes": loaded.notes,
            "plant": loaded.plant,
            "states": explanation.states,
            "frame_s": loaded.frame_ns / 1e9,
            "step_s": loaded.step_ns / 1e9,
            "slow": loaded.slow,
            "duration_s": None if loaded.duration_ns is None else loaded.duration_ns / 1e9,
            "effects": [vars(effect) for effect in explanation.effects],
            "actuators": [vars(actuator) for actuator in explanation.actuators],
            "faults": {name: dump(fault) for name, fault in loaded.faults.items()},
            "network": {topic: dump(link) for topic, link in loaded.network.links.items()},
            "controllers": _believed(loaded)[0],
            "belief": lines(loaded),
            **({"structure": explanation.stated.to_json()} if explanation.stated else {}),
            "values": [_value(v) for v in explanation.values],
        }

    return Answer(Told(values, show=lambda: _print(explanation, scene, everything)))


def _print(explanation: Explanation, scene: str, everything: bool) -> None:
    """Print the contents of a scene. `scene`: the name that the user gave; `everything`: default values too."""
    loaded = explanation.scene
    values = [v for v in explanation.values if everything or v.place or v.key in loaded.origins]
    _print_screen(explanation, scene)
    effects = [(e.name, "on" if e.on else "absent", _with_states(e)) for e in explanation.effects]
    printing.described(f"effects: {counted(explanation.states, 'state')}", effects)
    printing.line()
    actuators = [
        (a.name, f"{a.low:g} .. {a.high:g}", _unit(a.unit), f"{a.start:g}", f"{a.safe:g}")
        for a in explanation.actuators
    ]
    printing.table("actuators", ("actuator", "range", "unit", "at the start", "safe value"), actuators)
    printing.line()
    _print_controllers(loaded)
    if loaded.network:
        _print_network(loaded)
    if loaded.faults:
        _print_faults(loaded)
    _print_values(values)
    left = len(explanation.values) - len(values)
    more = f"{left} more values have defaults; to list them: rig explain {shlex.quote(scene)} --all"
    if left:
        printing.line()
        printing.paragraph(more)


def _print_screen(explanation: Explanation, typed: str) -> None:
    """One screen: what acts, what it does, what is uncertain. `typed`: the name that the user gave."""
    scene = explanation.scene
    name = shlex.quote(typed)
    based_on = scene.bases and f"Based on {', which is based on '.join(scene.bases)}"
    for text in (f"{scene.title} ({scene.name})", scene.about, based_on, scene.slow and f"Paced, {scene.slow}"):
        if text:
            printing.paragraph(text)
            printing.line()
    on = [effect for effect in explanation.effects if effect.on and effect.name != "structure"]
    acts = [(effect.name, effect.about) for effect in on if effect.name.startswith(_CONTACT)]
    acts += [("also", ", ".join(effect.name for effect in on if not effect.name.startswith(_CONTACT)))]
    acts += [(f"controller {key}", _loop(section)) for key, section in scene.controllers.items()]
    acts += [("sensors", ", ".join(scene.sensors))]
    for title, rows in (
        ("what acts", acts),
        ("what it does", _does(scene, name)),
        ("what is uncertain", _uncertain(explanation)),
    ):
        printing.described(title, [row for row in rows if row[1]])
    if stated := explanation.stated:
        printing.described("mass and contacts", [*stated.lines(), *stated.warnings()])
    printing.paragraph(f"next: rig simulate {name} | rig modes {name} | rig run {name} --view")
    printing.line()


def _loop(section: Any) -> str:
    from rig.controllers import controller_drives, controller_reads

    reads = ", ".join(dict.fromkeys(controller_reads(section).values()))
    drives = ", ".join(controller_drives(section))
    return f"kind {section.kind}, reads {reads or 'nothing'}, drives {drives or 'nothing'}"


def _does(scene: Scene, name: str) -> Iterator[tuple[str, str]]:
    """The stability of steady sliding, and the protocol."""
    from rig.analysis.linear.modes import modes
    from rig.scenes.axis import main

    try:
        stability = modes(scene).summary()
    except RigError as fault:
        stability = " ".join(str(fault).split())
    yield "stability", stability
    yield "at", ", ".join(words for words, _ in main(scene).values())
    if scene.protocol:
        length = "without an end" if scene.duration_ns is None else f"{scene.duration_ns / 1e9:g} s"
        yield "protocol", f"{counted(len(scene.protocol), 'step')}, {length}"
    if scene.assemble().film is not None:
        chaos = (
            "after the first opening of a contact point the motion is chaotic: only statistics count. "
            f"Their spread: rig study {name} --repeat 8 -p noise.force=1e-6 --measure run.rms"
        )
        yield "chaos", chaos


def _uncertain(explanation: Explanation) -> Iterator[tuple[str, str]]:
    """How many values have which origin; of the main ones those that have no source."""
    from rig.scenes.axis import main

    stated = [v for v in explanation.values if v.place or v.key in explanation.scene.origins]
    counts = Counter(value.origin.origin for value in stated)
    yield "origins", ", ".join(f"{number} {origin}" for origin, number in counts.most_common()) or "all are defaults"
    words: dict[str, list[str]] = {}
    shown = main(explanation.scene)
    for value in stated:
        if value.key in shown and value.origin.origin not in _SOURCED:
            words.setdefault(value.origin.origin, []).append(shown[value.key][1])
    yield "no source", "; ".join(f"{', '.join(names)} ({origin})" for origin, names in words.items())
    yield "your rig", "rig identify fits parameters to your recordings: docs/identify.md"


def _with_states(effect: Effect) -> str:
    states = f"{counted(len(effect.states), 'state')} {effect.states_text}" if effect.states else ""
    return "; ".join(filter(None, (effect.about, states)))


def _print_values(values: Sequence[Value]) -> None:
    """Every value with its origin, note and line; the file that gives most of them is named once."""
    files = Counter(v.place.file for v in values if v.place and v.place.line)
    usual = files.most_common(1)[0][0] if files else ""

    def line_of(value: Value) -> str:
        place = str(value.place or "")
        return place.removeprefix(f"{usual}, ") if usual else place

    rows = []
    for value in values:
        number = f"{_listed(value.value)} {_unit(value.unit)}".strip()
        remark = ", ".join(filter(None, (value.origin.note, line_of(value))))
        rows.append((value.key, number, value.origin.origin, remark))
    printing.described(f"values, with lines of {usual}" if usual else "values", rows)


def _listed(value: Any) -> str:
    return ", ".join(map(printing.number, value if isinstance(value, list) else [value]))


def _unit(unit: str) -> str:
    return "" if unit == "1" else unit


def _believed(scene: Scene) -> tuple[dict[str, dict[str, Any]], str]:
    """The numbers of each controller, and why they cannot be had."""
    from rig.design import numbers
    from rig.errors import SceneError

    try:
        return numbers(scene), ""
    except SceneError as fault:
        return {}, "; ".join(fault.faults)


def _print_controllers(scene: Scene) -> None:
    """What the controllers believe of the rig: their numbers from the design, and values that are not so."""
    from rig.scenes.belief import lines

    if not scene.controllers:
        return
    by_controller, fault = _believed(scene)
    rows = [(name, key, _short(value)) for name, numbers in by_controller.items() for key, value in numbers.items()]
    title = "controllers: what they believe of the rig, from the values of this scene"
    printing.table(title, ("controller", "number", "value"), rows)
    without = [name for name, numbers in by_controller.items() if not numbers]
    if without:
        printing.paragraph(f"{', '.join(without)}: no number of the rig")
    for line in filter(None, [fault and f"cannot be designed: {fault}", *lines(scene)]):
        printing.paragraph(line)
    printing.paragraph(
        "set-points (speed of the drive, load) are told when they are varied, other values are not: docs/belief.md"
    )
    printing.line()


def _short(value: Any) -> str:
    """A number of a controller as text; of a long list its length."""
    if not isinstance(value, list):
        return printing.number(value)
    return str(value) if len(value) <= _MANY and not any(isinstance(v, list) for v in value) else f"{len(value)} values"


def _print_network(scene: Scene) -> None:
    """The impaired links of a scene, with the time under way as the frames of the scene round it."""
    from rig.scenes.network import described
    from rig.scenes.sections import dump

    rows = []
    for topic, link in scene.network.links.items():
        least, most = link.ticks(scene.frame_ns)
        frames = f"{least} .. {most} frames" if most > least else counted(most, "frame")
        rows.append((topic, f"under way {frames}", described(dump(link))))
    seed = scene.seed if scene.network.seed is None else scene.network.seed
    printing.described(f"impaired links, seed {seed}", rows)
    printing.paragraph("a message arrives at a frame: its transmission time is rounded up to whole frames")
    printing.line()


def _print_faults(scene: Scene) -> None:
    """The faults of sensors and actuators of a scene, in order of time."""
    from rig.scenes.part_faults import described

    units = {name: named.unit for name, named in scene.assemble().inputs.items()}
    units |= {name: sensor.unit for name, sensor in scene.sensors.items()}
    rows = []
    for name, fault in sorted(scene.faults.items(), key=lambda named: named[1].at):
        begin = f"{fault.at / 1e9:g} s"
        end = "to the end" if fault.end is None else f"to {fault.end / 1e9:g} s"
        rows.append((begin, end, name, described(fault, units[fault.part])))
    printing.described("faults of sensors and actuators", rows)
    printing.line()


def _value(value: Value) -> dict[str, Any]:
    """A value for JSON; `file` and `line` that give it: null for a default, "-p" for a change."""
    place = value.place
    file: str | None = None
    line: int | None = None
    if place is not None:
        file = place.file if place.line else "-p"
        line = place.line or None
    return {
        "key": value.key,
        "value": value.value,
        "unit": value.unit,
        "origin": value.origin.origin,
        "note": value.origin.note,
        "file": file,
        "line": line,
    }


def _audited(log: str) -> Told:
    from rig.cli.recordings import opened

    run = opened(Path(log))
    if run.measured:
        raise LogError(f"{log}: it is a measurement: it contains no rig, which this command needs")
    judged = run.summary.get("audit", [])
    network = run.summary.get("network", {})
    faults = [(event["t_ns"] / 1e9, event["text"]) for event in run.plant_events if event["kind"] == "fault"]

    def show() -> None:
        state = [_acted(effect) for effect in judged]
        shares = ["not judged" if e.get("unjudged") else f"{e['share']:.2g}" for e in judged]
        remarks = [e["text"] if e["noted"] or e.get("unjudged") else "" for e in judged]
        rows = list(zip((e["effect"] for e in judged), state, shares, remarks))
        printing.table(
            f"{log}: influence of each effect in this run",
            ("effect", "", "share of the forces (limits: of the time)", "remark"),
            rows,
        )
        if network:
            printing.line()
            messages = [(topic, *counts.values()) for topic, counts in network.items()]
            printing.table("impaired links, number of messages", ("link", *next(iter(network.values()))), messages)
        if faults:
            printing.line()
            printing.table("faults of sensors and actuators", ("t", ""), [(f"{t:g} s", text) for t, text in faults])
        if not judged:
            printing.line(
                "no result: the run was too short, or no shipped scene of its plant has values for the absent effects\n"
                "(rig explain SCENE --measure uses values of other plants too)"
            )

    happened = [{"t": t, "text": text} for t, text in faults]
    return Told({"log": log, "effects": judged, "network": network, "faults": happened}, show=show)


def _acted(effect: Mapping[str, Any]) -> str:
    """Whether a judged effect was on; of an absent one, the scene from which its values are."""
    if effect["on"]:
        return "on"
    return f"absent, as in {effect['like']}" if effect["like"] else "absent"


def _measured(scene: Scene) -> Answer:
    from rig.qualify import effects_measured
    from rig.record.provenance import provenance

    with printing.bar("effects") as progress:
        parts = effects_measured.parts(scene, report=progress)
    methods = effects_measured.methods(scene)
    signals = [*effects_measured.signals(scene)]
    topics = [*effects_measured.topics(scene)]
    values = {
        "scene": scene.name,
        "states": scene.assemble().system().n - 1,
        "effects": [part.to_json() for part in parts],
        "methods": methods,
        "signals": [vars(rate) for rate in signals],
        "topics": [vars(rate) for rate in topics],
    }
    rates = {"outputs": signals, "topics of rig run": topics}

    def draw(figure: Path) -> None:
        title = f"{scene.name}: its effects, on or absent"
        effects_measured.draw(parts, title, provenance(scene.seed), figure)

    return Answer(Told(values, show=lambda: _print_measured(scene, parts, methods, rates)), draw=draw)


def _print_measured(
    scene: Scene, parts: Sequence[Paired], methods: Mapping[str, str], rates: Mapping[str, Sequence[Rate]]
) -> None:
    """What was measured, for a reader."""
    rows = [
        (
            part.name,
            "on" if part.on else "absent",
            part.states,
            "" if part.fault else part.cost(),
            part.change(),
            part.why,
        )
        for part in parts
    ]
    columns = ("effect", "", "states", "cost per sample step", "largest change without it", "remark")
    printing.table(f"{scene.name}: effects, measured with and without each in turns", columns, rows)
    if any(part.measurable and part.tick.value < -part.noise for part in parts):
        printing.line(
            "negative cost: without the effect the motion has more events, and these cost more than the effect"
        )
    printing.line(
        "change: difference of the two values over the larger one; < x ns: below the noise floor of this machine\n\n"
        "methods"
    )
    printing.pairs(methods.items())
    for title, computed in rates.items():
        printing.line()
        lines = [(row.name, f"{row.rate:g}" if row.rate else "", row.asked) for row in computed]
        printing.table(title, ("", "per s", "used by"), lines)


def fmu(
    scene: Scene,
    out: Annotated[Path, Option("FILE", "FMU to write.", check=new)],
    inputs: Annotated[
        list[str] | None,
        Option(
            "ACTUATOR", "Actuator that is an input; may be repeated. Default: all that can be commanded.", "--input"
        ),
    ] = None,
) -> Told:
    """Write a scene as an FMU for co-simulation (FMI 2.0), for controllers in other tools.

    Inputs are actuators; outputs are the sensors and the plant's own outputs,
    with units. The rig runs in a child process of the program that imports the
    FMU: it needs this Python, or another one with friction-rig (parameter
    python). Controllers of the scene that drive an input are left out.
    """
    from rig.plant_fmu.export import export

    def listed(units: Mapping[str, str]) -> str:
        return ", ".join(f"{name} [{unit}]" for name, unit in units.items())

    exported = export(scene, out, inputs or ())
    return Told(
        {"path": out, "inputs": exported.inputs, "outputs": exported.results},
        f"inputs   {listed(exported.inputs)}",
        f"outputs  {listed(exported.results)}",
        f"step     {scene.frame_ns * 1e-9:g} s, or a whole number of these",
        f"fmu      {out}",
    )


COMMANDS = {
    "list": Made(list_scenes, "rig list"),
    "new": Made(new_scene, "rig new mine --based-on belt"),
    "explain": Made(explain, 'rig explain pendulum -p drive.speed="2 rpm"', files="figure"),
    "fmu": Made(fmu, "rig fmu belt --out plant.fmu"),
}
