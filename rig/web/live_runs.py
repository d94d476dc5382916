"""Other live runs beside the page's own: those that this user has started in other terminals."""

from __future__ import annotations

from typing import Any

from rig.bus import address
from rig.bus.messages import FINGERPRINT


def others(mine: str) -> list[dict[str, Any]]:
    """Of each live run but `mine`: `run`, `scene`, `started` [s since 1970], and `why` it cannot be followed, or "".

    The directory of runs is private, so runs of other users are not among them.
    """
    why = "another version of friction-rig runs it: follow it with that version's rig view"
    return [
        {"run": one.run, "scene": one.scene, "started": one.started, "why": "" if one.speaks == FINGERPRINT else why}
        for one in address.list_runs()
        if one.run != mine
    ]
