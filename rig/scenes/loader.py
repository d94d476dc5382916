"""Load a scene: by name or path, with changes, checked as a whole; every fault is found before any is reported."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

from annotated_types import Gt
from pydantic import ValidationError

from controllers import KINDS as CONTROLLERS
from rig.errors import SceneError
from rig.plants import PLANTS
from rig.quantities import Section, finite
from rig.scenes import checks, faults, source
from rig.scenes.protocol import UNKNOWN, Known, Load, Mark, Ramp, Step, flat
from rig.scenes.scene import STEP, STEPS, Clock, Origin, Scene, assembled, known, plant_module
from rig.scenes.shelf import path as path_of
from sensors import KINDS as SENSORS
from sensors.chain.instants import common_step

S = TypeVar("S", bound=Section)
MOST = 100
"""Faults that are told."""
PARTS = 100
"""Sensors, and controllers, that a scene may have."""
OWN = ("title", "plant", "about", "seed", "clock", "sensors", "controllers", "protocol", "limits")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


def load(name_or_path: str | Path, overrides: Mapping[str, object] | None = None) -> Scene:
    """The scene of a shipped name or of a file, with `overrides` (dotted key -> value, text with unit or number).

    Raises SceneError with every fault: dotted key, what was given, what is allowed.
    """
    path = path_of(name_or_path)
    reading = _Reading(source.tree(path), overrides or {})
    scene = reading.scene(path.stem)
    if scene is None:
        told = reading.faults[:MOST]
        more = ["and more"] if len(reading.faults) > MOST else []
        raise SceneError(str(name_or_path), [*told, *more, *reading.dropped])
    return scene


class _Reading:
    """One pass over a scene; `faults` collects a line for everything that is wrong."""

    def __init__(self, raw: dict[str, Any], overrides: Mapping[str, object]) -> None:
        self.faults: list[str] = []
        self.origins: dict[str, Origin] = {}
        self.raw: dict[str, Any] = source.stripped(raw, self.origins, self.faults)
        self.overrides = overrides
        self.dropped: list[str] = []
        self.recast = source.change(self.raw, overrides, self.origins, self.faults)

    def scene(self, name: str) -> Scene | None:
        """The scene, or None where there are faults."""
        raw = self.raw
        self._forget()
        clock = self._section(Clock, "clock", raw.get("clock", {}))
        seed = self._seed(raw.get("seed", 0))
        plant, parameters = self._plant()
        sensors = self._named("sensors", SENSORS)
        controllers = self._named("controllers", {kind: section for kind, (section, _) in CONTROLLERS.items()})
        frame_ns = int(clock.frame) if clock is not None else 1_000_000
        assembly = assembled(plant, parameters, frame_ns) if parameters is not None else None
        told = UNKNOWN
        if parameters is not None and None not in [*sensors.values(), *controllers.values()]:
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
                inputs = assembled(plant, parameters, frame_ns, ramped).inputs if ramped else assembly.inputs
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
            dropped=tuple(self.dropped),
        )

    def _forget(self) -> None:
        """Drop the values of a table that were those of another kind, but for what every such kind has."""
        for table, (tag, before) in self.recast.items():
            values = source.at(self.raw, table.split("."))
            now, kinds = (values or {}).get(tag), self._kinds(table, tag)
            if values is None or not isinstance(now, str) or now not in kinds:
                continue  # a fault, told later
            known = isinstance(before, str) and before in kinds
            common = faults.shared(kinds[before], kinds[now]) if known else set()
            given = {key.removeprefix(f"{table}.").partition(".")[0] for key in self.overrides}
            gone = [key for key in values if key != tag and key not in given | common]
            kept = [key for key in values if key in common - given]
            for key in gone:
                del values[key]
                source.forget(self.origins, f"{table}.{key}")
            if gone:
                told = f"{table}.{tag} = {now}: dropped {', '.join(gone)} of {before}"
                self.dropped.append(told + (f"; kept {', '.join(kept)}" if kept else ""))

    def _kinds(self, table: str, tag: str) -> Mapping[str, Any]:
        """What the kinds of a table are, by name."""
        room, *path = table.split(".")
        if room == "sensors":
            return SENSORS
        if room == "controllers":
            return {kind: section for kind, (section, _) in CONTROLLERS.items()}
        plant = self.raw.get("plant")
        model = plant_module(plant).Parameters if isinstance(plant, str) and plant in PLANTS else None
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
                        self.dropped.append(f"{here}: left out, there is no {target} any more")
                look(step.get("steps"), f"{here}.steps")

        look(self.raw.get("protocol"), "protocol")

    def _report(self, found: Iterator[tuple[str, str]]) -> None:
        for _, line in found:
            if len(self.faults) > MOST:  # more than a reader looks through, and each takes time to be put into words
                return
            if line not in self.faults:
                self.faults.append(line)

    def _section(self, model: type[S], prefix: str, raw: Any) -> S | None:
        """`raw` as a section; None after reporting what is wrong."""
        try:
            return model.model_validate(raw)
        except ValidationError as error:
            self._report(faults.lines(error, model, raw, prefix))
            return None

    def _plant(self) -> tuple[str, Section | None]:
        plant = self.raw.get("plant")
        if plant is None:
            self.faults.append(f"plant: is missing; known: {', '.join(sorted(PLANTS))}")
            return "", None
        if not isinstance(plant, str) or plant not in PLANTS:
            self.faults.append(faults.unknown_choice("plant", plant, PLANTS))
            return str(plant), None
        model = plant_module(plant).Parameters
        tables = {key: value for key, value in self.raw.items() if key not in OWN}
        unknown = [key for key in tables if key not in model.model_fields]
        self._report((key, faults.unknown_key(key, [*OWN, *model.model_fields])) for key in unknown)
        for key in unknown:
            del tables[key]
        return plant, self._section(model, "", tables)

    def _text(self, key: str, default: str) -> str:
        text = self.raw.get(key, default)
        if not isinstance(text, str):
            self.faults.append(f"{key} = {faults.shown(text)}: expected a text")
            return ""
        return text

    def _seed(self, seed: Any) -> int:
        if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
            self.faults.append(f"seed = {faults.shown(seed)}: expected a whole number, at least 0")
            return 0
        return seed

    def _named(self, room: str, kinds: Mapping[str, type[Any]]) -> dict[str, Any]:
        """The sensors or controllers; None for one that has faults."""
        tables = self.raw.get(room, {})
        if not isinstance(tables, dict):
            self.faults.append(f"{room} = {faults.shown(tables)}: expected tables [{room}.NAME]")
            return {}
        if len(tables) > PARTS:
            self.faults.append(f"{room}: there are {len(tables)}; at most {PARTS} are possible")
            return {}
        return {name: self._one(f"{room}.{name}", name, raw, kinds) for name, raw in tables.items()}

    def _one(self, key: str, name: str, raw: Any, kinds: Mapping[str, type[Any]]) -> Any:
        if not _NAME.fullmatch(name):
            self.faults.append(f"{key}: a name is letters, digits and _, and begins with a letter")
            return None
        if not isinstance(raw, dict):
            self.faults.append(f"{key} = {faults.shown(raw)}: expected a table with kind = ...")
            return None
        if "kind" not in raw:
            self.faults.append(f"{key}.kind: is missing; known: {', '.join(sorted(kinds))}")
            return None
        if not isinstance(raw["kind"], str) or raw["kind"] not in kinds:
            self.faults.append(faults.unknown_choice(f"{key}.kind", raw["kind"], kinds))
            return None
        return self._section(kinds[raw["kind"]], key, raw)

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
            self.faults.append(f"limits = {faults.shown(raw)}: expected a table of outputs")
            return {}
        if assembly is None:
            return {}
        limits = {}
        for name, given in raw.items():
            key = f"limits.{name}"
            if name not in assembly.outputs:
                self.faults.append(f"{key}: this rig has no such output; {faults.near(name, assembly.outputs)}")
                continue
            unit = assembly.outputs[name].unit
            try:
                limits[name] = finite(given, unit, Gt(0.0))
            except ValueError as error:
                self.faults.append(f"{key} = {faults.shown(given)}: {faults.reworded(str(error), given)}")
        return limits
