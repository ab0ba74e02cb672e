"""Gymnasium's own checkers, and what its wrappers and recorders expect of us."""

import copy
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.utils.env_match import check_environments_match
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import RecordEpisodeStatistics

import adrl
from adrl.errors import ConfigError, UnknownName


@pytest.mark.parametrize("options", [{}, {"guidance": "map"}, {"robot": "jackal", "scenario": "complex"}])
def test_env_passes_gymnasiums_checker(options: dict[str, Any]) -> None:
    """Not one warning; rendering included, for rgb_array and human."""
    pytest.importorskip("pygame")
    env = gymnasium.make(adrl.ENV_ID, render_mode="rgb_array", **options)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=False)


def test_passive_checker_is_silent_over_episodes() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make(adrl.ENV_ID)
        env.reset(seed=5)
        for _ in range(300):
            _, _, terminated, truncated, _ = env.step(env.action_space.sample())
            if terminated or truncated:
                env.reset()


def test_two_environments_match() -> None:
    one, other = gymnasium.make(adrl.ENV_ID), gymnasium.make(adrl.ENV_ID)
    check_environments_match(one, other, num_steps=100, seed=3)


def test_vector_env_follows_the_api() -> None:
    """make_vec takes ours without a warning; spaces are batched; what comes out is in the spaces."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make_vec(adrl.ENV_ID, num_envs=5, scenario="clutter", robot="turtlebot3_burger")
    assert type(env).__name__ == "NavVectorEnv"
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert env.single_observation_space.shape == env.observation_space.shape[1:]  # pyright: ignore
    assert env.observation_space.shape[0] == env.action_space.shape[0] == env.num_envs == 5  # pyright: ignore
    observation, info = env.reset(seed=2)
    assert observation in env.observation_space
    assert info == {}
    for _ in range(300):
        observation, rewards, terminated, truncated, info = env.step(env.action_space.sample())
        assert observation in env.observation_space
        assert info["final_obs"] in env.observation_space
        assert rewards.shape == terminated.shape == truncated.shape == (5,)
        assert rewards.dtype == np.float32
        assert terminated.dtype == truncated.dtype == np.bool_


@pytest.mark.parametrize("gain", [1.0, -1.0])
def test_observations_stay_in_their_space_at_full_speed(gain: float) -> None:
    """Wheels may turn faster than told (randomisation), and backwards faster than forwards."""
    env = gymnasium.make_vec(
        adrl.ENV_ID, num_envs=32, robot={"max_speed_mps": 0.3, "min_speed_mps": -0.6}, randomize=True
    )
    env.reset(seed=0)
    largest = 0.0
    for _ in range(40):
        observation, *_ = env.step(np.full((32, 2), gain, dtype=np.float32))
        assert observation in env.observation_space
        largest = max(largest, float(np.abs(observation).max()))
    assert largest > 1.0


@pytest.mark.parametrize("mode", ["sync", "vector_entry_point"])
def test_every_vectorisation_runs(mode: str) -> None:
    env = gymnasium.make_vec(adrl.ENV_ID, num_envs=2, vectorization_mode=mode)
    env.reset(seed=0)
    observation, *_ = env.step(env.action_space.sample())
    assert observation.shape == env.observation_space.shape


def test_episode_statistics_wrapper_counts_our_episodes() -> None:
    env = RecordEpisodeStatistics(gymnasium.make_vec(adrl.ENV_ID, num_envs=8))
    env.reset(seed=0)
    lengths, since = [], np.zeros(8)
    for _ in range(250):
        _, _, terminated, truncated, info = env.step(np.tile(np.array([1.0, 0.0], dtype=np.float32), (8, 1)))
        since += 1
        ended = terminated | truncated
        if ended.any():
            np.testing.assert_array_equal(info["episode"]["l"][ended], since[ended])
            lengths += list(since[ended])
        since[ended] = 0
    assert len(lengths) > 8


def test_spec_survives_json_and_copying() -> None:
    spec = gymnasium.make(adrl.ENV_ID, scenario="complex", robot="jackal").spec
    assert spec is not None
    for same in (type(spec).from_json(spec.to_json()), copy.deepcopy(spec)):
        env = gymnasium.make(same).unwrapped
        assert env._env.robot.name == "jackal"  # pyright: ignore
        assert env._env.scenario.name == "complex"  # pyright: ignore


def test_bad_options_name_themselves(tmp_path: Path) -> None:
    with pytest.raises(UnknownName, match="did you mean 'clutter'"):
        gymnasium.make(adrl.ENV_ID, scenario="cluter")
    with pytest.raises(UnknownName, match="did you mean 'jackal'"):
        gymnasium.make(adrl.ENV_ID, robot="jakal")
    with pytest.raises(UnknownName, match="unknown guidance"):
        gymnasium.make(adrl.ENV_ID, guidance="gaol")
    with pytest.raises(ConfigError, match=r"nobody\.toml"):
        gymnasium.make(adrl.ENV_ID, robot=str(tmp_path / "nobody.toml"))
    with pytest.raises(ConfigError, match="num_envs is 0"):
        gymnasium.make_vec(adrl.ENV_ID, num_envs=0)
    with pytest.raises(ConfigError, match="task_pool is 0"):
        gymnasium.make(adrl.ENV_ID, task_pool=0)
    with pytest.raises(ConfigError, match="NextStep"):
        gymnasium.make_vec(adrl.ENV_ID, autoreset_mode="NextStep")
    with pytest.raises(UnknownName, match="unknown split"):
        gymnasium.make(adrl.ENV_ID, split="tset").reset(seed=0)
