"""Gymnasium's own checkers, and what its wrappers and recorders expect of us."""

import copy
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import InvalidAction, ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.utils.env_match import check_environments_match
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import RecordEpisodeStatistics

import adrl
from adrl.envs import NavEnv, NavVectorEnv
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
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP  # the default of Gymnasium's own
    assert env.single_observation_space.shape == env.observation_space.shape[1:]  # pyright: ignore
    assert env.observation_space.shape[0] == env.action_space.shape[0] == env.num_envs == 5  # pyright: ignore
    observation, info = env.reset(seed=2)
    assert observation in env.observation_space
    assert not info["success"].any()
    assert info["_success"].all()
    for _ in range(300):
        observation, rewards, terminated, truncated, info = env.step(env.action_space.sample())
        assert observation in env.observation_space
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
    env = RecordEpisodeStatistics(gymnasium.make_vec(adrl.ENV_ID, num_envs=8, autoreset_mode="SameStep"))
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
    with pytest.raises(UnknownName, match="did you mean 'NextStep'"):
        gymnasium.make_vec(adrl.ENV_ID, autoreset_mode="next_step")
    with pytest.raises(UnknownName, match="unknown split"):
        gymnasium.make(adrl.ENV_ID, split="tset").reset(seed=0)
    for make in (gymnasium.make, gymnasium.make_vec):
        with pytest.raises(UnknownName, match="render_mode 'ansi'"):
            make(adrl.ENV_ID, render_mode="ansi")
    with pytest.raises(UnknownName, match="render_mode 'human'"):
        gymnasium.make_vec(adrl.ENV_ID, render_mode="human")


STILL = np.array([-1.0, 0.0], np.float32)


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_steps_before_the_first_reset_are_refused(mode: AutoresetMode) -> None:
    env = NavVectorEnv(2, autoreset_mode=mode)
    with pytest.raises(ResetNeeded, match=r"rows \[0, 1\] have no episode yet"):
        env.step(np.tile(STILL, (2, 1)))
    with pytest.raises(ResetNeeded, match="no episode yet"):
        env.expert_actions()
    env.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(ResetNeeded, match=r"rows \[1\] have no episode yet"):
        env.step(np.tile(STILL, (2, 1)))
    with pytest.raises(ResetNeeded):
        NavEnv().step(STILL)


def test_steps_after_the_end_are_refused() -> None:
    """By the single environment, and where nothing resets by itself; a refused step changes nothing."""
    single = NavEnv(max_episode_steps=2)
    vector = NavVectorEnv(2, max_episode_steps=2, autoreset_mode="Disabled")
    single.reset(seed=0)
    vector.reset(seed=0)
    for _ in range(2):
        single.step(STILL)
        vector.step(np.tile(STILL, (2, 1)))
    vector.reset(options={"reset_mask": np.array([True, False])})
    before = vector.state()
    with pytest.raises(ResetNeeded, match=r"episodes of rows \[1\] have ended"):
        vector.step(np.tile(STILL, (2, 1)))
    assert all(np.array_equal(array, before[name]) for name, array in vector.state().items())
    with pytest.raises(ResetNeeded, match="have ended"):
        single.step(STILL)
    single.reset()
    single.step(STILL)


@pytest.mark.parametrize(
    "action", [np.zeros((2, 3)), np.zeros(4), np.array([[0.0, np.nan], [0.0, 0.0]]), np.full((2, 2), np.inf)]
)
def test_actions_that_are_none_are_refused(action: np.ndarray) -> None:
    env = NavVectorEnv(2)
    env.reset(seed=0)
    with pytest.raises(InvalidAction, match="give"):
        env.step(action.astype(np.float32))
    assert np.isfinite(env.step(np.tile(STILL, (2, 1)))[0]).all()


def test_infos_of_one_robot_are_plain() -> None:
    env = NavEnv()
    _, first = env.reset(seed=0)
    *_, info = env.step(STILL)
    for said in (first, info):
        assert [said[name] is False for name in ("success", "is_success", "collision")] == [True] * 3
        assert said["reward_terms"].shape == (6,)
