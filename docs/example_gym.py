"""Searches a controller of the normal force that breaks the stick-slip cycle of a belt with less effort.

The belt runs in its limit cycle for 4 s. Then a controller with three parameters varies the normal force F for 8 s:

    F = 20 N - swing tanh(gain v / swing)    while |v| is above `rest`, else 20 N         v: velocity of the body

With a large swing and no rest this is normal-force feedback. The effort is the root mean square of F - 20 N in that
time. The cycle is broken if the velocity varies by less than 5 mm/s in the last second.

    python docs/example_gym.py
"""

import math
import sys

import numpy as np
from scipy.optimize import differential_evolution

import rig.gym

LOAD, BEGIN, END = 20.0, 4.0, 12.0  # N, s, s
BROKEN = 0.005  # m/s, peak to peak
FEEDBACK = (200.0, 1e6, 0.0)
"""Normal-force feedback: 200 N s/m, without a limit, without a rest."""


def environment():
    """The belt: the agent observes the vibrometer and drives the normal force."""
    return rig.gym.make(
        "belt",
        observe={"vibrometer": ("-0.5 m/s", "0.5 m/s")},
        act={"load.force": ("0 N", "100 N")},
        reward=lambda now: -((now.commanded["load.force"] - LOAD) ** 2),
        duration=END,
    )


def tried(env, parameters):
    """Effort [N] and remaining velocity, peak to peak [m/s], of a controller with these parameters."""
    gain, swing, rest = parameters
    (v,), _ = env.reset(seed=0)
    cost, last = 0.0, []
    frames = round(END * 1000)
    for k in range(frames):
        force = LOAD - swing * math.tanh(gain * v / swing) if k >= BEGIN * 1000 and abs(v) > rest else LOAD
        (v,), reward, ended, _, _ = env.step(np.array([force]))
        cost -= reward
        if k >= frames - 1000:
            last.append(v)
        if ended:
            return math.inf, math.inf
    return math.sqrt(cost / (frames - BEGIN * 1000)), max(last) - min(last)


def search(env, rounds=6):
    """The parameters with the least effort that break the cycle; the seed makes the search repeatable."""

    def score(parameters):
        effort, left = tried(env, parameters)
        return effort + 1e4 * max(left - BROKEN, 0.0)

    bounds = [(100.0, 1000.0), (0.5, 20.0), (0.0, 0.02)]
    return differential_evolution(score, bounds, maxiter=rounds, popsize=5, rng=1, polish=False).x


def main():
    """Compare the controller that is found with normal-force feedback."""
    env = environment()
    for name, parameters in (("feedback", FEEDBACK), ("found", search(env))):
        effort, left = tried(env, parameters)
        text = ", ".join(f"{value:.3g}" for value in parameters)
        told = f"{name:9} effort {effort:.3f} N, velocity left {1e3 * left:.2f} mm/s"
        sys.stdout.write(f"{told}    (gain, swing, rest = {text})\n")


if __name__ == "__main__":
    main()
