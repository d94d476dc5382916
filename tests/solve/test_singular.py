"""Mode sets without a single solution are told for what they are, and contacts that hold one motion twice share it."""

import numpy as np
import pytest

import rig
from rig.errors import Jammed, Singular
from rig.model import friction_law
from rig.model.assembly import Assembly
from rig.model.formulation import assemble
from rig.model.singular import assembled
from rig.motion.motion import Motion
from rig.scenes.scene import Scene
from rig.solve.records import SLIP_PLUS, STICK
from rig.stability.report import stability_report

MASS, STIFFNESS, PUSH = 2.0, 50.0, 3.0


def body(mass=MASS, inertia=0.0, mu=0.5):
    """One mass pressed on a belt, N = 20 N + inertia x''."""
    a = Assembly(title="test")
    a.coordinate("x", mass, 0.0, STIFFNESS)
    a.patch("contact", {"x": 1.0}, {"one": 0.1}, friction_law.coulomb(mu, mu))
    a.normal("load", "contact", {"one": 20.0}, inertia={"x": inertia} if inertia else {})
    return a


def clamped(tilt=0.0):
    """A mass between two pads that both hold x; the second one sees a share `tilt` of y as well."""
    a = Assembly(title="test")
    a.coordinate("x", MASS, 0.0, STIFFNESS)
    a.coordinate("y", 1.0, 0.0, 10.0)
    a.push("x", {"one": PUSH})
    for name, along in (("inner", {"x": 1.0}), ("outer", {"x": 1.0, "y": tilt} if tilt else {"x": 1.0})):
        a.patch(name, along, {"one": 0.1}, friction_law.coulomb(0.5, 0.5))
        a.normal(f"{name} load", name, {"one": 20.0})
    return a.system()


def test_friction_that_takes_up_all_of_the_inertia_jams():
    """Me = m - mu g = 2 - 0.5 * 4 = 0, in slip+ alone."""
    system = body(inertia=4.0).system()
    with pytest.raises(Singular, match="jams: friction takes up all of the inertia") as raised:
        assembled(system, system.key([SLIP_PLUS], [0], []))
    assert raised.value.jams
    assert [one for one in stability_report(system, "exact", 1e-3) if "jams in contact slip" in one.what]


def test_a_run_a_cycle_and_modes_of_such_a_rig_end_in_a_named_error(monkeypatch):
    a = body(inertia=4.0)
    with pytest.raises(Jammed, match="takes up all of the inertia"):
        Motion(a.system(), 1_000_000, "exact")
    monkeypatch.setattr(Scene, "assemble", lambda *_: a)
    with pytest.raises(Singular, match="jams"):
        rig.limit_cycle(rig.load("belt"))


@pytest.mark.parametrize("tilt", [0.0, 1e-12, -1e-12])
def test_contacts_that_hold_the_same_motion_share_the_force(tilt):
    """0 = F - c x + T1 + T2 with T1 = T2, the least of all forces that hold it; nothing moves, whatever rounds."""
    system = clamped(tilt)
    modes = assemble(system, system.key([STICK, STICK], [0, 0], []))
    x = np.zeros(system.n)
    x[system.names.index("x")], x[system.one] = 0.02, 1.0
    need = STIFFNESS * 0.02 - PUSH
    assert np.abs(modes.friction @ x) == pytest.approx([abs(need) / 2.0] * 2, rel=1e-9)
    rate = modes.A @ x
    assert rate[system.names.index("x'")] == pytest.approx(0.0, abs=1e-9)
    assert np.abs(rate[system.names.index("y'")]) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("tilt", [0.0, 1e-12])
def test_landing_on_both_contacts_takes_the_slip_speed_and_nothing_else(tilt):
    system = clamped(tilt)
    modes = assemble(system, system.key([STICK, STICK], [0, 0], []))
    x = np.zeros(system.n)
    x[system.names.index("x'")], x[system.names.index("y'")], x[system.one] = 0.7, 0.3, 1.0
    landed = modes.landing @ x
    assert landed[system.names.index("x'")] == pytest.approx(0.1, rel=1e-9)
    assert landed[system.names.index("y'")] == pytest.approx(0.3, rel=1e-9)
