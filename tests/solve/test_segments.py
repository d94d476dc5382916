"""What the sensors get: smooth pieces that tile a frame and are the signals, jumps only between them."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rig import scenes
from rig.motion.motion import Motion
from rig.solve.segment_output import DEGREE

ROWS = [{"x'": 1.0}, {"x''": 1.0}, {"T:contact": 1.0}, {"w:contact": 1.0}]


def frames(system, method, step_ns, steps, count, **how):
    """Of each frame: start and length of its segments [s], coefficients, outputs at the ends of the steps, events."""
    motion = Motion(system, step_ns, method, outputs=ROWS, read=len(ROWS), longest=steps, **how)
    for _ in range(count):
        motion.advance(steps)
        n = motion.segments.count[0]
        s = motion.segments
        yield (
            s.start[:n].copy(),
            s.length[:n].copy(),
            s.coef[:n].copy(),
            motion.outputs_at(motion.states, motion.mode_sets_of_states),
            [(e.tick + e.place) * step_ns * 1e-9 for e in motion.events()],
            (motion.tick - steps) * step_ns * 1e-9,
        )


CASES = [
    ("p1", "exact", {}),
    ("p2", "dopri5", {"tolerance": 1e-9}),
    ("p2", "dop853", {"tolerance": 1e-9}),
    ("p2", "rosenbrock", {"tolerance": 1e-9}),
    ("p2", "rk4", {"substeps": 4}),
]


@pytest.mark.parametrize(("name", "method", "how"), CASES, ids=[c[1] for c in CASES])
def test_segments_tile_the_frame_and_carry_the_signals(rigs, name, method, how):
    step_ns, steps = 250_000, 4
    h, seen = step_ns * 1e-9, 0
    accuracy = {"exact": 1e-9, "dopri5": 1e-6, "dop853": 1e-6, "rosenbrock": 1e-6, "rk4": 1e-6}[method]
    scale = np.array([0.1, 4.0, 4.0, 0.1])
    for start, length, coef, outputs, events, origin in frames(
        getattr(rigs, name)(), method, step_ns, steps, 600, **how
    ):
        end = start + length
        assert np.all(length > 0.0)
        assert start[0] == 0.0
        assert start[1:] == pytest.approx(end[:-1], abs=1e-15)
        assert end[-1] == pytest.approx(steps * h, rel=1e-12)
        for k in range(steps):  # at the end of each step a segment ends, on the value of the record
            last = np.argmin(np.abs(end - (k + 1) * h))
            assert end[last] == pytest.approx((k + 1) * h, abs=1e-13)
            assert np.all(np.abs(coef[last].sum(axis=-1) - outputs[k]) < accuracy * scale)
        for t in events:  # and so at each event
            assert np.abs(end - (t - origin)).min() < 1e-12
            seen += 1
        first, after = coef[:, [0, 3]].sum(axis=-1)[:-1], coef[1:][:, [0, 3], 0]
        assert np.abs(first - after).max(initial=0.0) < accuracy * 0.1  # velocity and slip speed do not jump
    assert seen > 3


def test_acceleration_jumps_between_segments(rigs, num):
    """Static friction gives way to kinetic: the acceleration falls by (mu_s - mu_d) N / m at a release."""
    jumps = []
    for _, _, coef, _, events, _ in frames(rigs.p1(), "exact", 1_000_000, 1, 400):
        if events:
            before, after = coef[:, 1].sum(axis=-1)[:-1], coef[1:, 1, 0]
            jumps.append(np.abs(after - before).max())
    assert jumps[0] == pytest.approx((0.4 - 0.25) * 10.0, rel=1e-9)


def test_a_segment_is_a_polynomial_of_the_motion_inside_it(rigs, run):
    """Between the ends too: the velocity at a hundred places of each frame is that of a run with a hundred times finer
    steps."""
    fine = run(rigs.p1(), 0.01, 0.4).states[:, 1]
    for i, (start, length, coef, *_) in enumerate(frames(rigs.p1(), "exact", 1_000_000, 1, 400)):
        places = np.arange(1, 100) * 1e-5
        at = np.searchsorted(start + length, places - 1e-12)
        u = (places - start[at]) / length[at]
        values = (coef[at, 0] * u[:, None] ** np.arange(DEGREE + 1)).sum(axis=-1)
        assert values == pytest.approx(fine[100 * i : 100 * i + 99], abs=1e-10)


FAST = [
    ("belt_shunt", {"shunt.resistance": 1e8}),
    ("belt_shunt", {"shunt.inductance": 0.0, "shunt.resistance": 0.002}),
    ("belt_c", {"load.lag": 1e-9}),
    ("belt_c", {"drive.lag": 1e-9}),
    ("belt_c", {"body.damping": 1e9}),
    ("brake_shunt", {"shunt.connected": True, "shunt.inductance": 0.0, "shunt.resistance": 0.5}),
]


def moved(A, time, x):
    """exp(A time) x by squaring in extended precision; scipy's loses nine digits to the largest of these matrices."""
    cell = A * (np.longdouble(time) / np.longdouble(2) ** 60)
    E = cell + cell @ cell / 2  # the exponential minus one
    for _ in range(60):
        E = 2 * E + E @ E
    return (x + E @ x).astype(float)


