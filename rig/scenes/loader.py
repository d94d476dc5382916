"""Load a scene: by name or path, with changes, checked as a whole; every fault is found before any is reported."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from annotated_types import Gt
from pydantic import ValidationError

from rig.effects import EFFECTS
from rig.errors import PartError, RigError, SceneError
from rig.parts import Code, code_of
from rig.parts import told as blamed
from rig.plants import PLANTS
from rig.quantities import Section, finite
from rig.scenes import checks, faults, inherit, rooms, source
from rig.scenes.places import Origin
from rig.scenes.protocol import UNKNOWN, Known, Load, Mark, Ramp, Step, flat
from rig.scenes.rooms import CONTROLLERS, SENSORS, assembled
from rig.scenes.scene import STEP, STEPS, Clock, Scene, known
from rig.scenes.shipped import path as path_of
from rig.sensors.chain.instants import common_step

S = TypeVar("S", bound=Section)
MOST = 100
"""Faults that are told."""
PARTS = 100
"""Sensors, and controllers, that a scene may have."""
OWN = ("format", "based_on", "title", "plant", "about", "seed", "clock", "sensors", "controllers", "protocol", "limits")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


def load(name_or_path: str | Path, overrides: Mapping[str, object] | None = None) -> Scene:
    """The scene of a shipped name or of a file, with `overrides` (dotted key -> value, text with unit or number).

    Raises SceneError with every fault: dotted key, what was given, what is allowed, file and line that gave it.
    """
    path = path_of(name_or_path)
    reading = _Reading(inherit.layers(path), overrides or {})
    scene = reading.scene(path.stem)
    if scene is None:
        told = reading.faults[:MOST]
        more = ["and more"] if len(reading.faults) > MOST else []
        raise SceneError(str(name_or_path), [*told, *more, *reading.notes])
    return scene


class _Reading:
    """One pass over a scene; `faults` collects a line for everything that is wrong."""

    def __init__(self, layers: Sequence[inherit.Layer], overrides: Mapping[str, object]) -> None:
        self.faults: list[str] = []
        self.origins: dict[str, Origin] = {}
        self.raw: dict[str, Any] = {}
        self._codes: dict[tuple[str, str], Code] = {}
        self.notes = [note for layer in layers if (note := layer.note)]
        self.places = inherit.Places(layers, overrides, self.raw)
        self.recast: dict[str, tuple[str, Any]] = {}
        """Tables of another kind than they had when the protocol was written: which key says it, what it said."""
        for layer in layers:
            self._lay(layer)
        found: list[source.Fault] = []
        recast = source.change(self.raw, overrides, self.origins, found)
        self._report(found)
        rooms.anchor(self.raw, Path.cwd())
        self._forget(recast, overrides)
        self.recast |= recast

    def _lay(self, layer: inherit.Layer) -> None:
        """Take in a file, over those that it is based on."""
        found: list[source.Fault] = []
        own: dict[str, Origin] = {}
        tables = source.stripped(layer.raw, own, found)
        rooms.anchor(tables, layer.path.parent)
        self._report(found, layer)
        if not self.raw:
            self.raw.update(tables)
            self.origins |= own
            return
        for key in inherit.OWN:
            self.raw.pop(key, None)
        if isinstance(plant := tables.get("plant"), str):
            self._replant(plant, layer)
        recast: dict[str, tuple[str, Any]] = {}
        self._report(inherit.lay(tables, self.raw, self.origins, own, recast), layer)
        self._forget(recast, layer.lines, layer)
        self.recast = {} if "protocol" in tables else self.recast | recast

    def _replant(self, plant: str, layer: inherit.Layer) -> None:
        """Drop the tables of the plant before, if it was another one, but for what every plant has."""
        before = self.raw.get("plant")
        if plant == before or not isinstance(before, str) or not {plant, before} <= PLANTS.keys():
            return
        try:
            kept = faults.shared(*(PLANTS[one].Parameters for one in (plant, before)))
        except PartError:
            return  # a fault, told later
        gone = [key for key in self.raw if key not in {*OWN, *kept}]
        for key in gone:
            del self.raw[key]
            source.forget(self.origins, key)
        self.notes.append(f"plant = {plant}: dropped {', '.join(gone)} of {before} ({layer.place('plant')})")

    def scene(self, name: str) -> Scene | None:
        """The scene, or None where there are faults."""
        raw = self.raw
        clock = self._section(Clock, "clock", raw.get("clock", {}))
        seed = self._seed(raw.get("seed", 0))
        plant, parameters = self._plant()
        sensors = self._named("sensors", SENSORS)
        controllers = self._named("controllers", CONTROLLERS)
        frame_ns = int(clock.frame) if clock is not None else 1_000_000
        assembly = self._assembled(parameters, frame_ns) if parameters is not None else None
        told = UNKNOWN
        if assembly is not None and parameters is not None and None not in [*sensors.values(), *controllers.values()]:
            told = known(assembly, parameters, sensors, controllers)
        sensors = {n: s for n, s in sensors.items() if s is not None}
        controllers = {n: c for n, c in controllers.items() if c is not None}
        self._leave_out(told)
        protocol = self._protocol(told)
        limits = self._limits(assembly)
        if clock is not None:
            self._report(checks.periods(clock, controllers, raw))
            self._report(checks.steps(clock, common_step(clock.frame, (s.instants for s in sensors.values())), raw))
            self._report(checks.lengths(clock, protocol, raw.get("protocol")))
            self._report(checks.whole(protocol))
        if assembly is not None:
            self._report(checks.readings(sensors, assembly.outputs, plant))
        if told.whole:
            self._report(checks.wiring(controllers, sensors, told.inputs, plant))
            self._report(checks.hands_off(protocol, controllers))
            ramped = {step.target: "ramped" for step in flat(protocol) if isinstance(step, Load | Ramp)}
            if parameters is not None and assembly is not None:
                inputs = assembled(parameters, frame_ns, ramped).inputs if ramped else assembly.inputs
                self._report(checks.commanded(protocol, inputs))
        title, about = self._text("title", name), self._text("about", "").strip()
        if self.faults or clock is None or parameters is None:
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
            protocol=protocol,
            limits=limits,
            seed=seed,
            origins=self.origins,
            notes=tuple(self.notes),
            places=self.places,
        )

    def _forget(
        self, recast: Mapping[str, tuple[str, Any]], keys: Iterable[str], layer: inherit.Layer | None = None
    ) -> None:
        """Drop the values of a table that were those of another kind, but for what every such kind has.

        `keys`: what is given with the change of kind, by the file `layer` or by changes with -p.
        """
        for table, (tag, before) in recast.items():
            values = source.at(self.raw, table.split("."))
            now, kinds = (values or {}).get(tag), self._kinds(table, tag)
            if values is None or not isinstance(now, str) or now not in kinds:
                continue  # a fault, told later
            try:
                known = isinstance(before, str) and before in kinds
                common = faults.shared(kinds[before], kinds[now]) if known else set()
            except PartError:
                continue  # a fault, told later
            head = f"{table}."
            given = {key.removeprefix(head).partition(".")[0] for key in keys if key.startswith(head)}
            gone = [key for key in values if key != tag and key not in given | common]
            kept = [key for key in values if key in common - given]
            for key in gone:
                del values[key]
                source.forget(self.origins, f"{head}{key}")
            if gone:
                told = f"{head}{tag} = {now}: dropped {', '.join(gone)} of {before}"
                told += f"; kept {', '.join(kept)}" if kept else ""
                self.notes.append(f"{told} ({layer.place(f'{head}{tag}')})" if layer else told)

    def _kinds(self, table: str, tag: str) -> Mapping[str, Any]:
        """What the kinds of a table are, by name."""
        room, *path = table.split(".")
        if room == "sensors":
            return SENSORS
        if room == "controllers":
            return CONTROLLERS
        plant = self.raw.get("plant")
        try:
            model = PLANTS[plant].Parameters if isinstance(plant, str) and plant in PLANTS else None
        except PartError:
            return {}  # a fault, told later
        return faults.members(faults.inner(model, (room, *path)), tag)

    def _leave_out(self, told: Known) -> None:
        """Steps of the protocol that set what a table of another kind has no more become marks that say so."""
        if not told.whole or not self.recast:
            return

        def look(steps: Any, key: str) -> None:
            for i, step in enumerate(steps if isinstance(steps, list) else (), 1):
                if not isinstance(step, dict):
                    continue
                here, target = f"{key}[{i}]", step.get("target")
                if isinstance(target, str) and target not in told.inputs and target not in told.settable:
                    if any(target.startswith(f"{table}.") for table in self.recast):
                        steps[i - 1] = {"step": "mark", "text": f"left out: {step.get('step')} {target}"}
                        source.forget(self.origins, here)
                        self.notes.append(f"{here}: left out, there is no {target} any more")
                look(step.get("steps"), f"{here}.steps")

        look(self.raw.get("protocol"), "protocol")

    def _report(self, found: Iterable[source.Fault], layer: inherit.Layer | None = None) -> None:
        """Take up faults, each with the place of its value; `layer`: the file that they are of."""
        for key, line in found:
            if len(self.faults) > MOST:  # more than a reader looks through, and each takes time to be put into words
                return
            place = layer.place(key) if layer else self.places.near(key)
            told = f"{line} ({place})" if place else line
            if told not in self.faults:
                self.faults.append(told)

    def _fault(self, key: str, line: str) -> None:
        self._report([(key, line)])

    def _section(self, model: type[S], prefix: str, raw: Any) -> S | None:
        """`raw` as a section; None after reporting what is wrong."""
        try:
            return model.model_validate(raw)
        except ValidationError as error:
            self._report(faults.lines(error, model, raw, prefix))
            return None
        except Exception as error:  # of a validator in a file
            if not (told := blamed(error)):
                raise
            self.faults.append(told)
            return None

    def _plant(self) -> tuple[str, Section | None]:
        plant = self.raw.get("plant")
        if plant is None:
            self._fault("plant", f"plant: is missing; known: {', '.join(sorted(PLANTS))}")
            return "", None
        if not isinstance(plant, str) or plant not in PLANTS:
            self._fault("plant", faults.unknown_choice("plant", plant, PLANTS))
            return str(plant), None
        try:
            model = PLANTS[plant].Parameters
        except PartError as error:
            self._fault("plant", f"plant: {error}")
            return plant, None
        tables = {key: value for key, value in self.raw.items() if key not in OWN}
        effects = {key: self._effect(key, name) for key, name in rooms.effects_in(tables, model).items()}
        known = {key: found for key, found in effects.items() if found is not None}
        for key in known:
            tables[key] = tables[key] | {rooms.EFFECT: rooms.name_of(tables[key][rooms.EFFECT])}
        model = rooms.with_effects(model, known)
        unknown = [key for key in tables if key not in model.model_fields]
        self._report(
            (key, faults.unknown_key(key, [*OWN, *model.model_fields])) for key in unknown if key not in effects
        )
        for key in unknown:
            del tables[key]
        found = self._section(model, "", tables)
        return rooms.name_of(plant), found if len(known) == len(effects) else None

    def _effect(self, key: str, name: Any) -> Any:
        """The section of an effect that the plant does not know; None after reporting what is wrong."""
        here = f"{key}.{rooms.EFFECT}"
        if not _NAME.fullmatch(key) or hasattr(Section, key):
            self._fault(key, f"{key}: no effect can have this name; it is letters, digits and _, as in [wobble]")
        elif not isinstance(name, str) or name not in EFFECTS:
            told = ", ".join(EFFECTS.installed) or "none"
            line = f"{here} = {faults.shown(name)}: unknown; expected a file (./NAME.py); installed: {told}"
            self._fault(here, line)
        else:
            try:
                return EFFECTS[name]
            except PartError as error:
                self._fault(here, f"{here}: {error}")
        return None

    def _assembled(self, parameters: Section, frame_ns: int) -> Any:
        """The rig; None after reporting a plant or an effect from a file that fails."""
        try:
            return assembled(parameters, frame_ns)
        except PartError as error:
            self.faults.append(str(error))
        except RigError:
            raise
        except Exception as error:
            if not (told := blamed(error)):
                raise
            self.faults.append(told)
        return None

    def _text(self, key: str, default: str) -> str:
        text = self.raw.get(key, default)
        if not isinstance(text, str):
            self._fault(key, f"{key} = {faults.shown(text)}: expected a text")
            return ""
        return text

    def _seed(self, seed: Any) -> int:
        if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
            self._fault("seed", f"seed = {faults.shown(seed)}: expected a whole number, at least 0")
            return 0
        return seed

    def _named(self, room: str, kinds: Mapping[str, type[Any]]) -> dict[str, Any]:
        """The sensors or controllers; None for one that has faults."""
        tables = self.raw.get(room, {})
        if not isinstance(tables, dict):
            self._fault(room, f"{room} = {faults.shown(tables)}: expected tables [{room}.NAME]")
            return {}
        if len(tables) > PARTS:
            self._fault(room, f"{room}: there are {len(tables)}; at most {PARTS} are possible")
            return {}
        return {name: self._one(f"{room}.{name}", name, raw, kinds) for name, raw in tables.items()}

    def _one(self, key: str, name: str, raw: Any, kinds: Mapping[str, type[Any]]) -> Any:
        if not _NAME.fullmatch(name):
            self._fault(key, f"{key}: a name is letters, digits and _, and begins with a letter")
            return None
        if not isinstance(raw, dict):
            self._fault(key, f"{key} = {faults.shown(raw)}: expected a table with kind = ...")
            return None
        if "kind" not in raw:
            self._fault(f"{key}.kind", f"{key}.kind: is missing; known: {', '.join(sorted(kinds))}")
            return None
        if not isinstance(raw["kind"], str) or raw["kind"] not in kinds:
            self._fault(f"{key}.kind", faults.unknown_choice(f"{key}.kind", raw["kind"], kinds))
            return None
        try:
            model = kinds[raw["kind"]]
        except PartError as error:
            self._fault(f"{key}.kind", f"{key}.kind: {error}")
            return None
        kind = rooms.name_of(raw["kind"])
        section = self._section(model, key, raw | {"kind": kind})
        if section is None or (code := code_of(model)) is None:
            return section
        if self._codes.setdefault((key.partition(".")[0], kind), code) != code:
            self._fault(f"{key}.kind", f"{key}.kind: the scene names another file that is called {kind}; rename one")
        wrong = list(checks.foreign(key, section))
        self._report(wrong)
        return None if wrong else section

    def _protocol(self, told: Known) -> tuple[Step, ...]:
        raw = self.raw.get("protocol", [])
        try:
            return STEPS.validate_python(raw, context=told)
        except ValidationError as error:
            self._report(faults.lines(error, tuple[Step, ...], raw, "protocol"))
        return tuple(self._step(entry, told) for entry in raw) if isinstance(raw, list) else ()

    def _step(self, raw: Any, told: Known) -> Step:
        """One step of a protocol that has faults; a blank one in place of a faulty one."""
        try:
            return STEP.validate_python(raw, context=told)
        except ValidationError:
            return Mark(step="mark", text="")

    def _limits(self, assembly: Any) -> dict[str, float]:
        """Outputs beyond which the run is aborted to a safe state."""
        raw = self.raw.get("limits", {})
        if not isinstance(raw, dict):
            self._fault("limits", f"limits = {faults.shown(raw)}: expected a table of outputs")
            return {}
        if assembly is None:
            return {}
        limits = {}
        for name, given in raw.items():
            key = f"limits.{name}"
            if name not in assembly.outputs:
                self._fault(key, f"{key}: this rig has no such output; {faults.near(name, assembly.outputs)}")
                continue
            unit = assembly.outputs[name].unit
            try:
                limits[name] = finite(given, unit, Gt(0.0))
            except ValueError as error:
                self._fault(key, f"{key} = {faults.shown(given)}: {faults.reworded(str(error), given)}")
        return limits
