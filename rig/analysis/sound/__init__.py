"""What a microphone heard: how loud, at which frequencies, when it squealed; as numbers, a picture and a WAV file.

hearing    level, short-time spectrum, squeals
wav        a file to listen to
figure     a picture
"""

from __future__ import annotations

from rig.analysis.sound.hearing import Sound, Squeal, hear

__all__ = ["Sound", "Squeal", "hear"]
