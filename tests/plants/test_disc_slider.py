"""The slider on a flexible disc: modes of the disc, sliding equilibrium, eigenvalues, regions of instability, motion.

Liu and Ouyang, Meccanica 55 (2020), section 3. Numbers: tests/reference/liu_disc.json, by independent code; eigenvalues
and natural frequencies 1e-6. The equations are written down once more here, for scipy.
"""

import math

import numpy as np
import pytest
from reference import numbers
from scipy.integrate import quad, solve_ivp

import rig
from rig.analysis.cycles.averaged import averaged, mean_friction
from rig.effects.disc_modes import free_modes
from rig.model import friction_law
from rig.motion.motion import Motion
from rig.plants import disc_slider
from rig.stability.linearisation import sliding_key, steady

LIU = numbers("liu_disc")
BASE = rig.load("disc_slider").parameters.model_dump(exclude_none=True)
W0 = LIU["omega_ref"]


def parameters(case="b", F0=100.0, Om=2.0, zeta=5e-4, slope=0.0, **tables):
    """A point of the reference; `tables` are put in place of the scene's, None takes one out."""
    c = LIU["cases"][case]
    law = {"law": "exponential", "mu_static": c["mus"], "mu_kinetic": c["muk"], "decay": c["alpha"]}
    raw = BASE | {"drive": {"speed": Om}, "load": {"force": F0}, "disc": BASE["disc"] | {"damping_ratio": zeta}}
    raw |= {"friction": law if c["alpha"] else {"law": "constant", "mu": c["muk"]}} | ({"slope": {}} if slope else {})
    return disc_slider.Parameters.model_validate({k: v for k, v in (raw | tables).items() if v is not None})


def sliding(*point, **more):
    system = disc_slider.assemble(parameters(*point, **more), {}).system()
    return steady(system, sliding_key(system))


def growth(*point, **more):
    return sliding(*point, **more).eigenvalues()[0].real


def dithered(case, F0, Om, a, r=20.0):
    """Averaged sliding where a force on the slider shakes it with velocity a [m/s], to leading order."""
    w = r * W0
    force = {"on": "mass", "frequency": w / (2.0 * math.pi), "amplitude": a * w}
    system = disc_slider.assemble(parameters(case, F0, Om, dither=force), {}).system()
    sine, cosine = (system.names.index(f"dither.{name}") for name in ("sin", "cos"))
    return averaged(system, sine, cosine, a * w, leading=True)


# The disc by itself


def disc(**changes):
    return type(parameters().disc).model_validate(BASE["disc"] | changes)


def test_modes_are_those_of_the_reference():
    found = {(mode.circles, mode.diameters): mode for mode in free_modes(disc(modes=30))}
    for one in LIU["modes"]:
        mode = found[one["k"], one["l"]]
        assert mode.omega == pytest.approx(one["omega"], rel=1e-9)
        assert mode.wavenumber == pytest.approx(one["kappa"], rel=1e-9)
        shape = [mode.at(r) for r in (0.1, 0.12, 0.082)]
        assert shape == pytest.approx([one["R_r0"], one["R_b"], one["R_mid"]], rel=1e-9)


def test_modes_are_orthogonal_and_of_mass_one():
    one = disc(modes=61)
    found = free_modes(one)
    for mode in found:
        for other in (m for m in found if m.diameters == mode.diameters):
            around = one.areal * math.pi * (1.0 if mode.pair else 2.0)
            mass = quad(lambda r: mode.at(r) * other.at(r) * r, one.inner_radius, one.outer_radius, epsabs=1e-12)[0]  # noqa: B023
            assert around * mass == pytest.approx(1.0 if other is mode else 0.0, abs=1e-9)


def test_a_narrow_rim_vibrates_like_a_clamped_beam():
    """Without a circumference to speak of: k (b - a) = 1.8751, 4.6941; rigidity that of a plate."""
    found = free_modes(disc(inner_radius=0.118, modes=1))
    assert found[0].wavenumber * 0.002 == pytest.approx(1.8751, rel=0.01)


def test_critical_speed_and_compliance():
    found = free_modes(disc())
    assert min(m.omega / m.diameters for m in found if m.pair) == pytest.approx(LIU["critical_speed"], rel=1e-9)
    compliance = sum(m.at(0.1) ** 2 / m.omega**2 for m in found)
    assert compliance == pytest.approx(LIU["static_compliance_r0"], rel=1e-9)


# Sliding


@pytest.mark.parametrize("case", ["a", "b", "c"])
def test_equilibrium_and_eigenvalues_are_those_of_the_reference(case):
    for one in (p for p in LIU["jacobian_points"] if p["case"] == case):
        at = sliding(case, one["F0"], one["Om"])
        assert at.exists
        assert at.x[:9] == pytest.approx(one["q_e"], rel=1e-6, abs=1e-6 * max(map(abs, one["q_e"])))
        found = at.eigenvalues()
        expected = [complex(*value) for value in one["eigs"]]
        assert len(found) == 2 * len(expected)
        for value in expected:
            assert np.abs(found - value).min() < 1e-6 * abs(value)
        assert found[0].real == pytest.approx(one["max_re"], rel=1e-6)


