"""Sectors: friction by place, against an independent integrator; the edges are events."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rig.model import friction_law
from rig.model.assembly import Assembly
from rig.motion.motion import Motion
from rig.qualify.torture.case import Sectored, sectored

MS = 1_000_000
SPEED, RADIUS, EDGE = 0.3, 0.05, 2.0
MU = (0.3, 0.15)


ROUGH, SMOOTH = friction_law.coulomb(0.3, 0.3), friction_law.coulomb(0.15, 0.15)


def rig(first=ROUGH, second=SMOOTH, place=0.5):
    """A mass on a disc with two materials; the pin's own motion moves its place on the disc."""
    a = Assembly("sectors")
    a.coordinate("x", 1.0, 2.0, 400.0)
    a.signal("turn", {"one": SPEED / RADIUS}, place, "sectors")
    a.patch("contact", {"x": 1.0}, {"one": SPEED}, first)
    a.normal("load", "contact", {"one": 20.0})
    a.sector("disc", "contact", {"turn": 1.0, "x": -1.0 / RADIUS}, "turn", 2.0 * math.pi, (0.0, EDGE), (first, second))
    return a


def reference(duration):
    """(times of the edges, x and x' at the end) by DOP853 with the edges as events."""
    t, y, material, edges = 0.0, [0.0, 0.0, 0.5], 0, []
    while t < duration:
        end = (EDGE, 2.0 * math.pi)[material]

        def edge(_, y, end=end):
            return y[2] - y[0] / RADIUS - end

        edge.terminal, edge.direction = True, 1.0
        mu = MU[material]

        def rate(_, y, mu=mu):
            return [y[1], mu * 20.0 - 2.0 * y[1] - 400.0 * y[0], SPEED / RADIUS]

        part = solve_ivp(rate, (t, duration), y, method="DOP853", rtol=1e-12, atol=1e-13, events=edge)
        t, y = part.t[-1], part.y[:, -1].copy()
        if part.status == 1:
            edges.append(t)
            if material == 1:
                y[2] -= 2.0 * math.pi
            material = 1 - material
    return edges, y[:2]


@pytest.mark.parametrize(
    ("method", "step_ns", "bound"), [("exact", MS, 1e-9), ("exact", 5 * MS, 1e-9), ("rk4", MS, 1e-7)]
)
def test_the_edges_are_met_when_they_pass_the_pin(method, step_ns, bound):
    system = rig().system()
    motion = Motion(system, step_ns, method)
    motion.advance(5000 * MS // step_ns)
    edges, end = reference(5.0)
    assert len(edges) >= 9
    assert [event.what for event in motion.events()] == ["disc enters the next"] * len(edges)
    assert [(event.tick + event.place) * step_ns * 1e-9 for event in motion.events()] == pytest.approx(edges, abs=bound)
    assert motion.x[:2] == pytest.approx(end, abs=bound)
    place = motion.states @ system.sectors[0].row
    assert place.min() >= -1e-12
    assert place.max() < 2.0 * math.pi
    assert abs(motion.energy()["error"]) < 1e-9


def test_a_stuck_contact_stays_in_its_sector():
    """Stuck from the start: the place stands still, also where the disc has turned on by more than the sector."""
    sticky, slick = friction_law.coulomb(5.0, 0.3), friction_law.coulomb(0.1, 0.1)
    a = rig(sticky, slick, place=1.9)
    a.start |= {"x'": SPEED}
    motion = Motion(a.system(), MS, "exact")
    motion.advance(200)
    assert motion.events() == []
    assert motion.system.describe(motion.key) == "contact stick, disc 1"


def test_laws_over_speed_change_at_the_edge_too():
    first, second = friction_law.stribeck(0.4, 0.2, 0.1), friction_law.coulomb(0.1, 0.1)
    system = rig(first, second).system()
    motion = Motion(system, MS, "dopri5", tolerance=1e-9, outputs=[{"T:contact": 1.0}, {"w:contact": 1.0}])
    motion.advance(2000)
    found = motion.outputs_at(motion.states, motion.mode_sets_of_states)
    place = motion.states @ system.sectors[0].row
    slips = found[:, 1] > 1e-9
    in_second = place >= EDGE
    assert (slips & in_second).any()
    assert (slips & ~in_second).any()
    assert found[slips & in_second, 0] == pytest.approx(2.0, rel=1e-12)
    w = found[slips & ~in_second, 1]
    assert found[slips & ~in_second, 0] == pytest.approx(20.0 * (0.2 + 0.2 * np.exp(-w / 0.1)), rel=1e-12)


def test_changed_sectors_are_entered_where_the_pin_is():
    motion = Motion(rig().system(), MS, "exact")
    motion.advance(200)
    sector, turned = motion.system.sectors[0], motion.x.copy()
    assert 1.0 < sector.row @ motion.x < EDGE
    turned[motion.system.names.index("turn")] -= 2.0 * math.pi
    assert sector.at(turned) == sector.at(motion.x) == 0
    assert motion.system.describe(motion.key).endswith("disc 1")
    a = rig()
    a.sectors[0] = (*a.sectors[0][:5], (0.0, 1.0), a.sectors[0][6])
    motion.replace(motion.ready(a.system()))
    assert motion.system.describe(motion.key).endswith("disc 2")


@pytest.mark.parametrize("step", [0.1, 0.25, 1.0])
def test_rounding_at_an_edge_does_not_throw_the_place_back(run, step):
    """Edges at ends of steps, where the place may be a rounding error short of the edge that it has passed."""
    p = Sectored(sliding=True, mu_piece=0.25, piece=0.0001)
    duration = 1.995
    found = run(sectored(p, {}).system(), step, duration, cap=100)
    entered = [what for what in found.what if what.startswith("lane")]
    whole, rest = divmod(p.belt * duration, p.piece + p.gap)
    assert entered == ["lane enters the next"] * int(2 * whole + (rest > p.piece))


def test_events_at_the_ends_of_steps_take_no_time(rigs):
    """A mass slides steadily over sectors whose edges come every tenth step, on the sample."""
    a = rigs.oscillator(c=0.0, start={"x": 0.0025, "x'": 0.0})
    a.signal("turn", {"one": 0.05}, 0.0025, "test")
    law = friction_law.coulomb(0.4, 0.25)
    a.sector(
        "lane",
        "contact",
        {"turn": 1.0, "x": -1.0},
        "turn",
        0.001,
        (0.0, 0.0005),
        (law, friction_law.coulomb(0.3, 0.25)),
    )
    motion = Motion(a.system(), 1_000_000, "rk4", longest=1000)
    motion.advance(995)
    times = np.array([event.tick + event.place for event in motion.events()])
    assert times == pytest.approx(10.0 * np.arange(1, 100), abs=1e-6)
    assert motion.states[-1, 0] == pytest.approx(0.0025, rel=1e-12)
