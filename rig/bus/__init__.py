"""The bus between the processes of a run: one table of topics, protobuf messages, Zenoh sessions.

The plant hosts a run; every other process joins it:

    from rig import bus
    from rig.bus import encode, run_setup

    with bus.host(scene="pendulum") as plant:                       # listens on a private unix socket
        scene = plant.serve("scene", lambda _: described.to_json()) # described: a Setup; scene.poll() every frame
        commands = plant.subscribe("act/*", stamped=True)           # receivers first, then announce
        watch = plant.watch("*/*")
        plant.announce()
        step = plant.publisher("step")
        step.put(encode.step(tick, t_ns, bank.latest, bank.fresh), t_ns)
        answer = commands.get(timeout=0.01)                         # Message(topic, payload, seq, t_ns, ..., said)
        answer.said.tick, answer.said.values                        # the Act that it carries
        plant.publisher("total/plant").put(plant.totals(), t_ns)    # last message: what was sent and received

    with bus.join(role="controller", name="normal_force") as me:    # the only run, or join("run name", ...)
        described = run_setup.fetch(me)
        steps, plant = me.subscribe("step"), me.watch("plant/*")
        me.announce()
        while plant.wait_for("plant", "plant", 0.0):
            if (said := steps.get(timeout=0.1)) is not None: ...

`session.inbound` refuses and counts malformed messages and messages from a process that does not own the topic.
A receiver has the counts `received` and `lost`; `counts[topic].tail(sent)` is the number of messages lost after the
last one received.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from rig.errors import BusError

if TYPE_CHECKING:
    from rig.bus.port import Session
    from rig.bus.tickets import Listener

TOLD = "-"
"""In place of a run's name: see `join`."""


def host(
    run: str | None = None,
    scene: str = "run",
    endpoint: str | None = None,
    controllers: Iterable[str] = (),
    listener: Listener | None = None,
) -> Session:
    """Open the session of the plant, which is the hub of a new run.

    The run is named after the scene and the time, unless `run` is given. `controllers` reserves names: only a process
    that joins as a controller of that name can publish under it. `listener`: where other hosts reach the run, too.
    Raises BusError if the name is taken.
    """
    from rig.bus import address  # only processes that use the bus load protobuf and Zenoh
    from rig.bus.link import open_hub

    return open_hub(address.reserve(run, scene, endpoint), controllers, listener)


def given_ticket(ticket: Path | None) -> Path | None:
    """The ticket that was given, or without one the file that the environment variable RIG_TICKET names, if any."""
    named = os.environ.get("RIG_TICKET")
    return ticket or (Path(named) if named else None)


def join(
    run: str | None = None,
    *,
    role: str,
    name: str,
    wait: float = 0.0,
    ticket: Path | None = None,
) -> Session:
    """Join a live run, by default the only one; wait at most `wait` seconds for it to appear. Raises BusError.

    `TOLD` as `run`: the first line of standard input is its name. A supervisor starts its processes before the plant
    has one, because their imports take as long as the plant's.
    `ticket`: the file that lets this process join a run of another host (rig.bus.tickets); by default, without `run`,
    the one that the environment variable RIG_TICKET names.
    `session.name` differs from `name` if the run already has a recorder or viewer of that name.
    """
    from rig.bus import address
    from rig.bus.link import open_leaf, open_ticket

    if ticket is not None and run is not None:
        raise BusError(f"--run {run}: the ticket {ticket} names the run; leave --run out")
    chosen = given_ticket(ticket) if run is None else None
    if chosen is not None:
        return open_ticket(chosen, role, name, wait)
    if run == TOLD:
        run = sys.stdin.readline().strip()
        if not run:
            raise BusError("the run that this process was to join has not begun")
    return open_leaf(address.find(run, wait), role, name)
