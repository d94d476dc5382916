"""A scene as the rig runs it: checked, in SI, every value with its origin; and the same as JSON, for recordings."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from annotated_types import Ge, Gt, Le
from pydantic import BaseModel, TypeAdapter, model_validator

from rig.controllers import made_by, wired
from rig.controllers.blocks.base import hears
from rig.errors import SceneError
from rig.parts import Parts
from rig.plants.structures import model_store
from rig.quantities import PositiveMetrePerSecond, Section, duration, quantity
from rig.scenes import migration, rooms
from rig.scenes.faults import unit_of
from rig.scenes.places import Origin, Place
from rig.scenes.protocol import Known, Load, Ramp, Set, Step, flat, longest_ns
from rig.sensors.chain.instants import common_step

if TYPE_CHECKING:
    from rig.scenes.inherit import Places

Count = Annotated[int, Gt(0), Le(1_000_000)]
Frame: Any = duration(1_000, 1_000_000_000)
FixedStep: Any = duration(10, 1_000_000_000)
Share: Any = quantity("1", Ge(0.0), Le(1.0))
Small: Any = quantity("1", Gt(0.0), Le(1e-2))
Large: Any = quantity("1", Gt(0.0))
STEP: TypeAdapter[Step] = TypeAdapter(Step)
STEPS: TypeAdapter[tuple[Step, ...]] = TypeAdapter(tuple[Step, ...])


class Clock(Section):
    """How time passes and how it is integrated.

    frame     loop period: commands in, measurements out [chosen]
    method    of integration [chosen]; auto is exact where the friction law allows, else dopri5
    tolerance   of dopri5, relative [chosen]
    rk4_step  of rk4 and kick [chosen]
    smoothing   slip speed over which smooth lets friction rise [chosen]
    overrun   what a paced run does when it is late [chosen]
    late_share_valid, late_share_degraded   share of frames late by more than one frame, for the timing verdict [chosen]
    pace_limit   largest pace (simulated over wall time) at which the scene keeps up with the clock; its note says why
    hold_frames   a command that does not come is held so long, then the actuator takes its safe value [chosen]
    events_per_frame   more events in one frame stop the run [chosen]
    limit     largest norm of the state; beyond, the run has diverged [chosen]
    """

    frame: Frame = 1_000_000
    method: Literal["auto", "exact", "dopri5", "rk4", "kick", "smooth"] = "auto"
    tolerance: Small = 1e-7
    rk4_step: FixedStep = 100_000
    smoothing: PositiveMetrePerSecond = 1e-3
    overrun: Literal["catch-up", "skip", "slow", "stop"] = "catch-up"
    late_share_valid: Share = 0.01
    late_share_degraded: Share = 0.05
    pace_limit: Large | None = None
    hold_frames: Count = 50
    events_per_frame: Count = 200
    limit: Large = 1e6
    unstable: Literal["refuse", "run"] = "refuse"

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.late_share_degraded < self.late_share_valid:
            raise ValueError("late_share_degraded is below late_share_valid")
        return self

    def substeps(self, step_ns: int) -> int:
        """Steps of rk4 or kick in `step_ns` [ns], none longer than `rk4_step`."""
        return max(1, -(-step_ns // int(self.rk4_step)))


@dataclass(frozen=True)
class Scene:
    """A plant with its effects, sensors, controllers and protocol. Made by `rig.scenes.load` or `Scene.from_json`."""

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
    driven: frozenset[str] = frozenset()
    """Actuators that somebody else drives: an operator, or a controller that the scene does not know. Not recorded with
    the scene: the events of the run tell it."""

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
        return longest_ns(self.protocol) if self.protocol else None

    @cached_property
    def moved(self) -> dict[str, str]:
        """Actuators that are moved: "held" commands (steps from tick to tick), or "ramped" as well."""
        held = set(self.driven)
        held |= {actuator for section in self.controllers.values() for actuator in controller_drives(section)}
        steps = tuple(flat(self.protocol))
        held |= {s.target for s in steps if isinstance(s, Load | Ramp | Set)}
        ramped = {s.target for s in steps if isinstance(s, Load | Ramp) and s.over}
        with model_store.given(self.models):
            inputs = rooms.assembled(self.parameters, self.frame_ns).inputs
        return {name: "ramped" if name in ramped else "held" for name in sorted(held) if name in inputs}

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
        return f"its pace is at most {self.clock.pace_limit:g}{f' ({note})' if note else ''}"

    def assemble(self, parameters: Section | None = None) -> Any:
        """The rig of this scene (`rig.model.assembly.Assembly`), with the signals that its actuators need.

        `parameters`: others than the scene's own, as after a change while the rig runs.
        """
        with model_store.given(self.models):
            return rooms.assembled(parameters or self.parameters, self.frame_ns, self.moved)

    @property
    def bases(self) -> tuple[str, ...]:
        """The files that the scene is based on, the nearest first."""
        return self.places.files[-2::-1] if self.places else ()

    def place(self, key: str) -> Place | None:
        """File and line that give a value; None for a default, and for a scene that was not read from files."""
        return self.places.of(key) if self.places else None

    def values(self) -> dict[str, tuple[Any, str]]:
        """Every value of the scene: dotted key -> (value in SI, unit), defaults included, tables left out absent."""
        found = dict(leaves(self.parameters))
        found |= leaves(self.clock, "clock")
        for name, section in self.sensors.items():
            found |= leaves(section, f"sensors.{name}")
        for name, section in self.controllers.items():
            found |= leaves(section, f"controllers.{name}")
        return found

    def to_json(self) -> str:
        """The scene as JSON text; `from_json` gives an equal scene back."""
        made: dict[str, Any] = {"models": self.models} if self.models else {}
        parts = rooms.foreign(self.plant, self.parameters, self.sensors.values(), self.controllers.values())
        made |= {"parts": parts} if parts else {}
        return json.dumps(
            {
                "format": 1 + migration.newest(),
                "name": self.name,
                "title": self.title,
                "about": self.about,
                "plant": self.plant,
                "seed": self.seed,
                "clock": dump(self.clock),
                "parameters": dump(self.parameters),
                "sensors": {name: dump(section) for name, section in self.sensors.items()},
                "controllers": {name: dump(section) for name, section in self.controllers.items()},
                "protocol": [dump(step) for step in self.protocol],
                "limits": self.limits,
                "origins": {key: list(origin) for key, origin in self.origins.items()},
                **made,
            },
            ensure_ascii=False,
        )

    @classmethod
    def from_json(cls, text: str) -> Scene:
        """The scene of `to_json`. What was once a checked scene is only read again, not judged again.

        The format of the text is one above that of scene files of its time, and 1 or 2 when that was 1: in format 1 an
        ideal instrument listed flaws that it did not have. Raises SceneError for a format of a newer version.
        """
        raw = json.loads(text)
        since = max(1, raw.get("format", 1) - 1)
        if since > migration.newest():
            told = f"recorded by a newer version, whose scene files have format {since}; this one reads format"
            raise SceneError(raw["name"], [f"{told} {migration.newest()}; install a newer version of friction-rig"])
        if since < migration.newest():
            raw = migration.recorded(raw, since)
        parts = rooms.given(raw)
        model = rooms.parameters_of(raw["plant"], raw["parameters"], parts)
        return cls(
            name=raw["name"],
            title=raw["title"],
            about=raw["about"],
            plant=raw["plant"],
            parameters=model.model_validate(raw["parameters"]),
            clock=Clock.model_validate(raw["clock"]),
            sensors={n: _instrument(s, raw.get("format", 1), parts) for n, s in raw["sensors"].items()},
            controllers={n: _controller(s, parts) for n, s in raw["controllers"].items()},
            protocol=STEPS.validate_python(raw["protocol"]),
            limits={name: float(value) for name, value in raw["limits"].items()},
            seed=raw["seed"],
            origins={key: Origin(*origin) for key, origin in raw["origins"].items()},
            models=raw.get("models", {}),
        )

    def made_with(self, models: Mapping[str, bytes]) -> Scene:
        """The scene of a run: it names the models (what they are of -> bytes) that the run was made with."""
        return replace(self, models={of: model_store.digest(content) for of, content in models.items()})

    @cached_property
    def digest(self) -> str:
        """Hash (16 hex digits) of everything that the run depends on: titles and origins left out."""
        raw = json.loads(self.to_json())
        told = {key: raw[key] for key in raw.keys() - {"format", "name", "title", "about", "origins", "models"}}
        return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:16]


def _controller(raw: dict[str, Any], parts: Parts) -> Any:
    return rooms.CONTROLLERS.get_from(raw["kind"], parts).model_validate(raw)


def _instrument(raw: dict[str, Any], written: int, parts: Parts) -> Any:
    """An instrument from the JSON text of a scene of format `written` that carries `parts`."""
    kind = rooms.SENSORS.get_from(raw["kind"], parts)
    if written < 2 and raw["ideal"]:
        raw = {key: value for key, value in raw.items() if key not in kind.perfect and key not in kind.part_of}
    return kind.model_validate(raw)


def dump(section: Section) -> dict[str, Any]:
    """A section as plain JSON values in SI."""
    return section.model_dump(mode="json", exclude_none=True)


def leaves(section: BaseModel, prefix: str = "") -> Iterator[tuple[str, tuple[Any, str]]]:
    """(dotted key, (value, unit)) of a section and the sections in it."""
    plain = section.model_dump(mode="json", exclude_none=True)
    for name, info in type(section).model_fields.items():
        value = getattr(section, name)
        key = f"{prefix}.{name}" if prefix else name
        if isinstance(value, BaseModel):
            yield from leaves(value, key)
        elif isinstance(value, dict):
            for entry, part in value.items():
                if isinstance(part, BaseModel):
                    yield from leaves(part, f"{key}.{entry}")
                else:
                    yield f"{key}.{entry}", (plain[name][entry], unit_of(info))
        elif value is not None and name in plain:  # not a flaw that an ideal instrument is free of
            yield key, (plain[name], unit_of(info))


def controller_reads(section: Section) -> dict[str, str]:
    """Key -> sensor, for the sensors that a controller's section, or else its class, names."""
    fields = [f for f in type(section).model_fields if f == "sensor" or f.endswith("_sensor")]
    if not fields:
        return {f"reads[{i}]": name for i, name in enumerate(wired(section, "reads"), 1)}
    return {name: getattr(section, name) for name in fields if getattr(section, name) is not None}


def heard(controllers: Mapping[str, Any]) -> set[str]:
    """Sensors of which some controller wants every sample."""
    hearing = [section for section in controllers.values() if hears(made_by(section))]
    return {sensor for section in hearing for sensor in controller_reads(section).values()}


def controller_drives(section: Any) -> tuple[str, ...]:
    """Actuators that a controller's section drives."""
    if "drive" in type(section).model_fields:
        return (section.drive,)
    return wired(section, "drives")


def known(assembly: Any, parameters: Section, sensors: Mapping[str, Any], controllers: Mapping[str, Any]) -> Known:
    """What a protocol of this rig may name."""
    settable = {k: unit for k, (v, unit) in leaves(parameters) if unit and not k.startswith("start.")}
    for name, section in controllers.items():
        fixed: frozenset[str] = getattr(section, "fixed", frozenset())
        values = leaves(section, f"controllers.{name}")
        settable |= {key: unit for key, (_, unit) in values if unit and key.rpartition(".")[2] not in fixed}
    return Known(
        inputs={name: i.unit for name, i in assembly.inputs.items()},
        settable=settable,
        sensors={name: s.unit for name, s in sensors.items()},
        controllers=frozenset(controllers),
    )
