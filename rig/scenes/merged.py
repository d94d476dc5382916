"""The merged tables of a scene: those of the files that it is based on, its own, and changes by the caller.

A change of kind (another plant, another kind of sensor) drops the values that the new kind does not know. A note lists
them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from rig.effects import EFFECTS
from rig.errors import PartError
from rig.plants import PLANTS
from rig.scenes import faults, inherit, places, protocol, rooms, source

MOST = 100
"""Largest number of faults that an error lists."""
OWN = (
    "format",
    "based_on",
    "title",
    "plant",
    "about",
    "seed",
    "clock",
    "sensors",
    "controllers",
    "network",
    "faults",
    "protocol",
    "limits",
)
"""Keys of a scene file that do not depend on its plant."""


T = TypeVar("T")


class Wrong(Exception):
    """Raised for values of a scene that are wrong, with (dotted key, line) of each fault."""


class Merged:
    """The merged tables `raw`, with the origin of each value; `faults` collects a line for everything that is wrong.

    `overrides`: dotted key -> value, changes by the caller; `given`: the place of each, if it is not the call.
    """

    def __init__(
        self, layers: Sequence[inherit.Layer], overrides: Mapping[str, object], given: Mapping[str, places.Place]
    ) -> None:
        self.faults: list[str] = []
        self.origins: dict[str, places.Origin] = {}
        self.raw: dict[str, Any] = {}
        self.notes: list[str] = []
        self.places = inherit.Places(layers, {**dict.fromkeys(overrides, places.IN_THE_CALL), **given}, self.raw)
        self.recast: dict[str, tuple[str, Any]] = {}
        """Tables whose kind changed after the protocol was written -> key of the kind, former kind."""
        for layer in layers:
            self._lay(layer)
        new_faults: list[source.Fault] = []
        recast = source.change(self.raw, overrides, self.origins, new_faults)
        self.report(new_faults)
        rooms.anchor(self.raw, Path.cwd())
        self._forget(recast, dict(source.dotted(overrides)))
        self.recast |= recast

    def _lay(self, layer: inherit.Layer) -> None:
        """Merge a file into those that it is based on."""
        new_faults: list[source.Fault] = []
        own: dict[str, places.Origin] = {}
        tables = source.stripped(layer.raw, own, new_faults)
        rooms.anchor(tables, layer.path.parent)
        self.report(new_faults, layer)
        for key in inherit.OWN:
            self.raw.pop(key, None)
        if isinstance(plant := tables.get("plant"), str):
            self._replant(plant, layer)
        recast: dict[str, tuple[str, Any]] = {}
        self.report(source.lay(tables, self.raw, self.origins, own, recast), layer)
        self._forget(recast, layer.lines, layer)
        self.recast = {} if "protocol" in tables else self.recast | recast

    def _replant(self, plant: str, layer: inherit.Layer) -> None:
        """If `layer` names another plant, drop the tables of the former one, except those that both plants share.

        Effects that act on any plant stay.
        """
        before = self.raw.get("plant")
        if plant == before or not isinstance(before, str) or not {plant, before} <= PLANTS.keys():
            return
        try:
            now, former = (PLANTS[name].Parameters for name in (plant, before))
        except PartError:
            return  # a fault that the loader reports
        kept = {*OWN, *faults.shared(now, former), *rooms.effects_in(self.raw, former)}
        gone = [key for key in self.raw if key not in kept]
        if not gone:
            return
        for key in gone:
            del self.raw[key]
            source.forget(self.origins, key)
        self.notes.append(f"plant = {plant}: dropped {', '.join(gone)} of {before} ({layer.place('plant')})")

    def _forget(
        self, recast: Mapping[str, tuple[str, Any]], keys: Iterable[str], layer: inherit.Layer | None = None
    ) -> None:
        """Drop the values that a table had as another kind, except those that both kinds share.

        `recast`: table -> key of the kind, former kind. `keys`: those that the file `layer`, or the caller, gives
        together with the change of kind.
        """
        for table, (tag, before) in recast.items():
            values = source.at(self.raw, table.split("."))
            now = (values or {}).get(tag)
            kinds = self._kinds(table, tag)
            if values is None or not isinstance(now, str) or now not in kinds:
                continue  # a fault that the loader reports
            try:
                known = isinstance(before, str) and before in kinds
                common = faults.shared(kinds[before], kinds[now]) if known else set()
            except PartError:
                continue  # a fault that the loader reports
            head = f"{table}."
            given = {key.removeprefix(head).partition(".")[0] for key in keys if key.startswith(head)}
            gone = [key for key in values if key != tag and key not in given | common]
            kept = [key for key in values if key in common - given]
            for key in gone:
                del values[key]
                source.forget(self.origins, f"{head}{key}")
            if gone:
                note = f"{head}{tag} = {now}: dropped {', '.join(gone)} of {before}"
                note += f"; kept {', '.join(kept)}" if kept else ""
                self.notes.append(f"{note} ({layer.place(f'{head}{tag}')})" if layer else note)

    def _kinds(self, table: str, tag: str) -> Mapping[str, Any]:
        """The kinds that a table may have, by name."""
        room, *path = table.split(".")
        if room == "sensors":
            return rooms.SENSORS
        if room == "controllers":
            return rooms.CONTROLLERS
        if tag == rooms.EFFECT:
            return EFFECTS
        plant = self.raw.get("plant")
        try:
            model = PLANTS[plant].Parameters if isinstance(plant, str) and plant in PLANTS else None
        except PartError:
            return {}  # a fault that the loader reports
        return faults.members(faults.inner(model, (room, *path)), tag)

    def leave_out(self, names: protocol.Known) -> None:
        """Replace steps of the protocol that set a value which a change of kind dropped by marks that say so."""
        if not names.whole or not self.recast:
            return

        def look(steps: Any, key: str) -> None:
            for i, step in enumerate(steps if isinstance(steps, list) else (), 1):
                if not isinstance(step, dict):
                    continue
                here = f"{key}[{i}]"
                target = step.get("target")
                if isinstance(target, str) and target not in names.inputs and target not in names.settable:
                    if any(target.startswith(f"{table}.") for table in self.recast):
                        steps[i - 1] = {"step": "mark", "text": f"left out: {step.get('step')} {target}"}
                        source.forget(self.origins, here)
                        self.notes.append(f"{here}: left out, there is no {target} any more")
                look(step.get("steps"), f"{here}.steps")

        look(self.raw.get("protocol"), "protocol")

    def read(self, make: Callable[[], T], otherwise: T) -> T:
        """Return `make()`, or `otherwise` after reporting what is wrong, or that a part from a file failed."""
        try:
            return make()
        except Wrong as fault:
            self.report(fault.args)
        except PartError as fault:
            self.faults += [line for line in str(fault).splitlines() if line not in self.faults]
        return otherwise

    def report(self, new_faults: Iterable[source.Fault], layer: inherit.Layer | None = None) -> None:
        """Add faults, each with the place of its value. `layer`: the file that has them."""
        for key, line in new_faults:
            if len(self.faults) > MOST:  # no reader needs more, and each takes time to be put into words
                return
            place = layer.place(key) if layer else self.places.near(key)
            placed = f"{line} ({place})" if place else line
            if placed not in self.faults:
                self.faults.append(placed)
