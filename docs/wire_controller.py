"""A controller from docs/wire.md alone: Zenoh, protobuf, rig_pb2.py, no friction-rig. python wire_controller.py RUN"""

import fcntl
import json
import math
import os
import queue
import struct
import sys
from pathlib import Path

import rig_pb2  # a copy of rig/bus/rig_pb2.py, or made from rig.proto by protoc
import zenoh

NAME, READS, DRIVES, PERIOD_NS = "plain", ["vibrometer"], ["load.force"], 1_000_000
HEADER = struct.Struct("<QQ")  # number on the topic, simulated time [ns]

run, base = sys.argv[1], os.environ.get("XDG_RUNTIME_DIR")
runs = Path(base, "friction-rig") if base else Path(f"/tmp/friction-rig-{os.getuid()}")
address = json.loads((runs / f"{run}.run").read_text())
for seat in sorted((runs / f"{run}.users").glob("guest-*")):  # the first one that no process has locked
    lock = seat.open("r+")
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        break
    except BlockingIOError:
        lock.close()
user, login = seat.name, "transport/auth/usrpwd"
config = zenoh.Config()
for key, value in {"mode": "client", "connect/endpoints": [address["endpoint"]], "scouting/multicast/enabled": False,
                   f"{login}/user": user, f"{login}/password": lock.read()}.items():  # fmt: skip
    config.insert_json5(key, json.dumps(value))

with zenoh.open(config) as session:

    def ask(topic: str, body: dict) -> dict:  # noqa: D103
        for reply in session.get(f"rig/{run}/plant/{topic}/{user}", payload=json.dumps(body), timeout=30.0):
            if reply.ok is None:
                sys.exit(f"{topic} refused: {reply.err.payload.to_string()}")
            return json.loads(reply.ok.payload.to_bytes())
        sys.exit(f"nobody answers {topic}")

    column = list(ask("scene", {})["sensors"]).index(READS[0])
    ask("cmd/plant", {"do": "admit", "controller": NAME, "reads": READS, "drives": DRIVES, "period_ns": PERIOD_NS})
    arrived, answer, tick, sent = queue.SimpleQueue(), b"", -1, 0
    steps = session.declare_subscriber(f"loop/{run}/plant/step", arrived.put)
    plant = session.liveliness().declare_subscriber(f"rig/{run}/plant/alive/plant/plant", arrived.put)
    act = session.declare_publisher(f"loop/{run}/{user}/act/{NAME}", priority=zenoh.Priority.REAL_TIME,
                                    encoding=f"application/protobuf;rig.Act@{address['speaks']}")  # fmt: skip
    token = session.liveliness().declare_token(f"rig/{run}/{user}/alive/controller/{NAME}")
    while (sample := arrived.get()).kind == zenoh.SampleKind.PUT:  # else the plant has left
        step = rig_pb2.Step.FromString(sample.payload.to_bytes()[HEADER.size :])
        if step.tick > tick and step.t_ns % PERIOD_NS == 0:
            velocity, tick = step.values[column], step.tick
            command = [min(max(20.0 - 200.0 * velocity, 0.0), 100.0)] if math.isfinite(velocity) else []
            answer = rig_pb2.Act(tick=tick, t_ns=step.t_ns, values=command).SerializeToString()
        if step.tick == tick:  # a repeated step gets the same answer
            act.put(HEADER.pack(sent, step.t_ns) + answer)
            sent += 1
