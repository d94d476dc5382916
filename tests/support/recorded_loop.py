"""A control loop that was recorded, and a controller for its replay."""

import time

import numpy as np

from rig.bus import encode, messages
from rig.bus.run_setup import fetch
from rig.record.recorded_setup import head, setup_of
from rig.record.run import Commands, Run, Samples
from rig.record.save_run import save
from rig.record.writer import Writer

FRAMES = 400
TUNED_AFTER, TUNED = 250, 3.0  # the gain was changed live after this tick


def answer(state, values, gain):
    """A filter with memory, so that a single wrong or missing step shows in all later answers."""
    state = 0.9 * state + (0.0 if np.isnan(values[0]) else values[0])
    return state, (gain * state, values[1])


def write_loops(folder):
    """Write the same closed loop twice: saved.mcap from arrays, recorded.mcap message by message."""
    draw = np.random.default_rng(2)
    fast, slow = draw.standard_normal(10 * FRAMES + 1), draw.standard_normal(FRAMES + 1)
    state, given = 0.0, []
    for k in range(FRAMES):
        state, values = answer(state, (fast[10 * k], slow[k]), 2.0 if k <= TUNED_AFTER else TUNED)
        given.append(values)
    ticks = np.arange(FRAMES, dtype=np.int64)
    run = Run(
        scene="{}",
        step_ns=100_000,
        frame_ns=1_000_000,
        time=np.arange(FRAMES + 1) * 1e-3,
        signals={"x": slow},
        units={"x": "m"},
        measurements={
            "fast": Samples(np.arange(fast.size, dtype=np.int64) * 100_000, fast),
            "slow": Samples(np.arange(slow.size, dtype=np.int64) * 1_000_000, slow),
        },
        commands={"feedback": Commands(ticks, ticks, (ticks % 5 == 4).astype(np.int64), np.array(given))},
        events=[
            {
                "t_ns": 0,
                "tick": 0,
                "source": "feedback",
                "kind": "parameter",
                "text": "gain = 3.0",
                "data": {"set": {"gain": TUNED}, "after_tick": TUNED_AFTER},
            }
        ],
    )
    save(run, folder / "saved.mcap")
    writer = Writer(folder / "recorded.mcap", setup_of(head(folder / "saved.mcap")), "recorded")
    for k in range(FRAMES):
        now, latest = k * 1_000_000, np.array([fast[10 * k], slow[k]])
        writer.write("meas/slow", encode.block(k, now, 1_000_000, slow[k : k + 1]), now, k, now)
        writer.write("step", encode.step(k, now, latest, np.array([10, 1])), now, k, now)
        writer.write("act/feedback", encode.act(k, now, given[k]), now, k, now)
        if k == TUNED_AFTER:
            writer.write("event/feedback", messages.event(**run.events[0]), now, 0, now)
    writer.close({}, {})


class Feedback:
    """What a replay needs to know of the controller in `control`."""

    reads, drives, period_ns = ("fast", "slow"), ("a", "b"), 1_000_000


FEEDBACK = {"feedback": Feedback()}


def control(me, gain=2.0, dies_at=FRAMES + 1, held_up_at=FRAMES + 1, silent_from=FRAMES + 1, at_first=None):
    """A controller's process in small; answers until the replay ends. A held-up one sleeps once, for 0.1 s."""
    gains = [gain]

    def retune(body):
        gains.append(body["set"]["gain"])
        return {"values": body["set"]}

    steps, plant, server = me.subscribe("step"), me.watch("plant/*"), me.serve(f"param/{me.name}", retune)
    assert plant.wait_for("plant", "plant", 5.0)
    if me.name not in fetch(me).controllers:
        me.ask("cmd/plant", {"do": "admit", "controller": me.name, "period_ns": 2_000_000}, 3.0)
    me.announce()
    state = 0.0
    while ("plant", "plant") in plant.present:
        server.poll()
        said = steps.get(0.01)
        if said is None:
            plant.poll()
            continue
        step = messages.decode("step", said.payload)
        if at_first is not None:
            at_first(me)
            at_first = None
        if step.tick == dies_at:
            me.close()
            return
        if step.tick == held_up_at:
            time.sleep(0.1)
        if step.tick >= silent_from:
            continue
        state, values = answer(state, tuple(step.values), gains[-1])
        if me.name != "feedback" and step.tick % 2:
            continue
        me.publisher(f"act/{me.name}").put(encode.act(step.tick, step.t_ns, values), step.t_ns)


def closing(me, how):
    """`control` with a session that is closed at the end."""
    with me:
        control(me, **how)