def test_damping_and_slope_do_what_they_do_in_the_reference():
    for one in LIU["variants"]:
        found = growth(one["case"], one["F0"], one["Om"], one["zeta"], one["slope"])
        assert found == pytest.approx(one["max_re"], rel=1e-6, abs=1e-10)


def test_only_with_the_slope_nothing_comes_from_nowhere():
    """No friction, no dampers: no mode may grow, whatever the load and the speed; without the slope one does."""
    slider = BASE["slider"] | {"damping": 0.0, "normal_damping": 0.0}
    bare = {"slider": slider, "friction": {"law": "constant", "mu": 0.0}, "zeta": 0.0}
    for F0, Om in ((100.0, 2.0), (1000.0, 50.0), (200.0, 500.0)):
        assert abs(growth("a", F0, Om, slope=1.0, **bare)) < 1e-11
        assert growth("a", F0, Om, **bare) > 1e-4


@pytest.mark.parametrize("point", [("a", 100.0, 1000.0), ("b", 100.0, 2.0)])
def test_a_speed_that_the_scene_moves_gives_the_same_rig(point):
    """Its terms are products of states then."""
    system = disc_slider.assemble(parameters(*point, zeta=0.01), {"drive.speed": "ramped"}).system()
    assert {product.level for product in system.products} == {0, 1, 2}
    found = steady(system, sliding_key(system)).eigenvalues()
    assert np.sort_complex(found) == pytest.approx(np.sort_complex(sliding(*point, zeta=0.01).eigenvalues()), rel=1e-10)


def test_modes_are_shown_beside_those_of_the_free_disc():
    found = rig.modes(rig.load("disc_slider"))
    assert [round(2.0 * math.pi * hertz) for hertz in found.free.values()] == [1492, 1517, 1517, 1824, 1824, 2774, 2774]
    assert "disc, 0 circles, 3 diameters, sine" in found.text()
    assert len(found.sliding.modes) == 9
    assert found.sliding.equilibrium["angle"] == pytest.approx(10.0 * found.sliding.equilibrium["displacement"])


# Regions of instability


@pytest.mark.parametrize("case", ["a", "b", "c"])
def test_edges_of_instability_over_speed_are_those_of_the_reference(case):
    for one in (p for p in LIU["RI_edges"] if p["case"] == case):
        assert (growth(case, one["F0"], 0.5) > 0.0) == one["unstable_at_start"]
        for edge, becomes_unstable in one["edges"]:
            below, above = (growth(case, one["F0"], edge + d) for d in (-1e-3, 1e-3))
            assert (below < 0.0, above > 0.0) == (becomes_unstable, becomes_unstable)
        if not one["edges"]:
            assert min(growth(case, one["F0"], Om) for Om in (1.0, 30.0, 300.0, 900.0, 1290.0)) > 0.0


def test_edges_of_instability_under_dither_are_those_of_the_reference():
    """Case c at 5.994 rad/s: the sliver of a / V just above 1, so sliding becomes stable there, and unstable at 6.0.

    The reference's list has the edge, with the wrong sense.
    """
    for one in LIU["RI_edges_dither"]:
        for edge, becomes_unstable in one["edges"]:
            below, above = (dithered(one["case"], one["F0"], edge + d, one["a"]) for d in (-1e-3, 1e-3))
            sense = becomes_unstable if (one["case"], round(edge)) != ("c", 6) or edge > 6.0 else False
            grows = [at.eigenvalues()[0].real > 0.0 for at in (below, above)]
            assert grows == ([False, True] if sense else [True, False])


def test_averaged_friction_is_that_of_the_reference():
    for one in LIU["averaged_friction_values"]:
        law = friction_law.stribeck(one["fric"]["mus"], one["fric"]["muk"], 1.0 / one["fric"]["alpha"])
        mean, by_speed, _ = mean_friction(law, one["v"], 1.0, one["a"])
        assert mean == pytest.approx(one["mean"], rel=1e-9)
        assert by_speed == pytest.approx(one["dmean_dv"], rel=1e-5)  # the reference's by differences


def test_critical_dither_by_averaging_is_that_of_the_reference():
    for one in LIU["acrit_avg"]:
        V = one["V"]
        assert growth(one["case"], one["F0"], one["Om"]) == pytest.approx(one["plain"], rel=1e-6)
        for ratio in one["sign_changes_a_over_V"]:
            below, above = (
                dithered(one["case"], one["F0"], one["Om"], V * ratio * f).eigenvalues()[0].real
                for f in (1.0 - 1e-5, 1.0 + 1e-5)
            )
            assert below * above < 0.0
        assert one["sign_changes_a_over_V"][-1] == one["a_crit_over_V"]
        assert dithered(one["case"], one["F0"], one["Om"], 2.0 * V).eigenvalues()[0].real < 0.0


