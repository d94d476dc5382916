"""A rig as an environment of Gymnasium, and several as one vectorised environment, in one process.

A step of a rig takes 20 us, a message to another process more: processes would pay only for steps of many frames.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import SyncVectorEnv
from numpy.typing import NDArray

from rig.gym.episode import Episode, Ranges, Reward
from rig.quantities import whole
from rig.scenes.loader import loaded
from rig.scenes.scene import Scene

Array = NDArray[np.float64]
LARGEST_SEED = 2**63 - 1  # of a signed integer of 64 bits
SEEDS = 1 << 31  # seeds that an environment draws for itself are below this number


def box(ranges: list[tuple[float, float]]) -> Any:
    """The space of values within these ranges."""
    low = np.array([least for least, _ in ranges])
    high = np.array([most for _, most in ranges])
    return gymnasium.spaces.Box(low, high, dtype=np.float64)


class RigEnv(gymnasium.Env[Array, Array]):
    """A rig whose actuators the agent drives. Values are in SI, in the order of `episode.sensors` and `.actuators`.

    `reset(seed=n)` begins an episode with the seed n of all noise; without a seed the environment draws one, which
    `info["seed"]` tells.
    """

    def __init__(self, episode: Episode) -> None:
        self.metadata = {"render_modes": []}
        self.episode = episode
        self.observation_space = box(episode.observed)
        self.action_space = box(episode.driven)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begin an episode; there are no options. Raises UsageError for what is no seed."""
        if seed is not None:
            seed = whole("seed", seed, 0, LARGEST_SEED)
        super().reset(seed=seed)
        used = int(self.np_random.integers(SEEDS)) if seed is None else seed
        first = self.episode.reset(used)
        return np.array(first), {"t": 0.0, "seed": used}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """One step: see `Episode.step`. Raises UsageError for an action of another shape or with NaN."""
        command = self.episode.commands(action)
        stepped = self.episode.step(command.tolist())
        return np.array(stepped.observation), stepped.reward, stepped.terminated, stepped.truncated, stepped.info


def make(
    scene: Scene | str | Path,
    *,
    observe: Ranges,
    act: Ranges,
    reward: Reward,
    frames: int = 1,
    duration: Any = None,
    overrides: Mapping[str, object] | None = None,
) -> RigEnv:
    """A scene as an environment.

    `observe`, `act`: sensor or actuator -> (least, largest value), in SI or as texts with a unit. Observations and
    commands are limited to these ranges. `reward`: a function of `Now`. `frames`: frames of the scene in a step.
    `duration`: length of an episode in seconds; by default that of the protocol. `overrides`: as for `rig.load`, of a
    scene given by name or file. Raises rig.errors.UsageError with all faults.
    """
    episode = Episode(loaded(scene, overrides), observe, act, reward, frames, duration)
    return RigEnv(episode)


def make_vec(
    scene: Scene | str | Path,
    count: int,
    *,
    observe: Ranges,
    act: Ranges,
    reward: Reward,
    frames: int = 1,
    duration: Any = None,
    overrides: Mapping[str, object] | None = None,
) -> SyncVectorEnv[Array, Array]:
    """`count` rigs of a scene as one vectorised environment; for the other arguments see `rig.gym.make`.

    Raises rig.errors.UsageError with all faults of the arguments.
    """
    plant = loaded(scene, overrides)
    environment = partial(make, plant, observe=observe, act=act, reward=reward, frames=frames, duration=duration)
    return SyncVectorEnv([environment] * count)
