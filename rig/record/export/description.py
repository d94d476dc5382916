"""What an exported file says about its run besides the numbers: scene, provenance, timing verdict, damage."""

from __future__ import annotations

import json
from typing import Any

from rig.record.run_data import RunData


def description(run: RunData) -> dict[str, str]:
    """Return facts about a run by name, as text; those with structure are JSON. Empty ones are left out.

    `scene` is the resolved scene, `provenance` has versions, machine, seed and command. `damage` and `recovered` say
    what a damaged recording has lost, `restarted` which processes restarted so that losses are unknown, `fault` why a
    run is not complete.
    """
    found: dict[str, Any] = {
        "scene": run.scene,
        "provenance": run.provenance,
        "verdict": run.summary.get("verdict", ""),
        "damage": run.damage,
        "recovered": run.recovered,
        "restarted": run.untold,
        "fault": run.fault,
        "energy": run.energy,
        "summary": run.summary,
        "step_ns": run.step_ns,
        "frame_ns": run.frame_ns,
    }
    return {name: _text(value) for name, value in found.items() if value}


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
