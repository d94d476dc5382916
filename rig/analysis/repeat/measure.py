"""The numbers of one of many runs.

first opening                         of a contact of many points; if there is one, the other numbers begin there
mean, least contact_fraction          range pressure_centre_x
rms OUTPUT, rms meas/SENSOR           about the mean
band meas/SENSOR                      RMS in octaves
amplitude, frequency                  of periodic outputs (rig.analysis.amplitude), for rigs without such points
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from rig.analysis.amplitude import index
from rig.analysis.recorded.series import series, vibration
from rig.analysis.recorded.spectrum import welch
from rig.errors import UsageError
from rig.record.even_times import bridge
from rig.record.run import Run
from rig.record.statistics import OPENINGS, first_opening, statistics, whole_signals

ONSET = "first opening"
_WINDOW = 1024  # samples of a window of the spectrum
_WINDOWS = 4  # fewest windows
_STILL = 1e-9  # of the size of an output: below this it does not move


class Number(NamedTuple):
    """A number and its unit."""

    value: float
    unit: str


@dataclass(frozen=True)
class Seen:
    """The numbers of one run by name; density `s` of signal `name` at `f` [Hz], empty if the run is too short."""

    seed: int
    seconds: float
    numbers: dict[str, Number]
    name: str = ""
    unit: str = ""
    f: tuple[float, ...] = ()
    s: tuple[float, ...] = ()
    fault: str = ""
    """Why the run stopped: diverged numerics or a limit."""

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return asdict(self) | {"numbers": {name: list(one) for name, one in self.numbers.items()}}

    @classmethod
    def from_json(cls, raw: dict[str, Any]) -> Seen:
        """Return the run of `to_json`."""
        numbers = {name: Number(*one) for name, one in raw["numbers"].items()}
        return cls(**{**raw, "numbers": numbers, "f": tuple(raw["f"]), "s": tuple(raw["s"])})


def measure(run: Run, seed: int) -> Seen:
    """Compute the numbers of a run."""
    numbers: dict[str, Number] = {}
    opened, begin = first_opening(run), 0.0
    if opened is not None:
        numbers[ONSET], begin = Number(opened, "s"), opened
    for one in statistics(run, begin):
        numbers[one.name] = Number(one.value, one.unit)
    if OPENINGS not in run.signals:
        for name in whole_signals(run):
            v = run.signals[name]
            if np.ptp(v) > _STILL * float(np.abs(v).max(initial=0.0)) and (found := index(run.time, v)).cycles:
                numbers[f"amplitude {name}"] = Number(found.half, run.units.get(name, ""))
                numbers[f"frequency {name}"] = Number(found.frequency, "Hz")
    name, unit, f, s = _density(run, begin)
    stopped = "" if run.summary.get("ended") in ("done", None) else str(run.summary["ended"])
    return Seen(seed, float(run.time[-1]), numbers, name, unit, f, s, run.fault.partition("\n")[0] or stopped)


def _density(run: Run, begin: float) -> tuple[str, str, tuple[float, ...], tuple[float, ...]]:
    """Name, unit, frequencies [Hz] and power spectral density of the default vibration signal."""
    try:
        found = series(run, vibration(run), begin)
    except UsageError:  # nothing vibrates, or less than two samples are left
        return "", "", (), ()
    if found.v.size < _WINDOWS * _WINDOW:
        return "", "", (), ()
    density = welch(bridge(found.v)[0], found.rate, _WINDOW)
    return found.name, found.unit, tuple(density.f.tolist()), tuple(density.s.tolist())
