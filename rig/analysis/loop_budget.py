"""The delay budget of a control loop: what delays it at the frequency of its least stable mode, and who states that.

A filter delays by phase / frequency; a lag of first order by atan(w T) / w; a value held over a period by half of it.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from rig.analysis.control_loop import Loop, ends
from rig.analysis.jump_loop import mean_age
from rig.scenes.explain import explain
from rig.scenes.network import Link
from rig.scenes.scene import Scene

_ROUNDED = 1e-12  # rad


@dataclass(frozen=True)
class Item:
    """One delay of a loop [s], and its `origin`: a key of the scene with its origin, computed, or measured."""

    part: str
    seconds: float
    origin: str


def budget(scene: Scene, found: Loop, bus: float | None = None) -> list[Item]:
    """The delays of the loop `found` of `scene` in the order of the signal.

    `bus`: measured time [s] from a step to its answer over the bus; None: it was not measured.
    """
    return list(_items(scene, found, bus))


def links(scene: Scene, name: str) -> tuple[Link, Link]:
    """The links of the loop of controller `name`: of its sensor, and of its commands."""
    network = scene.network
    return network.meas.get(ends(scene, name)[0], Link()), network.act.get(name, Link())


def _items(scene: Scene, found: Loop, bus: float | None) -> Iterator[Item]:
    name = found.controller
    section, omega = scene.controllers[name], abs(found.spectrum.rates[0].imag)
    (sensor, drive), (meas, act), frame = ends(scene, name), links(scene, name), scene.frame_ns
    origins = {value.key: f"{value.key} ({value.origin.origin})" for value in explain(scene).values}
    end = scene.sensors[sensor].front_end()
    if omega:
        late = 1e-9 * end.delay_ns
        turn = -cmath.phase(end.response(1j * omega) / end.response(1e-9j * omega) * cmath.exp(1j * omega * late))
        turn = turn if abs(turn) > _ROUNDED else 0.0
        yield Item(f"filter of {sensor}", turn / omega, "computed from its transfer function")
    yield Item(f"delay of {sensor}", 1e-9 * end.delay_ns, origins.get(f"sensors.{sensor}.delay", "its instrument"))
    yield _of_link(f"meas/{sensor}", meas, frame, f"network.meas.{sensor}" if sensor in scene.network.meas else "")
    yield Item(f"computation of {name}", 1e-9 * section.delay, origins.get(f"controllers.{name}.delay", "default"))
    yield _of_link(f"act/{name}", act, frame, f"network.act.{name}" if name in scene.network.act else "")
    yield Item("sample and hold", 0.5 * found.model.period, "half a period, computed")
    yield from _of_actuator(scene, drive, omega, origins)
    if section.where == "process":
        origin = "rig run --pace: not measured (--measure does)" if bus is None else f"{1e3 * bus:.2g} ms, measured"
        frames = 1 if bus is None else max(math.ceil(bus * 1e9 / frame), 1)
        yield Item("bus of a paced run", frames * frame * 1e-9, f"{origin}: {frames} frame{'s' * (frames > 1)}")


def _of_link(topic: str, link: Link, frame: int, key: str) -> Item:
    origin = f"{key}: mean age of what arrives" if key else "a perfect link"
    return Item(f"link {topic}", mean_age(link, frame) * frame * 1e-9, origin)


def _of_actuator(scene: Scene, drive: str, omega: float, origins: dict[str, str]) -> Iterator[Item]:
    key = f"{drive.partition('.')[0]}.lag"
    lag: Any = scene.values().get(key, (0.0, ""))[0]
    one = scene.assemble().inputs[drive]
    if one.lagging and isinstance(lag, float | int) and lag:
        yield Item(f"lag of {drive}", math.atan(omega * lag) / omega if omega else lag, origins.get(key, key))
    else:
        yield Item(f"lag of {drive}", 0.0, "none in the scene")
