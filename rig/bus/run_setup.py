"""What a process must know of a run before it can follow it; the plant answers it to the query `scene`."""

from __future__ import annotations

import base64
import json
from dataclasses import asdict, dataclass, field
from typing import Any

from rig import placement
from rig.bus.port import Session
from rig.errors import BusError


@dataclass(frozen=True)
class Setup:
    """The stand as it was built from a scene. Names are in the order of `State` (outputs) and `Step` (sensors)."""

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
    """Controller -> what its process needs: settings and numbers of the design."""
    provenance: dict[str, str] = field(default_factory=dict)
    paced: bool = False
    """Whether frames keep to the wall clock."""
    core: int = placement.ANY
    """Core of the bus and the controllers."""
    models: tuple[bytes, ...] = ()
    """The reduced models that the scene names."""

    def to_json(self) -> dict[str, Any]:
        """As plain values; `from_json` reads it back."""
        return asdict(self) | {"models": [base64.b64encode(one).decode() for one in self.models]}

    @classmethod
    def from_json(cls, found: dict[str, Any]) -> Setup:
        """The setup from plain values."""
        sensors = {name: (unit, int(period)) for name, (unit, period) in found["sensors"].items()}
        models = tuple(base64.b64decode(one) for one in found.get("models", ()))
        return cls(**{**found, "sensors": sensors, "models": models})

    def to_text(self) -> str:
        """As JSON text."""
        return json.dumps(self.to_json())


def fetch(session: Session, timeout: float = 10.0) -> Setup:
    """The setup of the session's run, asked of its plant; waits until the plant can answer.

    From here on the session reads the states of this scene.
    """
    try:
        found = Setup.from_json(session.ask("scene", {}, timeout, patient=True))
        session.door.learn(list(found.outputs), list(found.sensors))
    except (AttributeError, KeyError, TypeError, ValueError) as fault:
        raise BusError(
            f"the plant of {session.run} describes its scene in another way than expected: {fault}"
        ) from None
    return found
