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

from rig.errors import UsageError
from rig.gym.environment import LARGEST_SEED, SEEDS, box
from rig.gym.episode import Episode, Ranges, Reward
from rig.quantities import whole
from rig.scenes import load
from rig.scenes.scene import Scene

Array = NDArray[np.float64]
MOST_RIGS = 10_000
"""Largest number of rigs in one environment. # chosen"""


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
        """Begin an episode of each rig; a seed n gives them the seeds n, n + 1, ...

        Raises UsageError for what is no seed, and for a list that has not one seed for each rig.
        """
        given: Sequence[int | None] = [None] * self.num_envs
        if isinstance(seed, Sequence | np.ndarray):
            given = seed
        elif seed is not None:
            first = whole("seed", seed, 0, LARGEST_SEED - self.num_envs)
            super().reset(seed=first)
            given = [first + i for i in range(self.num_envs)]
        if len(given) != self.num_envs:
            raise UsageError(f"{len(given)} seeds for {self.num_envs} rigs: state one for each, or one number")
        seeds = [self._drawn() if n is None else whole("seed", n, 0, LARGEST_SEED) for n in given]
        observations = [episode.reset(n) for episode, n in zip(self.episodes, seeds)]
        self._ended[:] = False
        everywhere = np.ones(self.num_envs, dtype=bool)
        return np.array(observations), {
            "t": np.zeros(self.num_envs), "_t": everywhere, "seed": np.array(seeds), "_seed": everywhere.copy()
        }  # fmt: skip

    def _drawn(self) -> int:
        return int(self.np_random.integers(SEEDS))

    def step(self, actions: Array) -> tuple[Array, Array, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """One step of each rig: see `Episode.step`.

        `info["seed"]`: the seed of each rig that this step has reset; `info["_seed"]` says which. Raises UsageError
        for actions of another shape or with NaN.
        """
        n = self.num_envs
        commands = self.episodes[0].commands(actions, n).tolist()
        observations, ended = [], self._ended
        for i, (episode, command) in enumerate(zip(self.episodes, commands)):
            if not ended[i]:
                episode.check(command, f" of rig {i}")  # before any rig moves: they stay together
        rewards, times, seeds = np.zeros(n), np.zeros(n), np.zeros(n, dtype=np.int64)
        terminated, truncated = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
        why: dict[int, str] = {}
        for i, (episode, command) in enumerate(zip(self.episodes, commands)):
            if ended[i]:
                seeds[i] = self._drawn()
                observations.append(episode.reset(int(seeds[i])))
                continue
            stepped = episode.step(command)
            observations.append(stepped.observation)
            rewards[i], terminated[i], truncated[i] = stepped.reward, stepped.terminated, stepped.truncated
            times[i] = stepped.info["t"]
            if "why" in stepped.info:
                why[i] = stepped.info["why"]
        info: dict[str, Any] = {"t": times, "_t": np.ones(n, dtype=bool)}
        if ended.any():
            info |= {"seed": seeds, "_seed": ended}
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
    """`count` rigs of a scene as one vectorised environment; for the other arguments see `rig.gym.make`.

    Raises rig.errors.UsageError for a count that is not 1 to `MOST_RIGS`, and with all faults of the others.
    """
    count = whole("count", count, 1, MOST_RIGS)
    loaded = load(scene) if isinstance(scene, str | Path) else scene
    return RigVectorEnv([Episode(loaded, observe, act, reward, frames, duration) for _ in range(count)])
