"""How processes talk: one table of topics, protobuf messages, a Zenoh session.

The plant hosts a run, everyone else joins it:

    from rig import bus
    from rig.bus import encode, setup

    with bus.host(scene="pendulum") as plant:                       # listens on a private unix socket
        scene = plant.serve("scene", lambda _: described.to_json()) # described: setup.Setup; scene.poll() every frame
        commands = plant.subscribe("act/*", stamped=True)           # receivers first, then announce
        watch = plant.watch("*/*")
        plant.announce()
        step = plant.publisher("step")
        step.put(encode.step(tick, t_ns, bank.latest, bank.fresh), t_ns)
        answer = commands.get(timeout=0.01)                         # Message(topic, payload, seq, t_ns, ..., said)
        answer.said.tick, answer.said.values                        # the Act that it carries
        plant.publisher("total/plant").put(plant.totals(), t_ns)    # the last word

    with bus.join(role="controller", name="normal_force") as me:    # the newest run, or join("run name", ...)
        described = setup.fetch(me)
        steps, plant = me.subscribe("step"), me.watch("plant/*")
        me.announce()
        while plant.wait_for("plant", "plant", 0.0):
            if (said := steps.get(timeout=0.1)) is not None: ...

What arrives malformed, or from a process that does not own the topic, is refused and counted: `session.door`.
A receiver tells `received` and `lost`; `counts[topic].tail(sent)` adds what was lost after the last message.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rig.bus.port import Session


def host(
    run: str | None = None, scene: str = "run", endpoint: str | None = None, controllers: Iterable[str] = ()
) -> Session:
    """The hub of a new run, named after the scene and the time unless `run` is given; in role "plant".

    Nobody but a process that joins as one of `controllers` can speak under its name.
    """
    from rig.bus import address  # protobuf and Zenoh are loaded by those who talk between processes
    from rig.bus.link import open_hub

    return open_hub(address.claim(run, scene, endpoint), controllers)


def join(run: str | None = None, *, role: str, name: str, wait: float = 0.0) -> Session:
    """A session in a live run, the newest by default; waits at most `wait` seconds for it to appear.

    `session.name` is another than `name` where a recorder or viewer of that name is there already.
    """
    from rig.bus import address
    from rig.bus.link import open_leaf

    return open_leaf(address.find(run, wait), role, name)
