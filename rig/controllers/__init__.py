"""Controllers: pure objects that see measurements and send commands, and the process that runs one of them.

normal_force     press less when the body runs with the belt
belt_velocity    let the belt follow the body
dither           the least amplitude that keeps the cycle away
dither_sampled   dither as a held signal, to show its error
narrow_band      damp the modes of a band through the voltage of a stack
shunt_schedule   a shunt connected by the clock
squeal_switch    a shunt connected when the brake squeals
shunt_tuner      a shunt's inductance after the squeal's frequency

blocks           what controllers are built from
runtime          what runs them

A controller never sees the plant: what it needs of the matrices comes as numbers from the design step.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rig.controllers.belt_velocity import BeltVelocity, BeltVelocityFeedback
from rig.controllers.blocks.base import Controller, Numbers
from rig.controllers.dither import Dither, DitherSearch
from rig.controllers.dither_sampled import SampledDither, SampledDitherSignal
from rig.controllers.narrow_band import NarrowBand, NarrowBandFeedback
from rig.controllers.normal_force import NormalForce, NormalForceFeedback
from rig.controllers.shunt_schedule import ShuntClock, ShuntSchedule
from rig.controllers.shunt_tuner import FrequencyTuner, ShuntTuner
from rig.controllers.squeal_switch import SquealSwitch, SquealWatch
from rig.quantities import Section

KINDS: dict[str, tuple[type[Section], Any]] = {
    "normal_force": (NormalForce, NormalForceFeedback),
    "belt_velocity": (BeltVelocity, BeltVelocityFeedback),
    "dither": (Dither, DitherSearch),
    "dither_sampled": (SampledDither, SampledDitherSignal),
    "narrow_band": (NarrowBand, NarrowBandFeedback),
    "shunt_schedule": (ShuntSchedule, ShuntClock),
    "shunt_tuner": (ShuntTuner, FrequencyTuner),
    "squeal_switch": (SquealSwitch, SquealWatch),
}


def build(section: Section, numbers: Numbers) -> Controller:
    """The controller of a scene's section, with the numbers of the design step."""
    controller: Controller = KINDS[section.kind][1](section, numbers)  # type: ignore[attr-defined]
    return controller


def described(section: Section, numbers: Numbers) -> dict[str, Any]:
    """A controller as plain values, the way it travels to its process."""
    return {"section": section.model_dump(mode="json"), "numbers": dict(numbers)}


def restored(values: Mapping[str, Any]) -> Controller:
    """The controller that `described` told."""
    section = KINDS[values["section"]["kind"]][0].model_validate(values["section"])
    return build(section, values["numbers"])
