"""A controller from docs/wire.md alone: Zenoh, protobuf, rig_pb2.py, no friction-rig. python wire_controller.py RUN"""

import fcntl
import json
import os
import queue
import struct
import sys
import time
from pathlib import Path

import rig_pb2  # a copy of rig/bus/rig_pb2.py, or made from rig.proto by protoc
import zenoh

NAME, READS, DRIVES, PERIOD_NS = "plain", ["vibrometer"], ["load.force"], 1_000_000
HEADER = struct.Struct("<QQ")  # number on the topic, simulated time [ns]


def free(file) -> bool:  # noqa: D103  # whether no other process has locked a file; then this one has
    try:
        return fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB) is None
    except BlockingIOError:
        return False


run, base = sys.argv[1], os.environ.get("XDG_RUNTIME_DIR")
runs = Path(base, "friction-rig") if base else Path(f"/tmp/friction-rig-{os.getuid()}")
plant = (runs / f"{run}.run").open("r+")
address = json.load(plant)
seat = next(file for path in sorted((runs / f"{run}.users").glob("guest-*")) if free(file := path.open("r+")))
user = Path(seat.name).name
auth = {"usrpwd": {"user": user, "password": seat.read()}}
config = {
    "mode": "client",
    "connect": {"endpoints": [address["endpoint"]]},
    "transport": {"auth": auth},
    "scouting": {"multicast": {"enabled": False}},
}
with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:

    def ask(topic: str, body: dict) -> dict:  # noqa: D103
        while not (got := [*session.get(f"rig/{run}/plant/{topic}/{user}", payload=json.dumps(body), timeout=60.0)]):
            time.sleep(0.1)  # the plant does not listen yet
        return json.loads(got[0].ok.payload.to_bytes()) if got[0].ok else sys.exit(got[0].err.payload.to_string())

    column = list(ask("scene", {})["sensors"]).index(READS[0])
    ask("cmd/plant", {"do": "admit", "controller": NAME, "reads": READS, "drives": DRIVES, "period_ns": PERIOD_NS})
    steps, answer, tick, sent = queue.SimpleQueue(), b"", -1, 0
    subscriber = session.declare_subscriber(f"loop/{run}/plant/step", steps.put)
    act = session.declare_publisher(
        f"loop/{run}/{user}/act/{NAME}",
        priority=zenoh.Priority.REAL_TIME,
        encoding=f"application/protobuf;rig.Act@{address['speaks']}",
    )
    token = session.liveliness().declare_token(f"rig/{run}/{user}/alive/controller/{NAME}")
    while steps.qsize() or not free(plant):  # the plant has its file locked while it lives
        try:
            step = rig_pb2.Step.FromString(steps.get(timeout=0.5).payload.to_bytes()[HEADER.size :])
        except queue.Empty:
            continue
        if step.tick > tick and step.t_ns % PERIOD_NS == 0:
            velocity, tick = step.values[column], step.tick
            command = [min(max(20.0 - 200.0 * velocity, 0.0), 100.0)] if velocity == velocity else []  # not NaN
            answer = rig_pb2.Act(tick=tick, t_ns=step.t_ns, values=command).SerializeToString()
        if step.tick == tick:  # a repeated step gets the same answer
            act.put(HEADER.pack(sent, step.t_ns) + answer)
            sent += 1
