"""The shipped scenes: names, files, titles. Reads no more of a file than asked for."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from math import isfinite
from pathlib import Path
from typing import Any

from rig.errors import SceneError
from rig.units import brief

HERE = Path(__file__).parent
_PLANT = re.compile(r'^plant\s*=\s*"([^"]*)"', re.MULTILINE)
_BASE = re.compile(r'^based_on\s*=\s*"([^"]*)"', re.MULTILINE)
_TABLE = re.compile(r"^(?=\[[a-z])", re.MULTILINE)


FIRST = "pendulum"
"""The scene to start from."""
GROUPS = {
    "stick-slip": "pendulum pendulum_by_hand belt belt_b belt_c seal_p seal_l tread_rough disc_slider",
    "stick-slip with other friction laws": "belt_stick_time belt_contact_temperature belt_lugre belt_elasto_plastic "
    "belt_maxwell_slip belt_dahl belt_rate_state",
    "sliding and stick-slip both stable; run-up and run-down": "belt_hysteresis belt_c_damped lever lever_three_stage "
    "lever_coulomb lever_sector lever_sector_three_stage tip tip_knock tip_epoxy tip_beam",
    "remedies against stick-slip": "belt_remedy_damping belt_remedy_friction belt_remedy_load belt_remedy_speed "
    "belt_remedy_stiffness belt_tuned_mass belt_tuned_mass_wrong belt_shunt",
    "feedback against stick-slip": "belt_normal_force belt_normal_force_acceleration belt_normal_force_displacement "
    "belt_velocity_feedback belt_slow_card belt_poor_network belt_faults belt_device pendulum_device",
    "dither and fluctuating load": "belt_dither belt_dither_controlled belt_dither_sampled two_dof_dither "
    "disc_slider_dither belt_fluctuating_load",
    "flutter, mostly by mode coupling": "two_dof four_dof north pin tread structure disc_slider_c plate_cea",
    "squeal of a brake": "brake brake_3400 brake_disc_modes",
    "squeal that a piezo stack stops": "brake_shunt brake_shunt_listener brake_shunt_sound brake_shunt_tuned "
    "brake_active",
    "divergence and moving load": "north_divergence disc_slider_a",
    "detachment, chaotic motion": "plate plate_96 plate_converged plate_example_2 plate_example_3",
    "tests that find the parameters of a rig": "lever_static_friction lever_kinetic_friction lever_free_cylinder "
    "lever_free_lever plate_free",
}
"""What happens -> the scenes in which it does, the first one to begin with."""


@cache
def groups() -> dict[str, str]:
    """What happens in each shipped scene, in the order of `GROUPS`."""
    return {name: group for group, listed in GROUPS.items() for name in listed.split()}


@cache
def names() -> tuple[str, ...]:
    """Names of the shipped scenes."""
    return tuple(sorted(path.stem for path in HERE.glob("*.toml")))


def path(name_or_path: str | Path, folder: Path = Path()) -> Path:
    """The file of a shipped scene, or of a path relative to `folder`. Raises SceneError, with near names."""
    text = str(name_or_path)
    shipped = HERE / f"{text}.toml"
    if text in names():
        return shipped
    given = Path(name_or_path)
    if not given.name:
        raise SceneError(repr(text), ["names no scene; rig list shows the shipped ones"])
    if text.startswith('{"'):  # Run.scene
        raise SceneError(brief(text)[1:-1], ["is the text of a scene; rig.scenes.scene.Scene.from_json reads it"])
    if given.suffix in (".toml", ".mcap") or "/" in text:  # who reads a recording as a scene says what it is
        if given.stem in names() and given.name == text and not os.path.lexists(folder / given):
            raise SceneError(text, [f"there is no such file; the shipped scene is called {given.stem}"])
        return folder / given
    from rig.scenes.faults import near

    beside = given.with_suffix(".toml")
    hint = f"the file is called {beside}" if os.path.isfile(folder / beside) else near(text, names(), "rig list")
    raise SceneError(brief(text)[1:-1], [f"no scene has this name; {hint}"])


def card(name: str) -> dict[str, Any]:
    """Title, plant, description and largest pace of a shipped scene; the scene it is based on."""
    return card_of(name, _tables(name))


def card_of(name: str, chain: Sequence[tuple[str | None, Mapping[str, Any]]]) -> dict[str, Any]:
    """The card of the scene `name` from its files, the last base first: of each, what it is based on, and its tables.

    No part is loaded. Raises SceneError for a value that no scene can have.
    """
    based_on, last = chain[-1]
    plant: Any = None
    limit: Any = None
    for _, raw in chain:
        plant = _plain(raw.get("plant", plant))
        clock = raw.get("clock", {})
        if not isinstance(clock, Mapping) and clock != "none":
            raise SceneError(name, [f"clock = {brief(clock)}: expected a table [clock]"])
        limit = _plain(clock.get("pace_limit", limit)) if isinstance(clock, Mapping) else None
    texts = {"plant": plant or "", **{key: _plain(last.get(key, "")) for key in ("title", "about")}}
    for key, text in texts.items():
        if not isinstance(text, str):
            raise SceneError(name, [f"{key} = {brief(text)}: expected a text"])
    try:
        pace_limit = None if limit in (None, "none") else float(limit)
        if isinstance(limit, bool) or not isfinite(pace_limit or 0.0):
            raise ValueError
    except (TypeError, ValueError):
        raise SceneError(name, [f"clock.pace_limit = {brief(limit)}: expected a number or none"]) from None
    return {
        "name": name,
        "based_on": based_on,
        "plant": plant,
        "title": texts["title"],
        "about": texts["about"].strip(),
        "pace_limit": pace_limit,
    }


def _plain(value: Any) -> Any:
    """A value without its origin."""
    return value[0] if isinstance(value, list) and value else value


def _tables(name: str) -> list[tuple[str | None, dict[str, Any]]]:
    """What `card_of` reads of a shipped scene: of each of its files the begin and the clock."""
    head, *tables = _TABLE.split(_text(name))
    raw = tomllib.loads(head + "".join(table for table in tables if table.startswith("[clock]")))
    base = raw.get("based_on")
    return [*(_tables(base) if base else []), (base, raw)]


@cache
def text_of(name: str) -> str:
    """The text of a shipped scene, and behind it that of the scenes that it is based on."""
    text = _text(name)
    base = _BASE.search(text)
    return text + text_of(base[1]) if base else text


def plant(name: str) -> str:
    """The plant of a shipped scene, without parsing the file."""
    stated = _PLANT.search(text_of(name))
    assert stated is not None
    return stated[1]


def _text(name: str) -> str:
    return (HERE / f"{name}.toml").read_text(encoding="utf-8")
