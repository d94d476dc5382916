"""A scene as the rig runs it: checked, in SI, every value with its origin; and the same as JSON, for recordings."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import ValidationError

from rig import controllers
from rig.controllers import controller_drives
from rig.effects import knock
from rig.errors import SceneError
from rig.parts import Parts, trust_scene
from rig.quantities import Section, faults_of
from rig.results import Column, Result, Table
from rig.scenes import part_faults, rooms, sections
from rig.scenes.faults import shown
from rig.scenes.network import Link, Network
from rig.scenes.places import Origin, Place
from rig.scenes.protocol import STEPS, Clock, Step, flat, knock_durations, moves, targets
from rig.scenes.source import FORMAT
from rig.sensors.chain.instants import common_step
from rig.structure import model_store
from rig.structure.stated import Stated

if TYPE_CHECKING:
    from rig.bus.impaired_link import ImpairedLink
    from rig.model.assembly import Assembly
    from rig.scenes.inherit import Places


@dataclass(frozen=True)
class Scene(Result):
    """A plant with its effects, sensors, controllers and protocol. Made by `rig.scenes.load` or `Scene.from_json`."""

    FIGURE: ClassVar = "rig.view.friction_figure:scene_figure"

    name: str
    title: str
    about: str
    plant: str
    parameters: Section
    clock: Clock
    sensors: dict[str, Any]
    controllers: dict[str, Any]
    protocol: tuple[Step, ...]
    limits: dict[str, float]
    seed: int
    origins: dict[str, Origin] = field(default_factory=dict)
    notes: tuple[str, ...] = field(default=(), compare=False)
    """What its user must know of how it was read, a line each: values that were left aside because a change made
    another kind of something, keys that were renamed."""
    places: Places | None = field(default=None, compare=False, repr=False)
    """File and line of each value; None for a scene that was not read from files."""
    models: dict[str, str] = field(default_factory=dict, compare=False)
    """Of a scene that a run was made with: the reduced models of its structures, what they are of -> digest."""
    network: Network = field(default_factory=Network)
    faults: dict[str, part_faults.PartFault] = field(default_factory=dict)
    driven: frozenset[str] = frozenset()
    """Actuators that somebody else drives: an operator, or a controller that the scene does not know. Not recorded with
    the scene: the events of the run tell it."""
    believed: dict[str, Any] = field(default_factory=dict)
    """What its controllers believe where the rig is another one: dotted key of the rig or of a sensor -> value in SI
    (rig.scenes.belief)."""
    redesign: bool = False
    """Whether controllers are told of every value that is varied: they are designed anew for each rig."""

    @property
    def frame_ns(self) -> int:
        """Loop period [ns]."""
        return int(self.clock.frame)

    @cached_property
    def step_ns(self) -> int:
        """Sample step of the integrator [ns]: it meets every frame, and samples of which a whole number is in one."""
        return common_step(self.frame_ns, (s.instants for s in self.sensors.values()))

    @cached_property
    def duration_ns(self) -> int | None:
        """Longest time the protocol takes [ns]; None without a protocol, or with one that never ends."""
        return sections.longest_ns(self.protocol) if self.protocol else None

    @cached_property
    def moved(self) -> dict[str, str]:
        """Actuators that are moved: "held" commands (steps from tick to tick), or "ramped" as well."""
        held = set(self.driven)
        ramped = set[str]()
        for section in self.controllers.values():
            held.update(controller_drives(section))
        for fault in self.faults.values():
            if isinstance(fault, part_faults.ActuatorFault):
                held.add(fault.actuator)
        for step in flat(self.protocol):
            held.update(targets(step))
            if moves(step):
                ramped.update(targets(step))
        if not held:
            return {}
        with model_store.using(self.models):
            inputs = rooms.assembled(self.parameters, self.frame_ns).inputs
        return {name: "ramped" if name in ramped else "held" for name in sorted(held) if name in inputs}

    @cached_property
    def knocks(self) -> tuple[int, ...]:
        """Durations [ns] of the knocks that take time, in ascending order."""
        return knock_durations(self.protocol)

    def links(self, room: str, seed: int | None = None) -> dict[str, ImpairedLink]:
        """The impaired links as at the start of a run: sensor (room "meas") or controller ("act") -> link.

        `seed`: of the run, by default the scene's own; the network may have another one.
        """
        seed = self.seed if seed is None else seed
        seed = seed if self.network.seed is None else self.network.seed
        links: dict[str, Link] = getattr(self.network, room)
        return {name: link.made(f"{room}/{name}", seed, self.frame_ns) for name, link in links.items()}

    @cached_property
    def designed_for(self) -> Scene:
        """The scene for which its controllers are designed: this one, with what they believe of the rig."""
        return replace(self, believed={}).with_values(self.believed) if self.believed else self

    def with_values(self, values: Mapping[str, Any], seed: int | None = None) -> Scene:
        """The same scene with values (SI, or texts with units) of dotted keys of the rig and its parts, and a seed.

        Raises SceneError if it refuses one.
        """
        changes: dict[str, Any] = {} if seed is None else {"seed": seed}
        by_part: dict[tuple[str, str], dict[str, Any]] = {}
        for key, value in values.items():
            room, name, field = sections.parted(key)
            by_part.setdefault((room, name), {})[field] = value
        for (room, name), given in by_part.items():
            if not room:
                changes["parameters"] = sections.with_values(self.parameters, given)
            else:
                parts = changes.setdefault(room, dict(getattr(self, room)))
                if name not in parts:
                    raise SceneError(self.name, [f"{room}.{name}: the scene has none of this name"])
                parts[name] = sections.with_values(parts[name], given)
        return replace(self, **changes)

    @property
    def in_plant(self) -> frozenset[str]:
        """Controllers that work in the plant's process; the others are processes of their own."""
        return frozenset(name for name, section in self.controllers.items() if section.where == "plant")

    @property
    def slow(self) -> str:
        """Why the scene cannot keep up with the clock at every pace; "" if nothing says so."""
        if self.clock.pace_limit is None:
            return ""
        note = self.origins.get("clock.pace_limit", Origin("")).note
        reason = f" ({note})" if note else ""
        return f"its pace is at most {self.clock.pace_limit:g}{reason}"

    def assemble(self, parameters: Section | None = None) -> Assembly:
        """The rig of this scene (`rig.model.assembly.Assembly`), with the signals that its actuators need and without
        outputs on request that nothing asks for.

        `parameters`: others than the scene's own, as after a change while the rig runs.
        """
        with model_store.using(self.models):
            made = rooms.assembled(parameters or self.parameters, self.frame_ns, self.moved, limits=self.limits)
        knock.add(made, self.knocks)
        asked = {section.reads for section in self.sensors.values()} | self.limits.keys()
        made.outputs = {name: output for name, output in made.outputs.items() if not output.on_request or name in asked}
        return made

    @property
    def stated(self) -> Stated | None:
        """What its meshed structure states of mass, contacts and bodies; None for other rigs.

        Raises SceneError if the files of the structure cannot be read.
        """
        with model_store.using(self.models):
            return getattr(self.parameters, "stated", None)

    @property
    def bases(self) -> tuple[str, ...]:
        """The files that the scene is based on, the nearest first."""
        return self.places.files[-2::-1] if self.places else ()

    def place(self, key: str) -> Place | None:
        """File and line that give a value; None for a default, and for a scene that was not read from files."""
        return self.places.of(key) if self.places else None

    def sections(self) -> Iterator[tuple[str, Section]]:
        """The sections of the scene after their prefix in dotted keys; the parameters of the plant have none."""
        yield "", self.parameters
        yield "clock", self.clock
        for room in ("sensors", "controllers"):
            for name, section in getattr(self, room).items():
                yield f"{room}.{name}", section
        yield "network", self.network
        for name, fault in self.faults.items():
            yield f"faults.{name}", fault

    def values(self) -> dict[str, tuple[Any, str]]:
        """Every value of the scene: dotted key -> (value in SI, unit), defaults included, tables left out absent."""
        values: dict[str, tuple[Any, str]] = {}
        for prefix, section in self.sections():
            values.update(sections.values_of(section, prefix))
        return values

    def shown(self) -> Iterator[str | Table]:
        """Yield every value with its unit and origin."""
        rows = []
        for key, (value, unit) in self.values().items():
            shown = f"{value:.6g}" if isinstance(value, float) else f"{value!s:.60}"
            origin = self.origins[key].origin if key in self.origins else "default"
            rows.append((key, shown, unit, origin))
        yield f"{self.name}: {self.title}\n"
        yield Table("values", [*map(Column, ("key", "value (SI)", "unit", "origin"))], rows)

    def to_json(self) -> str:  # type: ignore[override]
        """The scene as JSON text; `from_json` gives an equal scene back."""
        parts = rooms.foreign(self.plant, self.parameters, self.sensors.values(), self.controllers.values())
        content: dict[str, Any] = {
            "format": 1 + FORMAT,
            "name": self.name,
            "title": self.title,
            "about": self.about,
            "plant": self.plant,
            "seed": self.seed,
            "clock": sections.dump(self.clock),
            "parameters": sections.dump(self.parameters),
            "sensors": _dumped(self.sensors),
            "controllers": _dumped(self.controllers),
            "protocol": [sections.dump(step) for step in self.protocol],
            "limits": self.limits,
            "origins": {key: list(origin) for key, origin in self.origins.items()},
        }
        if self.models:
            content["models"] = self.models
        if parts:
            content["parts"] = parts
        if self.network:
            content["network"] = sections.dump(self.network)
        if self.faults:
            content["faults"] = _dumped(self.faults)
        if self.believed:
            content["believed"] = self.believed
        if self.redesign:
            content["redesign"] = True
        return json.dumps(content, ensure_ascii=False)

    def __reduce__(self) -> tuple[Any, ...]:
        return _of_own_process, (self.to_json(),)

    @classmethod
    def from_json(cls, text: str, where: str = "the recorded scene") -> Scene:
        """The scene of `to_json`. What was once a checked scene is only read again, not judged again.

        The format of the text is one above that of scene files of its time, and 1 or 2 when that was 1: in format 1 an
        ideal instrument listed flaws that it did not have. `where`: what is named if it cannot be read.

        Raises SceneError for a format of a newer version and for a text that is no scene of this version, Untrusted and
        PartError for the parts that it contains.
        """
        try:
            return cls._read(json.loads(text))
        except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
            head = "is damaged, or of another version of friction-rig"
            raise SceneError(where, [head, *_faults(error)]) from error

    @classmethod
    def _read(cls, raw: dict[str, Any]) -> Scene:
        written = raw.get("format", 1)
        if isinstance(written, bool) or not isinstance(written, int) or written < 1:
            raise ValueError(f"format = {shown(written)}: expected a whole number, at least 1")
        since = max(1, written - 1)
        if since > FORMAT:
            reason = f"recorded by a newer version, whose scene files have format {since}; this one reads format"
            raise SceneError(raw["name"], [f"{reason} {FORMAT}; install a newer version of friction-rig"])
        parts = rooms.foreign_parts(raw)
        model = rooms.parameters_of(raw["plant"], raw["parameters"], parts)
        return cls(
            name=raw["name"],
            title=raw["title"],
            about=raw["about"],
            plant=raw["plant"],
            parameters=model.model_validate(raw["parameters"]),
            clock=Clock.model_validate(raw["clock"]),
            sensors={name: _instrument(section, written, parts) for name, section in raw["sensors"].items()},
            controllers={name: _controller(section, parts) for name, section in raw["controllers"].items()},
            protocol=STEPS.validate_python(raw["protocol"]),
            network=Network.model_validate(raw.get("network", {})),
            faults=part_faults.PART_FAULTS.validate_python(raw.get("faults", {})),
            limits={name: float(value) for name, value in raw["limits"].items()},
            seed=raw["seed"],
            origins={key: Origin(*origin) for key, origin in raw["origins"].items()},
            models=raw.get("models", {}),
            believed=dict(raw.get("believed", {})),
            redesign=bool(raw.get("redesign", False)),
        )

    def made_with(self, models: Mapping[str, bytes]) -> Scene:
        """The scene of a run: it names the models (what they are of -> bytes) that the run was made with."""
        return replace(self, models={of: model_store.digest(content) for of, content in models.items()})

    @cached_property
    def digest(self) -> str:
        """Hash (16 hex digits) of everything that the run depends on: titles and origins left out."""
        raw = json.loads(self.to_json())
        kept = {key: raw[key] for key in raw.keys() - {"format", "name", "title", "about", "origins", "models"}}
        return hashlib.sha256(json.dumps(kept, sort_keys=True).encode()).hexdigest()[:16]


