"""A rig as an environment of Gymnasium.

Several rigs as one vectorised environment of Gymnasium, in one process.

A step of a rig takes 20 us, a message to another process more: processes would pay only for steps of many frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.gym.episode import Episode, Ranges, Reward
from rig.quantities import whole
from rig.scenes import load
from rig.scenes.scene import Scene

Array = NDArray[np.float64]
LARGEST_SEED = 2**63 - 1
SEEDS = 1 << 31  # seeds that an environment draws for itself are below this number


def box(ranges: list[tuple[float, float]]) -> Any:
    """The space of values within these ranges."""
    low, high = (np.array(ends) for ends in zip(*ranges))
    return gymnasium.spaces.Box(low, high, dtype=np.float64)


class RigEnv(gymnasium.Env[Array, Array]):
    """A rig whose actuators the agent drives. Values are in SI, in the order of `episode.sensors` and `.actuators`.

    `reset(seed=n)` begins an episode with the seed n of all noise; without a seed the environment draws one, which
    `info["seed"]` tells.
    """

    def __init__(self, episode: Episode) -> None:
        self.metadata = {"render_modes": []}
        self.episode = episode
        self.observation_space, self.action_space = box(episode.observed), box(episode.driven)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begin an episode; there are no options. Raises UsageError for what is no seed."""
        if seed is not None:
            seed = whole("seed", seed, 0, LARGEST_SEED)
        super().reset(seed=seed)
        used = int(self.np_random.integers(SEEDS)) if seed is None else seed
        return np.array(self.episode.reset(used)), {"t": 0.0, "seed": used}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """One step: see `Episode.step`. Raises UsageError for an action of another shape or with NaN."""
        stepped = self.episode.step(self.episode.commands(action).tolist())
        return np.array(stepped.observation), stepped.reward, stepped.terminated, stepped.truncated, stepped.info


def make(
    scene: Scene | str | Path, *, observe: Ranges, act: Ranges, reward: Reward, frames: int = 1, duration: Any = None
) -> RigEnv:
    """A scene as an environment.

    `observe`, `act`: sensor or actuator -> (least, largest value), in SI or as texts with a unit. Observations and
    commands are limited to these ranges. `reward`: a function of `Now`. `frames`: frames of the scene in a step.
    `duration`: length of an episode in seconds; by default that of the protocol. Raises rig.errors.UsageError with all
    faults.
    """
    return RigEnv(
        Episode(load(scene) if isinstance(scene, str | Path) else scene, observe, act, reward, frames, duration)
    )


# Largest number of rigs in one environment. # chosen
MOST_RIGS = 10_000


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
