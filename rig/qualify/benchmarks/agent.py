"""Benchmark of the steps of an environment of Gymnasium, one frame of 1 ms each."""

from __future__ import annotations

import time

import numpy as np

from rig.errors import UsageError

SCENE, STEPS = "belt_normal_force", 5000


def steps(rounds: int = 7) -> dict[str, float]:
    """Return steps per second and seconds of a reset, in processor time, and steps per second of four rigs at once.

    Empty without gymnasium.
    """
    try:
        from rig import gym
    except UsageError:
        return {}
    ranges = {"observe": {"vibrometer": (-0.5, 0.5)}, "act": {"load.force": (0.0, 60.0)}}
    more = {"reward": lambda now: -(now.measured["vibrometer"] ** 2), "duration": 60.0}
    one, four = gym.make(SCENE, **ranges, **more), gym.make_vec(SCENE, 4, **ranges, **more)  # type: ignore[arg-type]
    action, actions = np.array([20.0]), np.full((4, 1), 20.0)
    best = {"steps": 0.0, "reset": np.inf, "four": 0.0}
    for seed in range(rounds + 1):  # the first one loads kernels
        begin = time.process_time()
        one.reset(seed=seed)
        begun = time.process_time()
        for _ in range(STEPS):
            one.step(action)
        ended = time.process_time()
        four.reset(seed=seed)
        start = time.process_time()
        for _ in range(STEPS // 4):
            four.step(actions)
        taken = time.process_time() - start
        if seed:
            best["reset"] = min(best["reset"], begun - begin)
            best["steps"] = max(best["steps"], STEPS / (ended - begun))
            best["four"] = max(best["four"], STEPS // 4 * 4 / taken)
    return best
