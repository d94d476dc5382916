"""Load a scene: by name or path, with changes, checked as a whole; every fault is found before any is reported."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from math import gcd
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
from rig.scenes.scene import STEP, STEPS, Clock, Origin, Scene, known, plant_module
from rig.scenes.shelf import path as path_of
from sensors import KINDS as SENSORS

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
        raise SceneError(str(name_or_path), [*told, "and more"] if len(reading.faults) > MOST else told)
    return scene


class _Reading:
    """One pass over a scene; `faults` collects a line for everything that is wrong."""

    def __init__(self, raw: dict[str, Any], overrides: Mapping[str, object]) -> None:
        self.faults: list[str] = []
        self.origins: dict[str, Origin] = {}
        self.raw: dict[str, Any] = source.stripped(raw, self.origins, self.faults)
        self.overrides = overrides
        self.recast = source.change(self.raw, overrides, self.origins, self.faults)

    def scene(self, name: str) -> Scene | None:
        """The scene, or None where there are faults."""
        raw = self.raw
        clock = self._section(Clock, "clock", raw.get("clock", {}))
        seed = self._seed(raw.get("seed", 0))
        plant, parameters = self._plant()
        sensors = self._named("sensors", SENSORS)
        controllers = self._named("controllers", {kind: section for kind, (section, _) in CONTROLLERS.items()})
        assembly = plant_module(plant).assemble(parameters) if parameters is not None else None
        told = UNKNOWN
        if parameters is not None and None not in [*sensors.values(), *controllers.values()]:
            told = known(assembly, parameters, sensors, controllers)
        sensors = {n: s for n, s in sensors.items() if s is not None}
        controllers = {n: c for n, c in controllers.items() if c is not None}
        protocol = self._protocol(told)
        limits = self._limits(assembly)
        if clock is not None:
            self._report(checks.sampling(clock, sensors, raw))
            self._report(checks.periods(clock, controllers, raw))
            self._report(checks.steps(clock, gcd(clock.frame, *(s.period_ns for s in sensors.values())), raw))
            self._report(checks.lengths(clock, protocol, raw.get("protocol")))
            self._report(checks.whole(protocol))
        if assembly is not None:
            self._report(checks.readings(sensors, assembly.outputs, plant))
        if told.whole:
            self._report(checks.wiring(controllers, sensors, told.inputs, plant))
            self._report(checks.hands_off(protocol, controllers))
            ramped = {step.target: "ramped" for step in flat(protocol) if isinstance(step, Load | Ramp)}
            if parameters is not None and assembly is not None:
                inputs = plant_module(plant).assemble(parameters, ramped).inputs if ramped else assembly.inputs
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
        )

    def _report(self, found: Iterator[tuple[str, str]]) -> None:
        for _, line in found:
            if len(self.faults) > MOST:  # more than a reader looks through, and each takes time to be put into words
                return
            if line not in self.faults:
                self.faults.append(line)

    def _section(self, model: type[S], prefix: str, raw: Any) -> S | None:
        """`raw` as a section; None after reporting what is wrong. Keys of a law that was replaced are dropped."""
        try:
            return model.model_validate(raw)
        except ValidationError as error:
            found = list(faults.lines(error, model, raw, prefix))
        stale = [key for key, line in found if ": unknown key" in line and self._stale(key)]
        if stale:
            for key in stale:
                source.drop(self.raw, key)
                source.forget(self.origins, key)
            return self._section(model, prefix, raw)
        self._report(iter(found))
        return None

    def _stale(self, key: str) -> bool:
        return key.rpartition(".")[0] in self.recast and key not in self.overrides

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
