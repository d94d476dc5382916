"""Races beyond a mass on a belt: a flexible disc, a map, a loop with a controller, and that loop paced."""

from __future__ import annotations

import importlib.util
import math
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import zenoh
from problems import timed
from scipy.integrate import solve_ivp

import rig
from rig.analysis.map import job
from rig.analysis.map.row import units
from rig.bench.live import supervise
from rig.bus.link import configuration
from rig.model.singular import assembled
from rig.motion.motion import Motion
from rig.solve.records import CLOSED, SLIP_PLUS, STICK

Array = Any


class Raced(NamedTuple):
    """A line of the page: what is measured, by whom and how, the error, the figure and its unit."""

    what: str
    who: str
    error: float
    figure: float
    unit: str


class Equations:
    """x' = A x + b T of a rig in one mode set as one would write it by hand: products of states, friction in slip."""

    def __init__(self, system: Any, sticks: bool) -> None:
        self.m = assembled(system, system.key([STICK if sticks else SLIP_PLUS], [CLOSED], []))
        self.law, self.w, self.sticks = system.patches[0].law, system.slip_rows[0], sticks
        self.factors = [[f.index for f in p.factors] for p in system.products]

    def inputs(self, x: Array) -> Array:
        """T at x."""
        values = x.tolist()
        T = np.array([0.0, *(math.prod([values[i] for i in at]) for at in self.factors)])
        if not self.sticks:
            T[0] = self.law.mu(max(float(self.w @ x), 0.0)) * float(self.m.normal[0] @ x + self.m.normal_t[0] @ T)
        return T

    def rates(self, t: float, x: Array) -> Array:
        """x'."""
        return self.m.A @ x + self.m.b @ self.inputs(x)

    def left(self, t: float, x: Array) -> float:
        """What falls to zero where the mode set ends: the slip speed, or what friction can still hold."""
        if not self.sticks:
            return float(self.w @ x)
        T = self.inputs(x)
        held, load = (
            rows[0] @ x + over_t[0] @ T
            for rows, over_t in ((self.m.friction, self.m.friction_t), (self.m.normal, self.m.normal_t))
        )
        return float(self.law.static * load - abs(held))


def by_scipy(system: Any, seconds: float, rtol: float) -> list[float]:
    """The times at which stick of the lever begins, from a standing start."""
    both = {sticks: Equations(system, sticks) for sticks in (True, False)}
    t, x, sticks, begun = 0.0, system.start.copy(), True, list[float]()
    x[2] -= (both[True].w @ x) / both[True].w[2]
    while t < seconds:
        equations = both[sticks]

        def left(t: float, x: Array, e: Equations = equations, begin: float = t) -> float:
            return e.left(t, x) if t > begin + 1e-4 else 1.0

        left.terminal, left.direction = True, -1  # type: ignore[attr-defined]
        s = solve_ivp(equations.rates, (t, seconds), x, method="DOP853", rtol=rtol, atol=1e-3 * rtol, events=left)
        t, x = float(s.t[-1]), s.y[:, -1]
        sticks = not sticks
        begun += [t] * (sticks and t < seconds)
    return begun


def lever_map() -> list[Raced]:
    """Points of the lever's map a second and core; by scipy from twelve cycles of each of three points."""
    axis = ("drive.speed=0.5 rpm:8 rpm:100", "load.force=10 N:30 N:100")
    work = units(job(rig.load("lever"), *axis, runs=("up", "down")))
    assert work.prepare is not None
    work.prepare()
    work.compute(0)
    begin = time.process_time()
    for row in (20, 50, 80):
        work.compute(row)
    rate = 300 / (time.process_time() - begin)
    begin, speeds, off = time.process_time(), (1.0, 2.0, 4.0), 0.0
    for speed in speeds:
        scene = rig.load("lever", {"drive.speed": f"{speed} rpm", "load.force": 20.0})
        begun = by_scipy(scene.assemble().system(), 12 * rig.limit_cycle(scene).period, 1e-7)
        off = max(off, abs(begun[-1] - begun[-2] - rig.limit_cycle(scene).period) / rig.limit_cycle(scene).period)
    own = 3 * timed(lambda: rig.limit_cycle(scene))[1]
    theirs = len(speeds) / (time.process_time() - begin - own)
    what = "map of the lever, 100 x 100 points, up and down"
    return [
        Raced(what, "friction-rig, one core", 2e-6, rate, "points/s"),
        Raced(what, "scipy, DOP853 at 1e-7, twelve cycles a point and run", off, theirs / 2.0, "points/s"),
    ]


