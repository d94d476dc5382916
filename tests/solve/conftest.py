"""Small rigs for the solver, written as rows, and how they are run."""

import json
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rig.compiled.kernel import kernel
from rig.model import friction_law
from rig.model.assembly import Assembly
from rig.model.mode_sets import ModeSets
from rig.motion.motion import Motion
from rig.solve import forces, rosenbrock

NUM = json.loads((Path(__file__).parents[1] / "reference" / "num.json").read_text())


def oscillator(belt=None, load=None, law=None, start=None, **changes):
    """P1 of num.json, or one with other numbers: a mass on a belt, as an assembly that may be added to."""
    p = NUM["P1"]["params"] | changes
    a = Assembly("oscillator")
    a.coordinate("x", p["m"], p["c"], p["k"])
    a.patch("contact", {"x": 1.0}, belt or {"one": p["vb"]}, law or friction_law.coulomb(p["mus"], p["mud"]))
    a.normal("load", "contact", load or {"one": p["N"]})
    a.start |= NUM["P1"]["start"] if start is None else start
    return a


def p1(**changes):
    return oscillator(**changes).system()


def p2():
    p = NUM["P2"]["params"]
    return oscillator(law=friction_law.stribeck(p["mus"], p["mud"], p["vs"])).system()


def p3():
    """Mode coupling: x along the belt, z towards it from the preloaded position, N = F0 + k3 z may open."""
    p = NUM["P3"]["params"]
    a = Assembly("P3")
    a.coordinate("x", p["m"], p["cx"], p["kxx"])
    a.coordinate("z", p["m"], p["cz"], p["kzz"])
    a.stiffness["x", "z"] = a.stiffness["z", "x"] = p["kxz"]
    a.push("z", {"one": p["F0"]})
    a.patch("contact", {"x": 1.0}, {"one": p["vb"]}, friction_law.coulomb(p["mu"], p["mu"]))
    a.normal("load", "contact", {"one": p["F0"], "z": p["k3"]}, {"z": -1.0})
    a.start |= NUM["P3"]["start"]
    return a.system()


def p4():
    """P1 with a piezo stack: loop voltage U and current i of a series shunt with negative capacitance Cp / delta."""
    p = NUM["P4"]["params"]
    a = oscillator()
    delta, e, Cp = p["delta"], p["theta"], p["Cp"]
    a.stiffness["x", "x"] += e * e / Cp * delta / (1.0 + delta)
    a.push("x", {"U": e / (1.0 + delta)})
    a.network["U"] = {"i": (1.0 + delta) / Cp, "x'": -e / Cp}
    a.network["i"] = {"U": -1.0 / p["L"], "i": -p["R"] / p["L"]}
    return a.system()


def sine(a, name, amplitude, omega, phase=0.0):
    """A signal amplitude sin(omega t + phase), as two states; `name` is the sine."""
    a.signal(name, {f"{name}.cos": omega}, amplitude * math.sin(phase), "test")
    a.signal(f"{name}.cos", {name: -omega}, amplitude * math.cos(phase), "test")


def hc1():
    """P1 on a belt that runs to and fro."""
    case = NUM["HC1"]
    a = oscillator(belt={"belt": case["amplitude"]}, start={})
    sine(a, "belt", 1.0, case["omega"])
    return a.system()


def run(system, step_ms, duration, method="exact", outputs=None, **how):
    """One run in one call; event times [s], what they are, states at the ends of the steps, and the motion."""
    ticks = round(duration * 1e3 / step_ms)
    motion = Motion(system, round(step_ms * 1e6), method, outputs=outputs, **({"longest": ticks} | how))
    motion.advance(ticks)
    events = motion.events()
    return SimpleNamespace(
        motion=motion,
        times=np.array([(e.tick + e.place) * step_ms * 1e-3 for e in events]),
        what=[e.what for e in events],
        states=motion.states,
        mode_sets=motion.mode_sets_of_states,
        outputs=motion.outputs_at(motion.states, motion.mode_sets_of_states) if outputs else None,
        energy=motion.energy(),
    )


@kernel
def _write_slopes(tables, loan, mode_set, x, slopes, scratch):
    forces.inputs(tables, mode_set, x, loan.work.T, scratch)
    rosenbrock.input_slopes(tables, mode_set, x, loan.work.T, slopes, scratch)


@pytest.fixture(scope="session")
def input_slopes():
    """The slopes of the inputs over the state [inputs, n] in mode set `key` at x, as kernels evaluate them."""

    def slopes_of(system, key, x):
        mode_sets = ModeSets(system, 1e-3, [])
        mode_sets.add(key)
        slopes, scratch = np.full((system.inputs, system.n), np.nan), np.zeros((len(system.patches),) * 2)
        _write_slopes(mode_sets.handle, Motion(system, 1_000_000, "dopri5").loan, np.int32(0), x, slopes, scratch)
        return slopes

    return slopes_of


@pytest.fixture(scope="session")
def num():
    """Reference numbers."""
    return NUM


@pytest.fixture(scope="session")
def rigs():
    """Systems by name, and the parts to build others."""
    return SimpleNamespace(p1=p1, p2=p2, p3=p3, p4=p4, hc1=hc1, oscillator=oscillator, sine=sine)


@pytest.fixture(scope="session", name="run")
def run_fixture():
    return run
