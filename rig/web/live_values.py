"""The values that may change while a rig runs: read once from plant and controllers, then kept up to date.

An actuator that a controller drives is shown as owned: a value that an operator sets for it takes effect when the
controller is disconnected.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rig.bus.port import Session
from rig.errors import BusError
from rig.scenes.scene import Scene
from rig.units import with_point
from rig.web.form import entry_of, kind_of, within

PATIENCE_S = 2.0
"""Longest wait for an answer of a process of the run."""


class LiveValues:
    """Everything that can be tuned in the run of `session`, by dotted key; `inputs`: the actuators of its rig."""

    def __init__(self, session: Session, scene: Scene, inputs: Mapping[str, Any]) -> None:
        self.session, self._scene, self._inputs = session, scene, inputs
        self.entries: dict[str, dict[str, Any]] = {}
        """Key -> entry of the form (`rig.web.form.entry_of`), with `of` (plant or controller) and `owner`."""

    def read(self) -> None:
        """Read all values of plant and controllers; of a process that does not answer there are none.

        The ends of a slider come from the value of the scene: a protocol may begin with a rig at rest.
        """
        of_scene = self._scene.values()
        for process in ("plant", *self._scene.controllers):
            try:
                found = self.session.ask(f"param/{process}", {"list": True}, PATIENCE_S)
            except BusError:
                continue
            before = "" if process == "plant" else f"controllers.{process}."
            for inner, value in found["values"].items():
                key = before + inner
                one = self._inputs.get(key)
                name, unit = key.rpartition(".")[2], found["units"][inner]
                usual, _ = of_scene.get(key, (value, unit))
                entry = entry_of(key, name, usual, unit, within(self._scene, key, one))
                entry |= {**kind_of(self._scene, key, value), "value": value}
                self.entries[key] = {**entry, "of": process, "actuator": one is not None, "owner": ""}
        self.look()

    def look(self) -> bool:
        """Read the actuators and who drives them; whether something is new."""
        try:
            found = self.session.ask("param/plant", {"get": list(self._inputs)}, PATIENCE_S)
        except BusError:
            return False
        new = False
        for key, value in found["values"].items():
            entry, owner = self.entries.get(key), found["overruled"].get(key, "")
            if entry is not None and (entry["value"], entry["owner"]) != (value, owner):
                entry["value"], entry["owner"], new = value, owner, True
        return new

    def hear(self, event: Mapping[str, Any]) -> bool:
        """Take over the values of an event `parameter`; whether something is new."""
        if event["kind"] != "parameter":
            return False
        new = event["data"].get("set", {})
        prefix = "" if event["source"] == "plant" else f"controllers.{event['source']}."
        for key, value in new.items() if isinstance(new, dict) else ():
            entry = self.entries.get(key) or self.entries.get(prefix + key)
            if entry is not None and not entry["owner"]:
                entry["value"] = value
        return bool(new)

    def set(self, key: str, value: Any) -> dict[str, Any]:
        """Change a value at the next tick, as `rig tune` does; returns the answer of its owner. Raises BusError."""
        process = self.entries[key]["of"] if key in self.entries else "plant"
        inner = key.removeprefix(f"controllers.{process}.")
        value = with_point(value, key) if isinstance(value, str) else value
        answer: dict[str, Any] = self.session.ask(f"param/{process}", {"set": {inner: value}}, 10.0)
        return answer
