"""What the sensors get: smooth pieces that tile a frame and are the signals, jumps only between them."""

import numpy as np
import pytest

from rig.motion.motion import Motion
from rig.solve.segments import DEGREE

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


CASES = [("p1", "exact", {}), ("p2", "dopri5", {"tolerance": 1e-9}), ("p2", "rk4", {"substeps": 4})]


@pytest.mark.parametrize(("name", "method", "how"), CASES, ids=[c[1] for c in CASES])
def test_segments_tile_the_frame_and_carry_the_signals(rigs, name, method, how):
    step_ns, steps = 250_000, 4
    h, seen = step_ns * 1e-9, 0
    accuracy = {"exact": 1e-9, "dopri5": 1e-6, "rk4": 1e-6}[method]
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


def test_nothing_is_written_down_that_nobody_reads(rigs):
    motion = Motion(rigs.p1(), 1_000_000, "exact", outputs=ROWS)
    motion.advance(1)
    assert motion.segments.count[0] == 0
