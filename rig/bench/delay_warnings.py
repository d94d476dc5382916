"""Warnings about sensors and controllers whose delay is as long as the run."""

from __future__ import annotations

from collections.abc import Iterator

from rig.bench.journal import Journal
from rig.scenes.scene import Scene


class DelayWarnings:
    """Notes a warning in `journal` for each delay of `scene` that is as long as the run, once for each."""

    def __init__(self, scene: Scene, journal: Journal) -> None:
        self._scene, self._journal = scene, journal
        self._noted: set[str] = set()

    def check(self, length_ns: int) -> None:
        """Note the warnings for a run of this length [ns]."""
        for key, text in _late(self._scene, length_ns):
            if key not in self._noted:
                self._noted.add(key)
                self._journal.note("warning", f"{key}: {text}")


def _late(scene: Scene, duration_ns: int) -> Iterator[tuple[str, str]]:
    """(key, warning) of each sensor and controller whose delay is at least `duration_ns`."""
    length = f"the run of {duration_ns * 1e-9:g} s"
    for name, sensor in scene.sensors.items():
        delay = sensor.front_end().delay_ns
        if delay >= duration_ns:
            yield (
                f"sensors.{name}",
                f"its delay of {delay * 1e-9:g} s is as long as {length}: all that it measures is the "
                "state before the start; shorten the delay or run longer",
            )
    for name, section in scene.controllers.items():
        if section.delay >= duration_ns:
            yield (
                f"controllers.{name}",
                f"its delay of {section.delay * 1e-9:g} s is as long as {length}: no command takes "
                "effect; shorten the delay or run longer",
            )
