"""A sound as a WAV file: one channel, 24 bit, at the rate of the sensor."""

from __future__ import annotations

import wave
from pathlib import Path

import numpy as np

from rig.analysis.sound.hearing import Sound

_HEADROOM = 0.9
_FULL = 2**23 - 1


def write(sound: Sound, path: Path) -> float:
    """Write `sound` to `path` and return the value, in its unit, of the file's full scale. Directories are made."""
    full = sound.peak / _HEADROOM or 1.0
    whole = np.rint(sound.v / full * _FULL).astype("<i4")
    path.parent.mkdir(parents=True, exist_ok=True)
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(3)
        file.setframerate(round(sound.rate))
        file.writeframes(whole.view(np.uint8).reshape(-1, 4)[:, :3].tobytes())  # the low three bytes of each
    return full
