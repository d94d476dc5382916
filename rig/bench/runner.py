"""The plant runner: steps plant and sensors of a scene, frame by frame.

The result depends only on the ticks at which actuators and parameters are written. Therefore a run in one process, over
the bus in lockstep, or re-simulated from a recording gives the same bits.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rig.bench.audit import StateSamples, audit
from rig.bench.checkpoint import Arrays, KeptState, packed
from rig.bench.commanded_plant import CommandedPlant
from rig.errors import UsageError


class PlantRunner(CommandedPlant):
    """Plant and sensors of a scene at tick `tick` [frames]. Raises rig.errors.NumericsError if it must stop.

    `truthful`: keep all outputs at every sample step (`truth`) and all measurements (`measurements`). `piece`: number
    of frames computed at once, or of all frames of a truthful run; memory is allocated for them from the start. It
    steps (rig.bench.stepped_plant), takes commands (rig.bench.commanded_plant), and can return to a state that was
    kept.
    """

    def checkpoint(self) -> bytes:
        """What `resume` needs at this tick, before anything is changed at it; empty if the method cannot resume."""
        if not (motion := self.motion.checkpoint()):
            return b""
        return packed({**motion, **self.bank.checkpoint(), "random": np.array([self.random_numbers.used])})

    def resume(self, found: Arrays) -> None:
        """Continue from the `checkpoint` of this tick, made by a runner with the same rig and the same instruments.

        The instruments have published the samples of this tick already. Raises ValueError or KeyError for another rig.
        """
        self.motion.resume(found, self.tick * self.steps)
        self.bank.resume(found, self.t_ns)
        self.random_numbers.resume(int(found["random"][0]))
        self._look = True

    def keep(self) -> KeptState:
        """The state of plant and instruments at this tick, for `back`. Call it before anything is changed at this tick.

        Raises UsageError for the method kick, which cannot return to a state.
        """
        if not (motion := self.motion.checkpoint()):
            raise UsageError(f"a rig with the method {self.motion.integration.method} cannot return to a state")
        arrays = {**motion, **self.bank.keep(), "random": np.array([self.random_numbers.used])}
        return KeptState(self.scene, self.tick, arrays, dict(self.values))

    def back(self, kept: KeptState, seed: int | None = None) -> None:
        """Return to a state of this runner, with the same bits from there on.

        `seed`: draw noise from another seed from there on; from tick 0 on the bits are those of a new runner with this
        seed. Raises UsageError if the rig was built again since, because a parameter has changed, and for a runner that
        keeps all outputs.
        """
        if kept.scene is not self.scene:
            raise UsageError("the rig was built anew since this state was kept; make a new runner")
        if self._truthful:
            raise UsageError("a runner that keeps all outputs cannot return to a state")
        if self.meas_links and kept.tick:
            raise UsageError("messages under way on impaired links are not kept: such a rig returns to tick 0 only")
        self.tick = kept.tick
        self.values = dict(kept.values)
        if seed is not None:
            self.bank.seed = self.random_numbers.seed = seed
        self.bank.back(kept.arrays)
        self.resume(kept.arrays)
        self.state_samples = StateSamples(self.scene, self.values)
        self.state_samples.begin(self.tick, self.t_ns * 1e-9)
        if seed is not None and not self.tick:
            self.start()
        elif not self.tick:
            self._connect()

    def statistics(self) -> dict[str, Any]:
        """Method, counts, stick share and energy so far."""
        energy = self.motion.energy()
        return {
            "method": self.motion.integration.method,
            **self.motion.counts(),
            **({"stick_share": self.motion.stick_share()} if self.motion.system.patches else {}),
            **({"kick_residual": residual} if (residual := self.motion.residual()) is not None else {}),
            "findings": [one.to_json() for one in self.findings if one.level != "info"],
            "energy": energy,
            "energy_error": energy["error"],
        }

    def audit(self) -> list[dict[str, Any]]:
        """Return the influence of each effect on this run, missing effects included (rig.bench.audit)."""
        return audit(self.scene, self.state_samples, self.motion)
