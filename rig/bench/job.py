"""What a plant process is to do; travels from the one who starts it as a file of JSON."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass

from rig.errors import UsageError
from rig.scenes.scene import Scene


@dataclass(frozen=True)
class Job:
    """One run of the plant."""

    scene: str
    """The scene, `Scene.to_json`."""
    run: str | None = None
    endpoint: str | None = None
    pace: float | None = 1.0
    """Simulated over wall time; None: as fast as the controllers answer, in lockstep."""
    lockstep: bool = False
    duration: float | None = None
    """Simulated seconds; by default as long as the protocol takes."""
    expect: tuple[tuple[str, str], ...] = ()
    """(role, name) of those to wait for before the first frame."""
    wait: float = 20.0
    """Longest wait for them [s]."""
    parent: int = 0
    """Process without which this one ends; 0: none."""
    command: tuple[str, ...] = ()
    """What the user typed, for the recording."""

    def __post_init__(self) -> None:
        if self.pace is not None and self.pace <= 0.0:
            raise UsageError(f"a pace of {self.pace:g} is not above zero")

    @property
    def in_lockstep(self) -> bool:
        """Whether each frame waits for the answers of the controllers."""
        return self.lockstep or self.pace is None

    def to_json(self) -> str:
        """As JSON text."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Job:
        """From JSON text."""
        found = json.loads(text)
        found["expect"] = tuple((role, name) for role, name in found["expect"])
        return cls(**{**found, "command": tuple(found["command"])})


def keeps_up(scene: Scene, pace: float | None) -> None:
    """Raise UsageError where `scene` says that it cannot keep up with the clock at `pace` (None: without a clock)."""
    limit = scene.clock.pace_limit
    if pace is not None and limit is not None and pace > limit:
        raise UsageError(
            f"{scene.name} cannot run at a pace of {pace:g}: {scene.slow}. What works: rig simulate; "
            f"rig run --lockstep; rig run --pace {limit:g}. To run it all the same: -p clock.pace_limit={pace:g}"
        )
