"""The names by which a user selects the channels of a run, and the answer to a name that does not exist."""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches

from rig.errors import UsageError
from rig.record.film_points import listed
from rig.record.run_data import RunData

MEASURED, TRUE = "meas/", "truth/"
"""Prefix of a name that a sensor and a plant output share: it selects the output."""


def signals(run: RunData) -> dict[str, str]:
    """Return name and unit of every sensor and plant output of a recording."""
    sensors = {name: run.units.get(MEASURED + name, "") for name in run.measurements}
    return listing(sensors, {name: run.units.get(name, "") for name in run.signals})


def listing(sensors: Mapping[str, str], outputs: Mapping[str, str]) -> dict[str, str]:
    """Return the names by which sensors and outputs (name -> unit) are selected, with their units."""
    return {**sensors, **{TRUE * (name in sensors) + name: unit for name, unit in outputs.items()}}


def unknown(name: str, names: Mapping[str, str], where: str = "recording") -> UsageError:
    """Return the error for a name that is not among the `names` [name -> unit] of a recording or a run."""
    near = get_close_matches(name, names, 3, 0.5)
    hint = f"did you mean {', '.join(near)}? " if near else ""
    return UsageError(f"no {name!r} in this {where}: {hint}known: {', '.join(listed(names)) or 'none'}")
