"""Several rigs as one vectorised environment of Gymnasium, in one process.

A step of a rig takes 20 us, a message to another process more: processes would pay only for steps of many frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from rig.gym.environment import SEEDS, box
from rig.gym.episode import Episode, Ranges, Reward
from rig.scenes import load
from rig.scenes.scene import Scene

Array = NDArray[np.float64]


class RigVectorEnv(VectorEnv[Array, Array, Any]):
    """Rigs that are stepped together. A rig whose episode has ended is reset by the next step, without a reward."""

    def __init__(self, episodes: Sequence[Episode]) -> None:
        self.metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}
        self.episodes = tuple(episodes)
        self.num_envs = len(self.episodes)
        first = self.episodes[0]
        self.single_observation_space, self.single_action_space = box(first.observed), box(first.driven)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._ended = np.zeros(self.num_envs, dtype=bool)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin an episode of each rig; a seed n gives them the seeds n, n + 1, ..."""
        super().reset(seed=seed if isinstance(seed, int) else None)
        given: Sequence[int | None] = [None] * self.num_envs if seed is None else []
        if isinstance(seed, int):
            given = [seed + i for i in range(self.num_envs)]
        elif seed is not None:
            given = seed
        seeds = [self._drawn() if one is None else one for one in given]
        observations = [episode.reset(one) for episode, one in zip(self.episodes, seeds, strict=True)]
        self._ended[:] = False
        everywhere = np.ones(self.num_envs, dtype=bool)
        return np.array(observations), {
            "t": np.zeros(self.num_envs), "_t": everywhere, "seed": np.array(seeds), "_seed": everywhere.copy()
        }  # fmt: skip

    def _drawn(self) -> int:
        return int(self.np_random.integers(SEEDS))

    def step(self, actions: Array) -> tuple[Array, Array, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """One step of each rig: see `Episode.step`."""
        observations, ended = [], self._ended
        n = self.num_envs
        rewards, times = np.zeros(n), np.zeros(n)
        terminated, truncated = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
        why: dict[int, str] = {}
        for i, (episode, action) in enumerate(zip(self.episodes, actions.tolist())):
            if ended[i]:
                observations.append(episode.reset(self._drawn()))
                continue
            found = episode.step(action)
            observations.append(found.observation)
            rewards[i], terminated[i], truncated[i] = found.reward, found.terminated, found.truncated
            times[i] = found.info["t"]
            if "why" in found.info:
                why[i] = found.info["why"]
        info: dict[str, Any] = {"t": times, "_t": ~ended}
        if why:
            info |= {"why": np.array([why.get(i, "") for i in range(n)], dtype=object),
                     "_why": np.array([i in why for i in range(n)])}  # fmt: skip
        self._ended = terminated | truncated
        return np.array(observations), rewards, terminated, truncated, info


def make_vec(
    scene: Scene | str | Path,
    count: int,
    *,
    observe: Ranges,
    act: Ranges,
    reward: Reward,
    frames: int = 1,
    duration: Any = None,
) -> RigVectorEnv:
    """`count` rigs of a scene as one vectorised environment; for the other arguments see `rig.gym.make`."""
    loaded = load(scene) if isinstance(scene, str | Path) else scene
    return RigVectorEnv([Episode(loaded, observe, act, reward, frames, duration) for _ in range(max(count, 1))])
