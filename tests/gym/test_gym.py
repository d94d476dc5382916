"""Rigs as environments of Gymnasium: the bits of every other run, ranges, seeds, ends, several rigs at once."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="gymnasium is not installed")

from gymnasium.utils.env_checker import check_env

import rig
from rig import scenes
from rig.bench.run.simulate import simulate
from rig.errors import UsageError

DOCS = Path(__file__).parents[2] / "docs"
OBSERVE, ACT = {"vibrometer": ("-50 cm/s", 0.5), "laser": (-0.05, 0.05)}, {"load.force": ("0 N", "60 N")}


def squared(now):
    return -(now.measured["vibrometer"] ** 2)


def make(scene="belt", observe=OBSERVE, act=ACT, reward=squared, duration=0.2, **more):
    return rig.gym.make(scene, observe=observe, act=act, reward=reward, duration=duration, **more)


def carried(env, seed):
    """All observations of an episode of the feedback."""
    observation, _ = env.reset(seed=seed)
    seen, ended = [observation], False
    while not ended:
        force = min(max(20.0 - 200.0 * observation[0], 0.0), 60.0)
        observation, _, terminated, truncated, _ = env.step(np.array([force]))
        seen.append(observation)
        ended = terminated or truncated
    return np.array(seen)


@pytest.mark.filterwarnings("ignore:.*symmetric and normalized")
@pytest.mark.filterwarnings("ignore:.*not having a spec")
def test_gymnasiums_checker_passes():
    check_env(make())


@pytest.mark.parametrize("frames", [1, 5])
def test_an_episode_has_the_bits_of_a_simulation_with_the_same_controller_also_after_other_episodes(frames):
    changes = {
        "seed": 3,
        "controllers.nf.kind": "normal_force",
        "controllers.nf.sensor": "vibrometer",
        "controllers.nf.gain": 200.0,
        "controllers.nf.highest": 60.0,
        "controllers.nf.nominal": 20.0,
        "controllers.nf.period": frames * 1e-3,
    }
    loaded = scenes.load("belt", changes)
    run = simulate(loaded, duration_ns=200_000_000)
    at = [run.measurements[name] for name in OBSERVE]
    wanted = np.array(
        [one.v[np.searchsorted(one.t_ns, np.arange(0, 200_000_001, frames * 1_000_000), "right") - 1] for one in at]
    ).T
    env = make(loaded, frames=frames)
    assert carried(env, 3).tobytes() == wanted.tobytes()
    other = carried(env, 4)
    assert other.tobytes() != wanted.tobytes()
    assert carried(env, 3).tobytes() == wanted.tobytes()
    assert carried(env, 4).tobytes() == other.tobytes()


def test_a_seed_is_drawn_where_none_is_given_and_is_told():
    env = make()
    _, first = env.reset(seed=7)
    assert first == {"t": 0.0, "seed": 7}
    drawn = [env.reset()[1]["seed"] for _ in range(3)]
    assert len({*drawn}) == 3
    env.reset(seed=7)
    assert [env.reset()[1]["seed"] for _ in range(3)] == drawn


def test_ranges_limit_observations_and_commands():
    told = []
    env = make(observe={"vibrometer": (-0.01, 0.01)}, reward=lambda now: told.append(now) or 0.0)
    env.reset(seed=0)
    seen = [env.step(np.array([1e9]))[0][0] for _ in range(100)]
    assert max(seen) == 0.01
    assert told[-1].commanded == {"load.force": 60.0}
    assert told[-1].output("normal_force") == pytest.approx(60.0)
    assert told[-1].t == pytest.approx(0.1)
    assert told[-1].measured == {"vibrometer": seen[-1]}


def test_before_the_first_sample_arrives_zero_is_observed():
    env = make(scenes.load("belt", {"network.meas.vibrometer.delay": "3 ms"}), observe={"vibrometer": (-0.5, 0.5)})
    for _ in range(2):  # an episode knows nothing of the one before
        first, _ = env.reset(seed=0)
        assert [*first, *(env.step(np.array([20.0]))[0][0] for _ in range(3))] == [0, 0, 0, pytest.approx(0.06, 1e-2)]


def test_an_episode_is_truncated_at_its_end_and_terminated_at_a_limit():
    env = make(duration="50 ms")
    env.reset(seed=0)
    ends = [env.step(np.array([20.0]))[2:4] for _ in range(50)]
    assert ends == [(False, False)] * 49 + [(False, True)]
    with pytest.raises(UsageError, match="the episode has ended; call reset"):
        env.step(np.array([20.0]))
    limited = make(scenes.load("belt", {"limits.displacement": "1 mm"}))
    limited.reset(seed=0)
    for _ in range(200):
        _, _, terminated, truncated, info = limited.step(np.array([20.0]))
        if terminated:
            break
    assert (terminated, truncated, info["why"]) == (True, False, "displacement exceeds its limit")
    assert np.isfinite(limited.reset(seed=0)[0]).all()


def test_a_rig_whose_parameters_the_protocol_changed_is_made_anew(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(
        'format = 1\nbased_on = "belt"\n[[protocol]]\nstep = "hold"\ntime = 0.01\n'
        '[[protocol]]\nstep = "set"\ntarget = "body.mass"\nto = 4.0\n'
        '[[protocol]]\nstep = "hold"\ntime = 0.05\n'
    )
    env = make(str(path), duration=None)
    assert carried(env, 1).tobytes() == carried(env, 1).tobytes()


def test_all_faults_of_the_arguments_are_named():
    with pytest.raises(UsageError) as refused:
        make(observe={"vibro": (0, 1)}, act={"load": (0, 1)}, frames=0, duration="-1 s", reward=3)
    for told in (
        "reward = 3: must be a function",
        "observe: there is no vibro; there are",
        "act: there is no load; there are",
        "frames = 0",
        "duration",
    ):
        assert told in str(refused.value)
    with pytest.raises(UsageError) as refused:
        make(observe={"vibrometer": (1.0, 0.0)}, act={"load.force": ("-1 N", "10 V")})
    for told in ("observe: vibrometer = (1.0, 0.0): the least value 1 is not below", "converts to N"):
        assert told in str(refused.value)
    with pytest.raises(UsageError, match=r"act: load.force = .* the actuator takes 0 to"):
        make(act={"load.force": (-1.0, 10.0)})
    with pytest.raises(UsageError, match="act: names nothing"):
        make(act={})
    with pytest.raises(UsageError, match="duration: endless has no protocol that ends"):
        make(replace(scenes.load("belt"), name="endless", protocol=()), duration=None)


def test_several_rigs_are_stepped_together_and_each_has_the_bits_of_one_alone():
    alone = [carried(make(duration=0.02), seed) for seed in (5, 6, 7)]
    rigs = rig.gym.make_vec("belt", 3, observe=OBSERVE, act=ACT, reward=squared, duration=0.02)
    seen, info = rigs.reset(seed=5)
    assert info["seed"].tolist() == [5, 6, 7]
    rows = [seen]
    for k in range(20):
        action = np.clip(20.0 - 200.0 * seen[:, :1], 0.0, 60.0)
        seen, reward, terminated, truncated, info = rigs.step(action)
        rows.append(seen)
        assert truncated.tolist() == [k == 19] * 3
    assert reward.shape == (3,)
    assert not terminated.any()
    assert np.stack(rows, axis=1).tobytes() == np.stack(alone).tobytes()
    begun, reward, _, truncated, info = rigs.step(action)
    assert reward.tolist() == [0.0] * 3
    assert not truncated.any()
    assert rigs.observation_space.contains(begun)
    assert info["_t"].all()
    again = rig.gym.make_vec("belt", 3, observe=OBSERVE, act=ACT, reward=squared, duration=0.02)
    assert info["_seed"].all()
    assert again.reset(seed=info["seed"].tolist())[0].tobytes() == begun.tobytes()
    assert "seed" not in rigs.step(action)[4]


@pytest.mark.parametrize("action", [[], {"load.force": 20.0}, [[1.0], [1.0, 2.0]], [np.nan]])
def test_an_action_that_is_no_finite_number_for_each_actuator_is_refused_and_nothing_moves(action):
    env = make()
    env.reset(seed=1)
    with pytest.raises(UsageError, match=r"the action.*load\.force"):
        env.step(action)
    assert env.episode.runner.tick == 0


@pytest.mark.slow
def test_the_search_of_the_page_finds_a_controller_with_less_effort_than_normal_force_feedback():
    spec = importlib.util.spec_from_file_location("example_gym", DOCS / "example_gym.py")
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    env = example.environment()
    effort, left = example.tried(env, example.FEEDBACK)
    found = example.search(env)
    less, still = example.tried(env, found)
    free, swinging = example.tried(env, (0.0, 1.0, 0.0))
    assert free == 0.0
    assert swinging > 0.1  # without control the cycle goes on
    assert left < example.BROKEN
    assert still < example.BROKEN
    assert less < 0.95 * effort
    assert (example.search(env) == found).all()
