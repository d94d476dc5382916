"""The command that shows what a scene contains, or what its effects did in a recording."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.cli import printing
from rig.cli.options import Changes, Force, Json, SceneName, changes, the_scene
from rig.cli.outputs import new
from rig.errors import UsageError

if TYPE_CHECKING:
    from rig.qualify.effects_measured import Part, Rate
    from rig.scenes.explain import Value
    from rig.scenes.scene import Scene

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
    from rig.scenes.network_text import described
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
    from rig.cli.logs import opened

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
        f"{log}: influence of each effect in this run", ("effect", "", "share of the forces", "remark"), rows
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
        from rig.qualify.effects_figure import draw

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


COMMANDS = {"explain": (explain, 'rig explain pendulum -p drive.speed="2 rpm"')}
