"""Load a scene by name or path, with changes by the caller; one error lists every fault of the scene."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from rig.controllers.blocks.compiled import CompiledSection
from rig.effects import EFFECTS, knock
from rig.errors import PartError, SceneError
from rig.parts import Code, calling, code_of
from rig.plants import PLANTS
from rig.quantities import Section
from rig.scenes import checks, faults, inherit, merged, places, rooms, sections, shipped
from rig.scenes.network import Network
from rig.scenes.network import checks as network_checks
from rig.scenes.part_faults import checks as part_faults_checks
from rig.scenes.part_faults import faults_of
from rig.scenes.protocol import STEP, STEPS, UNKNOWN, Clock, Known, Load, Mark, Ramp, Step, flat, knock_durations
from rig.scenes.scene import Scene
from rig.scenes.sections import known
from rig.sensors.chain.instants import common_step

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


class _Reading:
    """One pass that makes a scene of its merged tables, and adds every fault to those of the tables."""

    def __init__(self, tables: merged.Merged) -> None:
        self._tables = tables
        self._codes: dict[tuple[str, str], Code] = {}

    def scene(self, name: str) -> Scene | None:
        """The scene, or None if there are faults."""
        raw = self._tables.raw
        clock = self._section(Clock, "clock", raw.get("clock", {}))
        seed = sections.seed(self._tables)
        plant, parameters = self._plant()
        sensors = self._named("sensors", rooms.SENSORS)
        controllers = self._named("controllers", rooms.CONTROLLERS)
        frame_ns = int(clock.frame) if clock is not None else 1_000_000
        assembly = self._assembled(parameters, frame_ns) if parameters is not None else None
        names = UNKNOWN
        if assembly is not None and parameters is not None and None not in [*sensors.values(), *controllers.values()]:
            names = known(assembly, parameters, sensors, controllers)
        sensors = {n: s for n, s in sensors.items() if s is not None}
        controllers = {n: c for n, c in controllers.items() if c is not None}
        network = self._section(Network, "network", raw.get("network", {})) or Network()
        if names.whole:
            self._tables.report(network_checks(raw.get("network"), sensors, controllers))
        self._tables.leave_out(names)
        protocol = self._protocol(names)
        if assembly is not None:
            knock.add(assembly, knock_durations(protocol))
        limits = sections.limits(self._tables, assembly)
        part_faults = faults_of(self._tables, names)
        if clock is not None:
            self._tables.report(checks.periods(clock, controllers, raw))
            self._tables.report(
                checks.steps(clock, common_step(clock.frame, (s.instants for s in sensors.values())), raw)
            )
            self._tables.report(checks.lengths(clock, protocol, raw.get("protocol")))
            self._tables.report(checks.whole(protocol))
        if assembly is not None:
            self._tables.report(checks.readings(sensors, assembly.outputs, plant))
        if names.whole:
            self._tables.report(checks.wiring(controllers, sensors, names.inputs, plant))
            self._tables.report(checks.units(controllers, sensors, names.inputs))
            self._compiled(controllers, sensors, parameters, frame_ns)
            self._tables.report(checks.hands_off(protocol, controllers))
            ramped = {step.target: "ramped" for step in flat(protocol) if isinstance(step, Load | Ramp)}
            if parameters is not None and assembly is not None:
                inputs = rooms.assembled(parameters, frame_ns, ramped).inputs if ramped else assembly.inputs
                self._tables.report(checks.commanded(protocol, inputs))
                held = {fault.part: "held" for fault in part_faults.values() if fault.part in assembly.inputs}
                inputs = rooms.assembled(parameters, frame_ns, held).inputs if held else assembly.inputs
                given = raw.get("faults")
                self._tables.report(part_faults_checks(part_faults, sensors, inputs, plant, frame_ns, given))
        title, about = sections.text(self._tables, "title", name), sections.text(self._tables, "about", "").strip()
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
        self, controllers: Mapping[str, Any], sensors: Mapping[str, Any], parameters: Section | None, frame_ns: int
    ) -> None:
        """Report algebraic loops through compiled controllers."""
        compiled = {name: section for name, section in controllers.items() if isinstance(section, CompiledSection)}
        if not compiled or parameters is None or self._tables.faults:
            return
        moved = {actuator: "held" for section in compiled.values() for actuator in section.connected_actuators}
        made = rooms.assembled(parameters, frame_ns, moved)
        inputs = {name: drive for name, drive in made.inputs.items() if name in moved}
        self._tables.report(checks.algebraic_loops(compiled, sensors, made.outputs, inputs))

    def _fault(self, key: str, line: str) -> None:
        self._tables.report([(key, line)])

    def _section(self, model: type[S], prefix: str, raw: Any) -> S | None:
        """`raw` as a section; None after reporting its faults."""
        try:
            with calling(sys.modules[model.__module__], ValidationError):
                section = model.model_validate(raw)
            wrong = list(checks.misdeclared(section, prefix)) or list(checks.unwritable(section, prefix))
            self._tables.report(wrong)
            return None if wrong else section
        except ValidationError as error:
            self._tables.report(faults.lines(error, model, raw, prefix))
        except PartError as error:  # of a validator in a file
            self._tables.faults.append(str(error))
        return None

    def _plant(self) -> tuple[str, Section | None]:
        plant = self._tables.raw.get("plant")
        if plant is None:
            self._fault("plant", f'plant: is missing, and so is based_on = "SCENE"; known: {", ".join(sorted(PLANTS))}')
            for table, values in self._tables.raw.items():
                for key in {"plant", "based_on"} & values.keys() if isinstance(values, dict) else ():
                    self._fault(f"{table}.{key}", f"{table}.{key}: put {key} above the first table of the file")
                if not isinstance(values, dict) and table not in merged.OWN:
                    self._fault(table, _unknown(table, Section))
            self._effects(Section)
            return "", None
        if not isinstance(plant, str) or plant not in PLANTS:
            self._fault("plant", _unknown_part("plant", plant, PLANTS))
            self._effects(Section)
            return str(plant), None
        try:
            model = PLANTS[plant].Parameters
        except PartError as error:
            self._fault("plant", f"plant: {error}")
            self._effects(Section)
            return plant, None
        if taken := sorted(model.model_fields.keys() & {*merged.OWN}):
            self._fault("plant", f"plant: {rooms.name_of(plant)}: Parameters declares {', '.join(taken)}, which every "
                        "scene has already; rename it")  # fmt: skip
            return plant, None
        tables = {key: value for key, value in self._tables.raw.items() if key not in merged.OWN}
        effects = self._effects(model)
        known = {key: effect for key, effect in effects.items() if effect is not None}
        for key in known:
            tables[key] = tables[key] | {rooms.EFFECT: rooms.name_of(tables[key][rooms.EFFECT])}
        model = rooms.with_effects(model, known)
        unknown = [key for key in tables if key not in model.model_fields]
        self._tables.report((key, _unknown(key, model)) for key in unknown if key not in effects)
        for key in unknown:
            del tables[key]
        parameters = self._section(model, "", tables)
        return rooms.name_of(plant), parameters if len(known) == len(effects) else None

    def _effects(self, model: type[Section]) -> dict[str, Any]:
        """Table -> section of each effect that the plant, with parameters `model`, does not know."""
        tables = {key: value for key, value in self._tables.raw.items() if key not in merged.OWN}
        return {key: self._effect(key, name) for key, name in rooms.effects_in(tables, model).items()}

    def _effect(self, key: str, name: Any) -> Any:
        """The section of an effect that the plant does not know; None after reporting its faults."""
        here = f"{key}.{rooms.EFFECT}"
        if not _NAME.fullmatch(key) or hasattr(Section, key):
            self._fault(key, f"{key}: no effect can have this name; it is letters, digits and _, as in [wobble]")
        elif not isinstance(name, str) or name not in EFFECTS:
            installed = ", ".join(EFFECTS.installed) or "none"
            line = f"{here} = {faults.shown(name)}: unknown; expected a file (./NAME.py); installed: {installed}"
            self._fault(here, line)
        else:
            try:
                section = EFFECTS[name]
            except PartError as error:
                self._fault(here, f"{here}: {error}")
                return None
            self._alone(here, EFFECTS.what, rooms.name_of(name), section)
            return section
        return None

    def _alone(self, key: str, room: str, name: str, model: type[Any]) -> None:
        """Report a second file of one name: a recording holds one source for each name."""
        code = code_of(model)
        if code is not None and self._codes.setdefault((room, name), code) != code:
            self._fault(key, f"{key}: the scene names another file that is called {name}; rename one")

    def _assembled(self, parameters: Section, frame_ns: int) -> Any:
        """The rig; None after reporting that a plant or an effect from a file failed."""
        try:
            return rooms.assembled(parameters, frame_ns)
        except PartError as error:
            self._tables.faults.append(str(error))
        return None

    def _named(self, room: str, kinds: Mapping[str, type[Any]]) -> dict[str, Any]:
        """The sensors or controllers by name; None for each that has faults."""
        tables = self._tables.raw.get(room, {})
        if not isinstance(tables, dict):
            self._fault(room, f"{room} = {faults.shown(tables)}: expected tables [{room}.NAME]")
            return {}
        if len(tables) > PARTS:
            self._fault(room, f"{room}: there are {len(tables)}; at most {PARTS} are possible")
            return {}
        return {name: self._one(f"{room}.{name}", name, raw, kinds) for name, raw in tables.items()}

    def _one(self, key: str, name: str, raw: Any, kinds: Mapping[str, type[Any]]) -> Any:
        if not _NAME.fullmatch(name):
            self._fault(key, f"{key}: a name is at most 64 letters, digits and _, and begins with a letter")
            return None
        if not isinstance(raw, dict):
            self._fault(key, f"{key} = {faults.shown(raw)}: expected a table with kind = ...")
            return None
        if "kind" not in raw:
            self._fault(f"{key}.kind", f"{key}.kind: is missing; known: {', '.join(sorted(kinds))}")
            return None
        if not isinstance(raw["kind"], str) or raw["kind"] not in kinds:
            self._fault(f"{key}.kind", _unknown_part(f"{key}.kind", raw["kind"], kinds))
            return None
        here = f"{key}.kind"
        try:
            model = kinds[raw["kind"]]
            if issubclass(model, CompiledSection):
                here = f"{key}.{rooms.FILE}"
                model = model.of_table(raw)
        except PartError as error:
            self._tables.report((here, f"{here}: {line}") for line in str(error).splitlines())
            return None
        kind = rooms.name_of(raw["kind"])
        own: Any = {rooms.FILE: model.model_fields[rooms.FILE].default} if issubclass(model, CompiledSection) else {}
        section = self._section(model, key, raw | {"kind": kind} | own)
        if section is None or not (own or code_of(model)):
            return section
        if own:
            self._tables.notes += [f"{key}: {note}" for note in section.notes()]
        else:
            self._alone(f"{key}.kind", key.partition(".")[0], kind, model)
        wrong = list(checks.foreign(key, section))
        self._tables.report(wrong)
        return None if wrong else section

    def _protocol(self, names: Known) -> tuple[Step, ...]:
        raw = self._tables.raw.get("protocol", [])
        if not isinstance(raw, list):
            self._fault("protocol", "protocol: expected steps, each a table [[protocol]]")
            return ()
        try:
            return STEPS.validate_python(raw, context=names)
        except ValidationError as error:
            self._tables.report(faults.lines(error, tuple[Step, ...], raw, "protocol"))
        return tuple(self._step(entry, names) for entry in raw)

    def _step(self, raw: Any, names: Known) -> Step:
        """One step of a protocol that has faults; an empty mark replaces a faulty step."""
        try:
            return STEP.validate_python(raw, context=names)
        except ValidationError:
            return Mark(step="mark", text="")


def _unknown(key: str, model: type[Section]) -> str:
    """The line for a key or table that a scene with these parameters does not know."""
    if "." in key:
        return f'"{key}": a name in quotes is one key; write {key} without quotes'
    return faults.unknown_key(key, [*merged.OWN, *model.model_fields])


def _unknown_part(key: str, name: Any, known: Iterable[str]) -> str:
    """The line for a part that does not exist. A path without .py is taken for a name."""
    line = faults.unknown_choice(key, name, known)
    return f"{line}; the name of a file ends in .py" if isinstance(name, str) and "/" in name else line
