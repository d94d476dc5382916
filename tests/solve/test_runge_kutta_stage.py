"""What a stage sums without the friction force is the same motion: every law, under loads that depend on the motion."""

import numpy as np
import pytest

from rig.model import friction_law
from rig.model.assembly import Assembly
from rig.model.method import ADAPTIVE
from rig.motion.motion import Motion

LAWS = {
    "stribeck": friction_law.stribeck(0.4, 0.25, 0.05),
    "falling": friction_law.falling(0.4, 0.8, 0.1),
    "table": friction_law.table(np.array([0.0, 0.1, 0.3, 1.0]), np.array([0.4, 0.3, 0.25, 0.2]), 0.4),
    "seal": friction_law.seal(0.3, 8.0, 0.05, 0.01),
    "smooth": friction_law.smoothed(friction_law.stribeck(0.4, 0.25, 0.05), 0.02),
}


def rig_of(law, patches=1, tied=0.0):
    """Two masses with normal motion: the load rests on place and speed, and on the force itself where `tied`."""
    a = Assembly("stage")
    for p in range(patches):
        x, z = f"x{p}", f"z{p}"
        a.coordinate(x, 1.0 + 0.3 * p, 2.0, 900.0)
        a.coordinate(z, 0.7, 1.0, 400.0)
        a.stiffness[x, z] = a.stiffness[z, x] = -60.0
        a.patch(f"contact {p}", {x: 1.0, z: 0.1}, {"one": 0.5 + 0.1 * p}, law)
        inertia = {z: -tied} if tied else None
        a.normal(f"load {p}", f"contact {p}", {"one": 12.0, z: -300.0, f"{z}'": -4.0}, {z: 1.0}, inertia=inertia)
        a.start |= {x: 0.002, z: 0.004, f"{x}'": -0.1, f"{z}'": 0.05}
    return a.system()


def end(system, method, **how):
    motion = Motion(system, 1_000_000, method, longest=100, **how)
    motion.advance(100)
    return motion.x.copy()


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize(
    ("method", "patches", "tied"), [*((m, 1, t) for m in ADAPTIVE for t in (0.0, 0.1)), ("dopri5", 2, 0.0)]
)
def test_adaptive_methods_agree_with_rk4(name, patches, tied, method):
    system = rig_of(LAWS[name], patches, tied)
    ours, other = end(system, method, tolerance=1e-12), end(system, "rk4", substeps=100)
    assert ours == pytest.approx(other, rel=1e-8, abs=1e-10)
    assert not system.linear
    assert np.abs(ours - end(system, method, tolerance=1e-3)).max() > 1e-12  # it is this method that is asked
