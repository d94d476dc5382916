"""The sound at a microphone: level, spectrum and squeals, as numbers and a picture.

hearing    level, short-time spectrum, squeals
figure     a picture
"""

from __future__ import annotations

from rig.analysis.sound.hearing import Sound, Squeal, hear

__all__ = ["Sound", "Squeal", "hear"]