@pytest.mark.parametrize(("name", "changes"), FAST, ids=[f"{n}-{max(c)}-{max(c.values()):g}" for n, c in FAST])
def test_what_decays_within_a_tiny_part_of_a_tick_takes_few_segments(name, changes):
    """Up to 1e9 halvings would be the cells of a Taylor series. The values between ticks are those of shorter steps,
    and inside of the first tick those of the matrix exponential.
    """
    scene = scenes.load(name, changes)
    assembly = scene.assemble()
    rows, system, step_ns = [output.row for output in assembly.outputs.values()], assembly.system(), scene.step_ns
    motion = Motion(system, step_ns, "exact", rows, read=len(rows))
    fine = Motion(system, step_ns // 8, "exact", rows, longest=8)
    start, worst, size, rounding = motion.x.copy(), *np.zeros((3, len(rows)))
    for tick in range(100):
        motion.advance(1)
        fine.advance(8)
        segments, n = motion.segments, int(motion.segments.count[0])
        assert n < 60
        begin, length, coef = segments.start[:n], segments.length[:n], segments.coef[:n]
        assert begin[1:] == pytest.approx(begin[:-1] + length[:-1], abs=1e-18)
        places = np.arange(1, 9) * (step_ns / 8 * 1e-9)
        values = fine.outputs_at(fine.states, fine.mode_sets_of_states)
        if tick == 0 and system.n < 10:
            places = np.concatenate([places, begin + 0.3 * length])
            A, at = motion.mode_sets.sets[motion.mode_set].A, np.array([motion.mode_set])
            states = [moved(A, place, start) for place in places[8:].tolist()]
            values = np.vstack([values, *(motion.outputs_at(x[None], at) for x in states)])
        within = np.searchsorted(begin + length, places * (1.0 - 1e-9))
        u = (places - begin[within]) / length[within]
        read = np.einsum("psk,pk->ps", coef[within], u[:, None] ** np.arange(DEGREE + 1))
        worst, size = np.maximum(worst, np.abs(read - values).max(axis=0)), np.maximum(size, np.abs(values).max(axis=0))
        terms = np.abs(motion.mode_sets.tables.signals[motion.mode_set]) @ np.abs(motion.x)
        rounding = np.maximum(rounding, 1e-15 * terms)
    assert np.all(worst <= 1e-8 * size + rounding)
    assert abs(motion.energy()["error"]) < 1e-8
    assert motion.energy() == pytest.approx(fine.energy(), rel=1e-6, abs=1e-8)


STACK = {"piezo.capacitance": 1e-6, "piezo.coupling": 0.01118, "shunt.kind": "series", "shunt.delta": -0.5}
RESISTOR = {"shunt.resistance": 0.002, "shunt.inductance": 0.0}
SLOW = {"shunt.resistance": 1e6, "shunt.inductance": 1e-3}
JUMPS = {"load": (25.0, 15.0), "drive": (0.08, 0.05)}
DRIVEN = [
    ("belt", {"load.lag": 1e-9}, 1e-7),
    ("belt", {"drive.lag": 1e-9}, 1e-7),
    ("belt", {"drive.lag": 1e-6}, 1e-10),
    ("belt", {"body.damping": 1e9}, 1e-7),
    ("belt", STACK | RESISTOR, 1e-7),
    ("belt", STACK | SLOW, 1e-7),
    ("belt", {"load.lag": 1e-9, "friction.speed_scale": 1e-3}, 1e-7),
    ("belt_c", {"drive.lag": 1e-9}, 0.0),
    ("belt_c", {"body.damping": 1e9}, 0.0),
    ("belt_c", STACK | SLOW, 0.0),
]


def by_radau(system, modes, x, time):
    """x after `time` s in one mode set, by scipy's implicit method."""
    law, slip, load = system.law(0, modes.key), modes.sigma[0] * system.slip_rows[0], modes.sigma[0] * modes.normal[0]

    def rate(_, x):
        return modes.A @ x + modes.b[:, 0] * (float(law.over(np.array([slip @ x]))[0]) * (load @ x))

    def slopes(_, x):
        mu, w = law.over(np.array([slip @ x]))[0], float(slip @ x)
        return modes.A + np.outer(modes.b[:, 0], mu * load + law.slope(w) * (load @ x) * slip)

    absolute = 1e-13 * np.maximum(np.abs(x), 1e-3)
    return solve_ivp(rate, (0.0, time), x, "Radau", rtol=1e-9, atol=absolute, jac=slopes).y[:, -1]


@pytest.mark.parametrize(
    ("name", "changes", "tolerance", "method"),
    [(*case, method) for case in DRIVEN for method in (("dopri5", "rosenbrock") if case[2] else ("exact",))],
)
def test_fast_states_follow_jumps_of_commands_as_by_an_implicit_method(name, changes, tolerance, method, monkeypatch):
    """Six ticks of slip, with jumps of the command that lags."""
    moved = next((key[:-4] for key in changes if key.endswith(".lag")), None)
    actuator = {"load": {"load.force": "held"}, "drive": {"drive.speed": "held"}}.get(moved, {})
    scene = scenes.load(name, {"start.velocity": 0.0} | changes)
    monkeypatch.setattr(type(scene), "moved", property(lambda _: actuator))
    assembly = scene.assemble()
    rows, system = [output.row for output in assembly.outputs.values()], assembly.system()
    motion = Motion(system, scene.step_ns, method, rows, read=len(rows), tolerance=tolerance or 1e-7)
    motion.advance(1)
    for tick in range(6):
        x = motion.x.copy()
        if moved and tick in (1, 4):
            at = system.names.index(f"{moved}.command")
            x[at] = JUMPS[moved][tick // 4]
            motion.write(at, x[at])
        motion.advance(1)
        expected = by_radau(system, motion.mode_sets.sets[motion.mode_set], x, scene.step_ns * 1e-9)
        assert motion.x == pytest.approx(expected, rel=max(tolerance, 1e-9), abs=1e-11)
    assert not motion.events()
    assert abs(motion.energy()["error"]) < 1e-9
