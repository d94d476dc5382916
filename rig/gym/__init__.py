"""Rigs as environments of Gymnasium, for reinforcement learning and other searches for controllers.

    import rig.gym
    env = rig.gym.make("belt", observe={"vibrometer": (-0.5, 0.5)}, act={"load.force": (0.0, 60.0)},
                       reward=lambda now: -now.measured["vibrometer"] ** 2, duration=10.0)
    observation, info = env.reset(seed=1)
    observation, reward, terminated, truncated, info = env.step(env.action_space.sample())

episode      one rig, reset and stepped by an agent; knows nothing of Gymnasium
environment  it as `gymnasium.Env`; several of them as `gymnasium.vector.SyncVectorEnv`
"""

from __future__ import annotations

from rig.extras import needed

needed("gymnasium", "gym")

from rig.gym.environment import RigEnv, make, make_vec  # noqa: E402 (the line above says what to install)
from rig.gym.episode import Now  # noqa: E402

__all__ = ["Now", "RigEnv", "make", "make_vec"]
