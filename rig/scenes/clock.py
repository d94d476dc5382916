"""The section [clock] of a scene: frame, pace and integration."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from annotated_types import Ge, Gt, Le
from pydantic import model_validator

from rig.quantities import PositiveMetrePerSecond, Section, duration, quantity

Count = Annotated[int, Gt(0), Le(1_000_000)]
Frame: Any = duration(1_000, 1_000_000_000)
FixedStep: Any = duration(10, 1_000_000_000)
Share: Any = quantity("1", Ge(0.0), Le(1.0))
Small: Any = quantity("1", Gt(0.0), Le(1e-2))
Large: Any = quantity("1", Gt(0.0))


class Clock(Section):
    """Frame, pace and integration of a scene.

    frame     loop period: commands in, measurements out [chosen]
    method    of integration [chosen]; auto is exact where the friction law allows, else dopri5
    tolerance   of dopri5, relative [chosen]
    rk4_step  of rk4 and kick [chosen]
    smoothing   slip speed over which smooth lets friction rise [chosen]
    overrun   policy of a paced run that is late [chosen]
    late_share_valid, late_share_degraded   share of frames late by more than one frame, for the timing verdict [chosen]
    pace_limit   largest pace (simulated over wall time) at which the scene keeps up with the clock; its note says why
    hold_frames   frames for which a missing command is replaced by the last one; after them, by the safe value [chosen]
    events_per_frame   largest number of events in one frame; more stop the run [chosen]
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