def _dumped(by_name: Mapping[str, Section]) -> dict[str, Any]:
    """Sections by name as plain values."""
    return {name: sections.dump(section) for name, section in by_name.items()}


def _of_own_process(text: str) -> Scene:
    """A scene that another process of the same work has pickled, with the parts that this one trusts."""
    trust_scene(text)
    return Scene.from_json(text)


def _faults(error: Exception) -> Iterator[str]:
    """What is wrong with the text of a recorded scene, one line each."""
    if isinstance(error, ValidationError):
        for key, fault, _ in faults_of(error):
            yield f"{key}: {fault}" if key else fault
    elif isinstance(error, KeyError):
        yield f"{error.args[0]!r} is missing, or not known to this version"
    else:
        yield str(error)


def _controller(raw: dict[str, Any], parts: Parts) -> Any:
    """The section of a controller from the JSON text of a scene with the parts `parts`."""
    return controllers.recorded_class(raw, parts).model_validate(raw)


def _instrument(raw: dict[str, Any], written: int, parts: Parts) -> Any:
    """An instrument from the JSON text of a scene of format `written` with the parts `parts`."""
    kind = rooms.SENSORS.get_from(raw["kind"], parts)
    if written < 2 and raw["ideal"]:
        raw = {key: value for key, value in raw.items() if key not in kind.perfect and key not in kind.part_of}
    return kind.model_validate(raw)
