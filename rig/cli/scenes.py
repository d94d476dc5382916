"""Commands that look at scenes without running them."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from rig.cli import tell
from rig.cli.options import Changes, Json, SceneName, changes


def list_scenes(as_json: Json = False) -> None:
    """List the shipped scenes."""
    from rig.scenes import names
    from rig.scenes.shelf import card

    cards = [card(name) for name in names()]
    if as_json:
        tell.report(cards)
        return
    tell.table("", ("scene", "plant", "what it is"), [(c["name"], c["plant"], c["title"]) for c in cards])
    tell.line("\nnext: rig explain SCENE | rig run SCENE --view | rig simulate SCENE")


def explain(
    scene: SceneName,
    p: Changes = None,
    everything: Annotated[bool, typer.Option("--all", help="Show defaults too.")] = False,
    as_json: Json = False,
) -> None:
    """Show what a scene is made of: effects on or absent, states each adds, the origin of every value."""
    from rig.scenes import load
    from rig.scenes.explain import explain as take_apart

    told = take_apart(load(scene, changes(p)))
    values = [v for v in told.values if everything or as_json or v.key in told.scene.origins]
    if as_json:
        tell.report(
            {
                "scene": told.scene.name,
                "title": told.scene.title,
                "about": told.scene.about,
                "plant": told.scene.plant,
                "states": told.states,
                "frame_s": told.scene.frame_ns / 1e9,
                "step_s": told.scene.step_ns / 1e9,
                "duration_s": None if told.scene.duration_ns is None else told.scene.duration_ns / 1e9,
                "effects": [vars(effect) for effect in told.effects],
                "values": [{**vars(v), "origin": v.origin.origin, "note": v.origin.note} for v in values],
            }
        )
        return
    tell.line(f"{told.scene.title} ({told.scene.name})\n\n{told.scene.about}\n")
    rows = [(e.name, "on" if e.on else "absent", len(e.states), ", ".join(e.states), e.about) for e in told.effects]
    tell.table(f"effects: {told.states} states", ("effect", "", "states", "", "about"), rows)
    tell.line()
    shown = [(v.key, _text(v.value), v.unit if v.unit != "1" else "", v.origin.origin, v.origin.note) for v in values]
    tell.table("values", ("key", "value", "unit", "origin", "note"), shown)
    left = len(told.values) - len(values)
    tell.line(f"\n{left} more values are defaults: rig explain {scene} --all" if left else "")


def _text(value: Any) -> str:
    return ", ".join(map(tell.number, value)) if isinstance(value, list) else tell.number(value)


COMMANDS = {
    "list": (list_scenes, "rig list"),
    "explain": (explain, 'rig explain pendulum -p drive.speed="2 rpm"'),
}
