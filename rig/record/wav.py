"""A signal as a WAV file: one channel, 24 bit."""

from __future__ import annotations

import wave
from pathlib import Path

import numpy as np

from rig.errors import UsageError
from rig.printable import counted
from rig.record.run_data import Reals

_HEADROOM = 0.9  # share of the full scale that the peak takes. chosen
_FULL = 2**23 - 1  # the largest number of 24 bits
_SLICE = 1 << 20  # samples
_MOST = (2**32 - 64) // 3  # samples in a file of less than 4 GiB


def write(v: Reals, rate: float, path: Path) -> float:
    """Write `v` at `rate` [Hz] to `path`; return the value of full scale, in the unit of `v`. Directories are made.

    Samples that are not finite are silence. The rate of a WAV file is a whole number of Hz. Raises OSError, and
    UsageError for a signal that is too long for the format (4 GiB).
    """
    if v.size > _MOST:
        raise UsageError(
            f"{path.name}: {counted(v.size, 'sample')}; a WAV file has at most {_MOST} of 24 bit: choose a lower --rate"
        )
    peak = 0.0
    for part in _parts(v):
        largest = np.nanmax(np.abs(part), where=np.isfinite(part), initial=0.0)
        peak = max(peak, float(largest))
    full = peak / _HEADROOM or 1.0
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file, wave.open(file, "wb") as sound:
        sound.setnchannels(1)
        sound.setsampwidth(3)
        sound.setframerate(max(round(rate), 1))
        for part in _parts(v):
            whole = np.rint(np.where(np.isfinite(part), part, 0.0) / full * _FULL).astype("<i4")
            sound.writeframesraw(whole.view(np.uint8).reshape(-1, 4)[:, :3].tobytes())  # the low three bytes of each
    return full


def _parts(v: Reals) -> list[Reals]:
    return [v[begin : begin + _SLICE] for begin in range(0, v.size, _SLICE)]
