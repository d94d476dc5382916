"""Run-up and run-down: sliding and stick-slip live side by side over a range of belt speeds (Kroeger et al. 2008).

The speed is run up slowly, then stepped, and the state is carried on: a standing start misses the last of it.
"""

import numpy as np

MOVED = {"drive.speed": "ramped"}
SETTLE = 18_000, 2000  # ticks of 1 ms between two steps of the speed


def lives_up_to(run, alive, limit, within):
    """Whether stick-slip that is carried up in speed, slowly from `alive` on, ends at `limit`."""
    run.run_up(0.06, 0.95 * alive, 0.01 * alive)
    run.run_up(0.95 * alive, alive, 2e-4 * alive)  # in one period the belt must not gain what the cycle has to spare
    run.run_up(alive, limit - within, 1e-5 * alive)
    if not run.sticks(*SETTLE):
        return False
    run.run_up(limit - within, limit + within, 1e-5 * alive)
    return not run.sticks(*SETTLE)


def test_stick_slip_of_characteristic_a_lives_up_to_a_speed(move, kroger):
    run = move("belt", moved=MOVED, duration=1.0)
    assert lives_up_to(run, 0.6745, kroger["A_stick_slip_exists_up_to_v0"], 1e-4)


def test_the_two_motions_live_side_by_side(move):
    """At 0.4 m/s: from the cycle it goes on cycling, from sliding it goes on sliding."""
    cycling, sliding = move("belt", moved=MOVED, duration=1.0), move("belt", {"drive.speed": 0.4}, moved=MOVED)
    cycling.run_up(0.06, 0.4, 0.01)
    assert cycling.sticks(*SETTLE)
    sliding.write("x", 0.0015)
    sliding.write("x'", 0.0)
    sliding.motion.advance(20_000)
    assert not len(sliding.times("contact slip ends"))
    assert np.abs(sliding["velocity"][-2000:]).max() < 0.05 * np.abs(cycling["velocity"]).max()