# Motion


def field(p, speed=None):
    """The equations of the paper without the rig's code: x = [q, q'], slip towards +; `speed`: Omega over time."""
    modes, c, r0 = free_modes(p.disc), p.slider, p.slider.radius
    law = p.friction.friction()
    l = np.array([m.diameters for m in modes])
    om = np.array([m.omega for m in modes])
    R = np.array([m.at(r0) for m in modes])
    zeta, kc, ki, h = p.disc.damping_ratio, c.contact, c.inclined, p.disc.thickness
    turn = speed or (lambda t: (p.drive.speed, 0.0))

    def rate(t, x):
        q, v = x[:9], x[9:]
        C, S = np.array([q[2], q[3], q[5], q[7]]), np.array([0.0, q[4], q[6], q[8]])
        dC, dS = np.array([v[2], v[3], v[5], v[7]]), np.array([0.0, v[4], v[6], v[8]])
        Om, dOm = turn(t)
        phi = q[0] / r0 if p.geometry else 0.0
        cos, sin = np.cos(l * phi), np.sin(l * phi)
        N = kc * (R @ (C * cos + S * sin) - q[1])
        T = law.mu(r0 * Om - v[0]) * N
        M = h * T / (2.0 * r0)
        slope = N * (R * l) @ (S * cos - C * sin) / r0 if p.slope else 0.0
        s = T - slope - c.damping * v[0] - c.tangential * q[0] - 0.5 * ki * (q[0] - q[1])
        u = N - p.load.force - c.normal_damping * v[1] - 0.5 * ki * (q[1] - q[0])
        damp = 2.0 * zeta * om
        aC = -R * (N * cos + M * l * sin) - 2 * l * Om * dS - l * dOm * S - (om**2 - (l * Om) ** 2) * C
        aS = -R * (N * sin - M * l * cos) + 2 * l * Om * dC + l * dOm * C - (om**2 - (l * Om) ** 2) * S
        aC -= damp * (dC + l * Om * S)
        aS -= damp * (dS - l * Om * C)
        return np.concatenate([v, [s / c.mass, u / c.mass, aC[0], aC[1], aS[1], aC[2], aS[2], aC[3], aS[3]]])

    return rate


def motion(p, seconds, step_ms=0.1, moved=None, start=(), **how):
    system = disc_slider.assemble(p, moved or {}).system()
    ticks = round(seconds * 1e3 / step_ms)
    m = Motion(system, round(step_ms * 1e6), how.pop("method", "dopri5"), longest=ticks, **how)
    for i, value in start.items() if isinstance(start, dict) else enumerate(start):
        m.write(i, value)
    m.advance(ticks)
    return m


FAR = np.array([0.03, -0.004, -5e-5, -7e-5, 2e-5, -5e-5, 1e-5, -2e-5, 2e-5] + [0.0] * 9)


def same_end(m, rate, seconds, rel=1e-8):
    """The motion ends where scipy does, from a third of a radian off."""
    end = solve_ivp(rate, (0.0, seconds), FAR, "DOP853", rtol=1e-12, atol=1e-16).y[:, -1]
    assert not m.events()
    for part in (slice(0, 9), slice(9, 18)):
        assert m.x[part] == pytest.approx(end[part], rel=rel, abs=rel * abs(end[part]).max())
    assert abs(m.energy()["error"]) < 1e-9


@pytest.mark.parametrize(
    "tables", [{}, {"slope": 1.0}, {"slope": 1.0, "geometry": None}], ids=["paper", "slope", "flat"]
)
def test_motion_is_that_of_the_equations_in_scipy(tables):
    """The disc turning fast."""
    p = parameters("b", 300.0, 300.0, **tables)
    same_end(motion(p, 0.03, tolerance=1e-11, start=FAR), field(p), 0.03)


def test_a_disc_that_runs_up_moves_as_in_scipy():
    p = parameters("b", 300.0, 300.0)
    slope = disc_slider.assemble(p, {"drive.speed": "ramped"}).names.index("drive.slope")
    found = motion(
        p, 0.03, tolerance=1e-11, start={**dict(enumerate(FAR)), slope: 1e4}, moved={"drive.speed": "ramped"}
    )
    same_end(found, field(p, lambda t: (300.0 + 1e4 * t, 1e4)), 0.03)


def test_without_geometry_and_with_constant_friction_exact_serves():
    p = parameters("a", 100.0, 1000.0, geometry=None)
    same_end(motion(p, 0.03, method="exact", start=FAR), field(p), 0.03)
    with pytest.raises(ValueError, match="use auto"):
        motion(parameters("a", 100.0, 1000.0), 0.05, method="exact")
