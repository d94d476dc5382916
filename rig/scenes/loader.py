"""Load a scene by name or path, with changes by the caller; one error lists every fault of the scene."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from rig.controllers.blocks.compiled import CompiledSection
from rig.effects import EFFECTS, knock
from rig.errors import PartError, SceneError, UsageError
from rig.laws import LAWS, FrictionLaw, with_laws
from rig.parts import Code, calling, code_of
from rig.plants import PLANTS
from rig.quantities import Section
from rig.scenes import checks, faults, inherit, merged, places, rooms, sections, shipped
from rig.scenes.merged import Wrong
from rig.scenes.network import Network
from rig.scenes.network import checks as network_checks
from rig.scenes.part_faults import checks as part_faults_checks
from rig.scenes.part_faults import faults_of
from rig.scenes.protocol import (
    STEP,
    STEPS,
    UNKNOWN,
    Clock,
    Known,
    Mark,
    Step,
    flat,
    knock_durations,
    moves,
    recorded,
    targets,
)
from rig.scenes.scene import Scene
from rig.sensors.chain.instants import common_step
from rig.sensors.stream import with_ages

S = TypeVar("S", bound=Section)
PARTS = 100
"""Largest number of sensors of a scene, and of controllers."""
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")
"""A name of a table; longer ones cannot be topics on the bus."""


def load(
    name_or_path: str | Path,
    overrides: Mapping[str, object] | None = None,
    given: Mapping[str, places.Place] | None = None,
) -> Scene:
    """The scene of a shipped name or of a file, with `overrides` (dotted key -> value, text with unit or number).

    `given`: dotted key -> place of an override, for messages; those without one are given in the call. Raises
    SceneError with every fault: dotted key, what was given, what is allowed, file and line that gave it.
    """
    path = shipped.path(name_or_path)
    tables = merged.Merged(inherit.layers(path), overrides or {}, given or {})
    scene = _Reading(tables).scene(path.stem)
    if scene is None:
        listed = tables.faults[: merged.MOST]
        more = ["and more"] if len(tables.faults) > merged.MOST else []
        raise SceneError(str(name_or_path), [*listed, *more, *tables.notes])
    return scene


def loaded(scene: Scene | str | Path, overrides: Mapping[str, object] | None = None) -> Scene:
    """Return a scene that is loaded already, or load the one of a name or file with `overrides`, as `load` does.

    Raises SceneError as `load`, UsageError for what is no scene and for overrides of a scene that is loaded already.
    """
    if isinstance(scene, str | Path):
        return load(str(scene), overrides)
    if not isinstance(scene, Scene):
        raise UsageError(f"{scene!r:.60} is no scene; give a name, a file, or what rig.load returns")
    if overrides:
        raise UsageError(
            f"overrides {', '.join(overrides)}: the scene {scene.name} is loaded already; "
            "give them to rig.load, or give its name or file here"
        )
    return scene


def parameters(name: str) -> Section:
    """The parameters of the plant of a shipped scene, without the rest of the scene, which takes longer."""
    tables = merged.Merged(inherit.layers(shipped.path(name)), {}, {})
    return _Reading(tables).parameters()


class _Reading:
    """One pass that makes a scene of its merged tables, and adds every fault to those of the tables."""

    def __init__(self, tables: merged.Merged) -> None:
        self._tables = tables
        self._codes: dict[tuple[str, str], Code] = {}

    def scene(self, name: str) -> Scene | None:
        """The scene, or None if there are faults."""
        raw = self._tables.raw
        read = self._tables.read
        report = self._tables.report
        clock = read(partial(self._section, Clock, "clock", raw.get("clock", {})), None)
        seed = sections.seed(self._tables)
        plant = rooms.name_of(str(raw.get("plant", "")))
        parameters = read(self.parameters, None)
        all_sensors: dict[str, Any] = with_ages(read(partial(self._named, "sensors", rooms.SENSORS), {}))
        all_controllers: dict[str, Any] = read(partial(self._named, "controllers", rooms.CONTROLLERS), {})
        sensors = {name: section for name, section in all_sensors.items() if section is not None}
        controllers = {name: section for name, section in all_controllers.items() if section is not None}
        frame_ns = int(clock.frame) if clock is not None else 1_000_000
        assembly = None
        if parameters is not None:
            assembly = read(partial(rooms.assembled, parameters, frame_ns), None)
        names = UNKNOWN
        if assembly is not None and parameters is not None and (sensors, controllers) == (all_sensors, all_controllers):
            names = replace(sections.known(assembly, parameters, sensors, controllers), frame_ns=frame_ns)
        network = read(partial(self._section, Network, "network", raw.get("network", {})), Network())
        if names.whole:
            report(network_checks(raw.get("network"), sensors, controllers))
        self._tables.leave_out(names)
        protocol = self._protocol(names)
        followed = [(i, step.file.about) for i, step in enumerate(flat(protocol), 1) if recorded(step)]
        self._tables.notes += [f"protocol, step {i}: {about['note']}" for i, about in followed if about.get("note")]
        if assembly is not None:
            knock.add(assembly, knock_durations(protocol))
        limits = sections.limits(self._tables, assembly)
        part_faults = faults_of(self._tables, names)
        if clock is not None:
            step_ns = common_step(clock.frame, (s.instants for s in sensors.values()))
            report(checks.periods(clock, controllers, raw))
            report(checks.stream_rates(clock, sensors))
            report(checks.steps(clock, step_ns, raw))
            report(checks.lengths(clock, protocol, raw.get("protocol")))
            report(checks.whole(protocol))
        if assembly is not None:
            report(checks.readings(sensors, assembly.outputs, plant))
        if names.whole and assembly is not None and parameters is not None:
            report(checks.wiring(controllers, sensors, names.inputs, plant))
            report(checks.units(controllers, sensors, names.inputs))
            report(checks.boards(controllers, sensors))
            self._compiled(controllers, sensors, parameters, frame_ns)
            report(checks.hands_off(protocol, controllers))
            ramped = {name: "ramped" for step in flat(protocol) if moves(step) for name in targets(step)}
            inputs = rooms.assembled(parameters, frame_ns, ramped).inputs if ramped else assembly.inputs
            report(checks.commanded(protocol, inputs))
            held = {fault.part: "held" for fault in part_faults.values() if fault.part in assembly.inputs}
            inputs = rooms.assembled(parameters, frame_ns, held).inputs if held else assembly.inputs
            report(part_faults_checks(part_faults, sensors, inputs, plant, frame_ns, raw.get("faults")))
        title = sections.text(self._tables, "title", name)
        about = sections.text(self._tables, "about", "").strip()
        if self._tables.faults or clock is None or parameters is None:
            return None
        return Scene(
            name=name,
            title=title,
            about=about,
            plant=plant,
            parameters=parameters,
            clock=clock,
            sensors=sensors,
            controllers=controllers,
            network=network,
            faults=part_faults,
            protocol=protocol,
            limits=limits,
            seed=seed,
            origins=self._tables.origins,
            notes=tuple(self._tables.notes),
            places=self._tables.places,
        )

    def _compiled(
        self, controllers: Mapping[str, Any], sensors: Mapping[str, Any], parameters: Section, frame_ns: int
    ) -> None:
        """Report algebraic loops through compiled controllers."""
        compiled = {name: section for name, section in controllers.items() if isinstance(section, CompiledSection)}
        if not compiled or self._tables.faults:
            return
        moved = {actuator: "held" for section in compiled.values() for actuator in section.connected_actuators}
        made = rooms.assembled(parameters, frame_ns, moved)
        inputs = {name: drive for name, drive in made.inputs.items() if name in moved}
        self._tables.report(checks.algebraic_loops(compiled, sensors, made.outputs, inputs))

    def _section(self, model: type[S], prefix: str, raw: Any) -> S:
        """`raw` as a section. Raises Wrong, and PartError of a validator in a file."""
        try:
            with calling(sys.modules[model.__module__], ValidationError):
                section = model.model_validate(raw)
        except ValidationError as error:
            raise Wrong(*islice(faults.lines(error, model, raw, prefix), merged.MOST + 1)) from None
        if wrong := [*checks.misdeclared(section, prefix)]:
            raise Wrong(*wrong)
        return section

    def parameters(self) -> Section:
        """The parameters of the plant with the effects of the scene. Raises Wrong."""
        tables = {key: value for key, value in self._tables.raw.items() if key not in merged.OWN}
        try:
            model = self._model(self._tables.raw.get("plant"))
        except Wrong as fault:
            self._tables.report(fault.args)
            self._effects(tables, Section)
            raise
        effects = self._effects(tables, model)
        known = {key: effect for key, effect in effects.items() if effect is not None}
        for key in known:
            tables[key] = tables[key] | {rooms.EFFECT: rooms.name_of(tables[key][rooms.EFFECT])}
        model = rooms.with_effects(model, known)
        unknown = [key for key in tables if key not in model.model_fields]
        self._tables.report((key, _unknown(key, model)) for key in unknown if key not in effects)
        model = with_laws(model, self._laws(tables))
        parameters = self._section(model, "", {key: tables[key] for key in tables if key not in unknown})
        if len(known) < len(effects):
            raise Wrong
        return parameters

    def _model(self, plant: Any) -> type[Section]:
        """The parameters of a plant. Raises Wrong."""
        if plant is None:
            tables = self._tables.raw.items()
            missing = f'plant: is missing, and so is based_on = "SCENE"; known: {", ".join(sorted(PLANTS))}'
            misplaced = []
            for table, values in tables:
                for key in {"plant", "based_on"} & values.keys() if isinstance(values, dict) else ():
                    misplaced.append((f"{table}.{key}", f"{table}.{key}: put {key} above the first table of the file"))
            strange = [table for table, values in tables if not isinstance(values, dict) and table not in merged.OWN]
            raise Wrong(("plant", missing), *misplaced, *((key, _unknown(key, Section)) for key in strange))
        if not isinstance(plant, str) or plant not in PLANTS:
            raise Wrong(("plant", _unknown_part("plant", plant, PLANTS)))
        try:
            model: type[Section] = PLANTS[plant].Parameters
        except PartError as error:
            raise Wrong(("plant", f"plant: {error}")) from None
        if taken := sorted(model.model_fields.keys() & {*merged.OWN}):
            raise Wrong(
                (
                    "plant",
                    f"plant: {rooms.name_of(plant)}: Parameters declares {', '.join(taken)}, which every "
                    "scene has already; rename it",
                )
            )
        return model

    def _effects(self, tables: Mapping[str, Any], model: type[Section]) -> dict[str, Any]:
        """Table -> section of each effect that the plant with parameters `model` does not know; None if it is wrong."""
        named = rooms.effects_in(tables, model)
        return {key: self._tables.read(partial(self._effect, key, name), None) for key, name in named.items()}

    def _effect(self, key: str, name: Any) -> Any:
        """The section of an effect that the plant does not know. Raises Wrong."""
        here = f"{key}.{rooms.EFFECT}"
        if not _NAME.fullmatch(key) or hasattr(Section, key):
            raise Wrong((key, f"{key}: no effect can have this name; it is letters, digits and _, as in [wobble]"))
        if not isinstance(name, str) or name not in EFFECTS:
            installed = ", ".join(EFFECTS.installed) or "none"
            line = f"{here} = {faults.shown(name)}: unknown; expected a file (./NAME.py); installed: {installed}"
            raise Wrong((here, line))
        try:
            section = EFFECTS[name]
        except PartError as error:
            raise Wrong((here, f"{here}: {error}")) from None
        self._alone(here, EFFECTS.what, rooms.name_of(name), section)
        return section

    def _laws(self, tables: Mapping[str, Any]) -> dict[str, type[FrictionLaw]]:
        """Name -> class of each friction law from elsewhere. Raises Wrong."""
        laws = dict[str, type[FrictionLaw]]()
        wrong = []
        for key, name in rooms.laws_in(tables):
            short = rooms.name_of(name)
            try:
                laws[short] = LAWS[name]
            except PartError as error:
                wrong += [(key, f"{key}: {line}") for line in str(error).splitlines()]
            else:
                self._alone(key, LAWS.what, short, laws[short])
        if wrong:
            raise Wrong(*wrong)
        return laws

    def _alone(self, key: str, room: str, name: str, model: type[Any]) -> None:
        """Report a second file of one name: a recording holds one source for each name."""
        code = code_of(model)
        if code is not None and self._codes.setdefault((room, name), code) != code:
            self._tables.report([(key, f"{key}: the scene names another file that is called {name}; rename one")])

    def _named(self, room: str, kinds: Mapping[str, type[Any]]) -> dict[str, Any]:
        """The sensors or controllers by name; None for each that has faults. Raises Wrong."""
        tables = self._tables.raw.get(room, {})
        if not isinstance(tables, dict):
            raise Wrong((room, f"{room} = {faults.shown(tables)}: expected tables [{room}.NAME]"))
        if len(tables) > PARTS:
            raise Wrong((room, f"{room}: there are {len(tables)}; at most {PARTS} are possible"))
        return {
            name: self._tables.read(partial(self._part, room, name, raw, kinds), None) for name, raw in tables.items()
        }

    def _part(self, room: str, name: str, raw: Any, kinds: Mapping[str, type[Any]]) -> Any:
        """The sensor or controller of a table. Raises Wrong."""
        key = f"{room}.{name}"
        here = f"{key}.kind"
        if not _NAME.fullmatch(name):
            raise Wrong((key, f"{key}: a name is at most 64 letters, digits and _, and begins with a letter"))
        if not isinstance(raw, dict):
            raise Wrong((key, f"{key} = {faults.shown(raw)}: expected a table with kind = ..."))
        if "kind" not in raw:
            raise Wrong((here, f"{here}: is missing; known: {', '.join(sorted(kinds))}"))
        if not isinstance(raw["kind"], str) or raw["kind"] not in kinds:
            raise Wrong((here, _unknown_part(here, raw["kind"], kinds)))
        try:
            model = kinds[raw["kind"]]
            if issubclass(model, CompiledSection):
                here = f"{key}.{rooms.FILE}"
                model = model.of_table(raw)
        except PartError as error:
            raise Wrong(*((here, f"{here}: {line}") for line in str(error).splitlines())) from None
        kind = rooms.name_of(raw["kind"])
        own: Any = {rooms.FILE: model.model_fields[rooms.FILE].default} if issubclass(model, CompiledSection) else {}
        section = self._section(model, key, raw | {"kind": kind} | own)
        if own:
            self._tables.notes += [f"{key}: {note}" for note in section.notes()]
        elif code_of(model):
            self._alone(here, room, kind, model)
        else:
            return section
        if wrong := [*checks.foreign(key, section)]:
            raise Wrong(*wrong)
        return section

    def _protocol(self, names: Known) -> tuple[Step, ...]:
        """The steps of the protocol; an empty mark replaces a faulty one."""
        raw = self._tables.raw.get("protocol", [])
        if not isinstance(raw, list):
            self._tables.report([("protocol", "protocol: expected steps, each a table [[protocol]]")])
            return ()
        if not raw:
            return ()
        try:
            return STEPS.validate_python(raw, context=names)
        except ValidationError as error:
            self._tables.report(faults.lines(error, tuple[Step, ...], raw, "protocol"))
        steps = list[Step]()
        for entry in raw:
            try:
                steps.append(STEP.validate_python(entry, context=names))
            except ValidationError:
                steps.append(Mark(step="mark", text=""))
        return tuple(steps)


def _unknown(key: str, model: type[Section]) -> str:
    """The line for a key or table that a scene with these parameters does not know."""
    if "." in key:
        return f'"{key}": a name in quotes is one key; write {key} without quotes'
    return faults.unknown_key(key, [*merged.OWN, *model.model_fields])


def _unknown_part(key: str, name: Any, known: Iterable[str]) -> str:
    """The line for a part that does not exist. A path without .py is taken for a name."""
    line = faults.unknown_choice(key, name, known)
    return f"{line}; the name of a file ends in .py" if isinstance(name, str) and "/" in name else line
