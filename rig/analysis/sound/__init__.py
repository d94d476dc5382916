"""The sound at a microphone: level, spectrum and squeals, as numbers, a picture and a WAV file.

hearing    level, short-time spectrum, squeals
wav        an audio file
figure     a picture
"""

from __future__ import annotations

from rig.analysis.sound.hearing import Sound, Squeal, hear

__all__ = ["Sound", "Squeal", "hear"]
