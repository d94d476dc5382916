"""The description of a run that every process needs first; the plant sends it as answer to the query `scene`."""

from __future__ import annotations

import base64
import json
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from rig.bus.port import Session
from rig.errors import BusError
from rig.machine import scheduling


@dataclass(frozen=True)
class Setup:
    """The rig of a run, as built from its scene. Names have the order of `State` (outputs) and `Step` (sensors)."""

    run: str
    scene: str
    """The resolved scene as JSON text."""
    frame_ns: int
    step_ns: int
    outputs: dict[str, str]
    """Plant output -> unit."""
    sensors: dict[str, tuple[str, int]]
    """Sensor -> unit, sample period [ns]."""
    controllers: dict[str, Any] = field(default_factory=dict)
    """Controller -> settings and design values that its process needs."""
    provenance: dict[str, str] = field(default_factory=dict)
    paced: bool = False
    """Whether frames keep to the wall clock."""
    waits: bool = False
    """Whether each frame waits for the answers of the controllers."""
    core: int = scheduling.ANY
    """Processor core for the bus and the controllers."""
    models: tuple[bytes, ...] = ()
    """The reduced models to which the scene refers."""
    skipped: dict[str, Any] = field(default_factory=dict)
    """In a replay: controller -> data of its recorded events about steps that it did not answer. Not recorded."""

    def to_json(self) -> dict[str, Any]:
        """The setup as plain values for JSON; `from_json` reads them."""
        values = asdict(self) | {"models": [base64.b64encode(model).decode() for model in self.models]}
        for name in ("skipped", "waits"):
            if not values[name]:
                del values[name]
        return values

    @property
    def hold_frames(self) -> int | None:
        """Frames for which the last command of a controller is held; None of a scene that is damaged."""
        try:
            return int(json.loads(self.scene)["clock"]["hold_frames"])
        except (KeyError, TypeError, ValueError):
            return None

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> Setup:
        """The setup from the plain values of `to_json`."""
        sensors = {name: (unit, int(period)) for name, (unit, period) in values["sensors"].items()}
        models = tuple(base64.b64decode(model) for model in values.get("models", ()))
        return cls(**{**values, "sensors": sensors, "models": models})

    def to_text(self) -> str:
        """The setup as JSON text."""
        return json.dumps(self.to_json())


def fetch(session: Session, timeout: float = 10.0) -> Setup:
    """Query the plant for the setup of the session's run; wait at most `timeout` seconds until it can answer.

    From now on the session can decode the `state` messages of this scene. On another host than the plant's it takes the
    seat of its ticket. Raises BusError, also if another process has this seat.
    """
    try:
        setup = Setup.from_json(session.ask("scene", session.holds, timeout, patient=True))
        session.inbound.learn(list(setup.outputs))
    except (AttributeError, KeyError, TypeError, ValueError) as fault:
        raise BusError(
            f"the plant of run {session.run} describes its scene in an unknown form: {fault}; "
            "start all processes of a run from the same installation"
        ) from None
    return replace(setup, core=scheduling.ANY) if session.holds else setup  # the core is one of the plant's host