def disc(seconds: float = 0.2) -> list[Raced]:
    """The slider on the flexible disc in slip that grows; errors of the slider's place at the end, of its range."""
    system = rig.load("disc_slider").assemble().system()
    m, law, w = assembled(system, system.key([SLIP_PLUS], [CLOSED], [])), system.patches[0].law, system.slip_rows[0]
    waves = 10.0 * np.array([1, 1, 2, 2, 3, 3])
    T = np.zeros(system.inputs)

    def rates(t: float, x: Array) -> Array:
        shape = np.sin(waves * x[0])
        shape[::2] = np.cos(waves[::2] * x[0]) - 1.0
        T[0], T[1:7] = 0.0, x[3:9] * shape
        T[7:] = 0.0
        N = m.normal[0] @ x + m.normal_t[0] @ T
        T[0] = law.mu(max(w @ x, 0.0)) * N
        T[7:13], T[13:] = N * shape, T[0] * shape[[1, 0, 3, 2, 5, 4]]
        return m.A @ x + m.b @ T

    def theirs(rtol: float) -> Array:
        return solve_ivp(rates, (0.0, seconds), system.start, method="DOP853", rtol=rtol, atol=1e-6 * rtol).y[0]

    path, what = theirs(1e-12), f"slider on the flexible disc, {seconds:g} s in slip"
    size, lines = float(np.ptp(path)), []
    for method, tolerance in (("dopri5", 1e-7), ("dop853", 2e-6), ("dop853", 1e-10)):
        ticks = round(seconds * 1e4)
        motion = Motion(system, 100_000, method, tolerance=tolerance, with_energy=False, longest=ticks)

        def run(motion: Motion = motion, ticks: int = ticks) -> float:
            motion.restart(system.start)
            motion.advance(ticks)
            return float(motion.x[0])

        value, spent = timed(run)
        lines.append(
            Raced(what, f"friction-rig, {method} at {tolerance:.0e}", abs(value - path[-1]) / size, spent, "s")
        )
    for rtol in (1e-7, 1e-9):
        value, spent = timed(lambda rtol=rtol: theirs(rtol)[-1])
        lines.append(Raced(what, f"scipy, DOP853 at {rtol:.0e}", abs(value - path[-1]) / size, spent, "s"))
    return lines


def loop() -> list[Raced]:
    """Steps of a loop at 1 kHz with a controller in Python, in processor time: between runs of 10 s and of 20 s."""
    what = "mass on a belt, 1 kHz, controller in Python"
    lines = []
    for changes, who in (
        ({}, "two sensors, outputs kept"),
        ({"controllers.nf": "none"}, "the same without the controller"),
    ):
        scene = rig.load("belt_normal_force", changes)
        spent = [timed(lambda s=s, scene=scene: rig.simulate(scene, duration=s))[1] for s in (10.0, 20.0)]
        lines.append(Raced(what, f"friction-rig, {who}", math.nan, 1e4 / (spent[1] - spent[0]), "steps/s"))
    if importlib.util.find_spec("mujoco"):
        import mujoco

        model = mujoco.MjModel.from_xml_string("""<mujoco><option timestep="0.001" integrator="implicitfast"/>
            <worldbody><body><joint name="x" type="slide" axis="1 0 0" frictionloss="1"/>
            <geom type="sphere" size="0.01" mass="1"/></body></worldbody>
            <actuator><motor joint="x"/></actuator></mujoco>""")
        data = mujoco.MjData(model)

        def run() -> None:
            for _ in range(10_000):
                data.ctrl[0] = 20.0 - 200.0 * data.qvel[0]
                mujoco.mj_step(model, data)

        lines.append(
            Raced(what, "MuJoCo, joint with dry friction, step 1 ms", math.nan, 1e4 / timed(run)[1], "steps/s")
        )
    return lines


_ECHO = """
import socket
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1], flush=True)
s.settimeout(20)
while (got := s.recvfrom(64))[0]: s.sendto(*got)
"""


_ZENOH_ECHO = """
import sys, zenoh
from rig.bus.link import configuration
with zenoh.open(configuration("peer", sys.argv[1], None)) as session:
    back = session.declare_publisher("back")
    there = session.declare_subscriber("there", lambda sample: back.put(sample.payload))
    print("ready", flush=True)
    sys.stdin.read()
"""


def by_zenoh(count: int) -> list[int]:
    """Times [ns] from a message to its echo by another process over Zenoh alone."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        where = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    trips, heard, command = [], threading.Event(), [sys.executable, "-c", _ZENOH_ECHO, where]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as echo:
        assert echo.stdout is not None
        echo.stdout.readline()
        with zenoh.open(configuration("peer", None, where)) as session:
            _back = session.declare_subscriber("back", lambda _: heard.set())
            there = session.declare_publisher("there")
            time.sleep(1.0)  # until both know of each other
            for _ in range(count):
                begin = time.perf_counter_ns()
                there.put(bytes(32))
                if heard.wait(5.0):
                    trips.append(time.perf_counter_ns() - begin)
                heard.clear()
                time.sleep(1e-3)
    return trips


def paced(seconds: float = 5.0) -> list[Raced]:
    """From a step to its answer at 1 kHz, wall time: our loop with two sensors and a recorder beside a bare socket, and
    beside the bus alone.
    """
    trips = []
    with subprocess.Popen([sys.executable, "-c", _ECHO], stdout=subprocess.PIPE, text=True) as echo:
        assert echo.stdout is not None
        there = ("127.0.0.1", int(echo.stdout.readline()))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
            own.settimeout(5.0)
            for _ in range(round(1e3 * seconds)):
                begin = time.perf_counter_ns()
                own.sendto(bytes(32), there)
                own.recv(64)
                trips.append(time.perf_counter_ns() - begin)
                time.sleep(1e-3)
            own.sendto(b"", there)
    bare, bus = (float(np.median(times)) * 1e-3 for times in (trips, by_zenoh(round(1e3 * seconds))))
    with TemporaryDirectory() as folder:
        run = supervise.run(
            rig.load("belt_normal_force"), duration=seconds, out=Path(folder) / "loop.mcap", say=lambda _: None
        )
        trip = run.to_json()["round_trip"]
    what = "step to answer at 1 kHz between two processes, median"
    answers = (("friction-rig, controller and recorder", trip["p50"]), ("Zenoh alone", bus), ("bare UDP socket", bare))
    return [Raced(what, who, math.nan, figure, "us") for who, figure in answers]


RACES = (disc, lever_map, loop, paced)
