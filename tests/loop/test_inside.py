"""Controllers within the compiled loop: the same run, to the last bit, as if each had been asked from outside."""

import dataclasses
import json
import math
import re
import subprocess
import sys

import numpy as np
import pytest

import rig
from rig import controllers
from rig.bench.run import local_controllers, simulate
from rig.bench.run.local_controllers import CompiledControllers
from rig.design import numbers
from rig.scenes.scene import Scene

WAYS = ("outside", "called", "compiled")


def way(monkeypatch, name):
    """Controllers are asked from outside, from the compiled loop, or are compiled themselves."""
    if name == "outside":
        monkeypatch.setattr(CompiledControllers, "lend", lambda *_: ())
    monkeypatch.setattr(local_controllers, "WORTH", 1 if name == "compiled" else 10**12)
    monkeypatch.setattr(local_controllers, "TRIALS", 5)


def told(run):
    """All that a run is, bytes of arrays included."""
    columns = {f"measured {name}": samples[1] for name, samples in run.measurements.items()}
    columns |= {f"signal {name}": values for name, values in run.signals.items()}
    columns |= {f"{name} {i}": column for name, one in run.commands.items() for i, column in enumerate(one)}
    summary = {key: value for key, value in run.summary.items() if key != "audit"}
    return {name: np.asarray(values).tobytes() for name, values in columns.items()}, summary, run.events, run.fault


def runs(name, changes, duration, wrap=lambda controller: controller):
    """The run of a scene in each way."""
    found = []
    for kind in WAYS:
        with pytest.MonkeyPatch.context() as patch:
            way(patch, kind)
            scene = name if isinstance(name, Scene) else rig.load(name, changes)
            designed = numbers(scene)
            built = {n: wrap(controllers.build(s, designed[n])) for n, s in scene.controllers.items()}
            found.append(told(simulate.simulate(scene, built, round(duration * 1e9))))
    return found


CASES = [
    ("belt_normal_force", {"controllers.nf.enable_at": 0.2, "controllers.nf.delay": 0.003}, 0.5),
    ("belt_normal_force", {"controllers.nf.period": 0.005, "controllers.nf.delay": 0.012}, 0.5),
    ("belt_velocity_feedback", {"controllers.belt.enable_at": 0.1}, 0.5),
    ("belt_normal_force_displacement", {"controllers.nf.enable_at": 0.2}, 0.5),
    (
        "belt_normal_force",
        {"controllers.nf.enable_at": 0.1, "controllers.nf.gain": 1e5, "limits.displacement": 0.0015},
        0.5,
    ),
    ("belt_dither_sampled", {}, 0.5),
    ("belt_dither_controlled", {}, 0.3),
    ("brake_shunt_listener", {}, 0.03),
]


@pytest.mark.parametrize(("name", "changes", "duration"), CASES, ids=range(len(CASES)))
def test_a_run_has_the_same_bits_in_every_way(name, changes, duration):
    outside, called, compiled = runs(name, changes, duration)
    assert called == outside
    assert compiled == outside


@pytest.mark.parametrize(("name", "changes", "duration"), CASES[:5:2], ids=range(3))
def test_a_recording_is_simulated_again_with_the_same_bits(name, changes, duration):
    found = []
    for kind in WAYS[:2]:
        with pytest.MonkeyPatch.context() as patch:
            way(patch, kind)
            scene = rig.load(name, changes)
            first = rig.simulate(scene, duration)
            again = simulate.simulate(scene, {}, round(duration * 1e9), simulate.Recorded(first.commands, first.events))
            assert told(again)[0] == told(first)[0]
            found.append(told(again))
    assert found[0] == found[1]


def test_the_protocol_acts_between():
    hold, (on, off) = (
        {"step": "hold", "time": 0.2},
        ({"step": s, "controller": "nf"} for s in ("connect", "disconnect")),
    )
    changes = [
        {"step": "set", "target": "friction.mu_static", "to": 0.45},
        {"step": "set", "target": "controllers.nf.gain", "to": 120.0},
        {"step": "ramp", "target": "drive.speed", "to": 0.08, "over": 0.2},
    ]
    raw = json.loads(rig.load("belt_normal_force", {"controllers.nf.enable_at": 0.05}).to_json())
    raw["protocol"] = [hold, on, hold, *changes, off, hold | {"time": 0.1}, on, hold | {"time": 0.1}]
    outside, called, compiled = runs(Scene.from_json(json.dumps(raw)), {}, 0.8)
    assert called == outside
    assert compiled == outside


@dataclasses.dataclass
class Odd:
    """A controller around another one that does what it should not, at some of its answers."""

    within: object
    what: str
    at: tuple[int, ...]

    def __post_init__(self):
        self.reads, self.drives, self.period_ns = self.within.reads, self.within.drives, self.within.period_ns

    def start(self):
        return 0, self.within.start()

    def update(self, state, t_ns, values):
        count, inner = state
        inner, command = self.within.update(inner, t_ns, values)
        if count in self.at:
            if self.what == "raise":
                raise ValueError("odd")
            command = {"nan": (math.nan,), "few": (), "huge": (1e12,), "whole": (17,)}[self.what]
        return (count + 1, inner), command


@pytest.mark.parametrize("what", ["nan", "huge", "whole"])
def test_what_is_not_as_usual_has_the_same_bits(what):
    outside, called, compiled = runs("belt_normal_force", {}, 0.5, lambda c: Odd(c, what, (3, 100, 101, 400)))
    assert called == outside
    assert compiled == outside


@pytest.mark.parametrize("what", ["raise", "few"])
def test_a_faulty_controller_ends_the_run_with_its_own_error(what):
    scene = rig.load("belt_normal_force")
    built = {n: Odd(controllers.build(s, numbers(scene)[n]), what, (100,)) for n, s in scene.controllers.items()}
    run = simulate.simulate(scene, built, 10**9)
    assert re.search("odd|expected a tuple with one number for each of load.force", run.fault)
    assert 0.0 < run.time[-1] < 1.0


INTERRUPTED = """
import random, signal
import rig
from rig.bench.run import local_controllers
from rig.controllers.normal_force import NormalForceFeedback

def strike(number, frame):
    raise KeyboardInterrupt

def made(self, *given):
    init(self, *given)
    law = self.update

    def first(*asked):
        if due:
            signal.setitimer(signal.ITIMER_PROF, due.pop())  # s; in the frames: before, numba may swallow it
        return law(*asked)

    self.update = first

due, init = [], NormalForceFeedback.__init__
NormalForceFeedback.__init__ = made
local_controllers.WORTH = 10**12  # controllers stay in Python
signal.signal(signal.SIGPROF, strike)
scene, struck, draw = rig.load("belt_normal_force"), 0, random.Random(1)
rig.simulate(scene, 0.5)
for _ in range(4):
    due.append(draw.uniform(0.02, 0.1))
    try:
        rig.simulate(scene, 1000.0)
    except KeyboardInterrupt:
        struck += 1
print(struck)
"""


def test_no_ctrl_c_is_lost_in_the_compiled_loop():
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=300.0, check=True
    )
    assert done.stdout == "4\n"
    assert "ctypes callback" not in done.stderr
