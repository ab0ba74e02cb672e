"""One seed, one set of drives, whichever way environments are put side by side; and none are copies without a seed."""

import copy
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv

import adrl
from adrl.envs import NavEnv, NavVectorEnv
from adrl.errors import ConfigError

ROWS = 5
OPTIONS: dict[str, Any] = {"task_pool": 64, "scenario": "clutter"}
STEP_MODES = [AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP]


def side_by_side(mode: AutoresetMode) -> tuple[NavVectorEnv, VectorEnv]:
    theirs = SyncVectorEnv([lambda: NavEnv(**OPTIONS)] * ROWS, autoreset_mode=mode)
    return NavVectorEnv(ROWS, autoreset_mode=mode, **OPTIONS), theirs


def assert_same(ours: dict[str, Any], theirs: dict[str, Any], rows: Any = slice(None)) -> None:
    """All that their info has is in ours, in the given rows."""
    for name, value in theirs.items():
        if isinstance(value, dict):
            assert_same(ours[name], value, rows)
        elif value.dtype == object:
            for mine, other in zip(ours[name][rows], value[rows], strict=True):
                np.testing.assert_array_equal(mine, other)
        else:
            assert ours[name].dtype == value.dtype, name
            np.testing.assert_array_equal(ours[name][rows], value[rows], err_msg=name)


@pytest.mark.parametrize("mode", STEP_MODES)
def test_ours_is_gymnasiums_own_row_by_row(mode: AutoresetMode) -> None:
    """Observations, rewards, endings and infos over episodes, with final_obs and final_info as they have them."""
    ours, theirs = side_by_side(mode)
    observation, info = ours.reset(seed=11)
    expected, expected_info = theirs.reset(seed=11)
    np.testing.assert_array_equal(observation, expected)
    assert_same(info, expected_info)
    rng, episodes = np.random.default_rng(0), np.zeros(ROWS)
    for _ in range(250):
        action = rng.uniform(-1.0, 1.0, (ROWS, 2)).astype(np.float32)
        action[:, 0] = 1.0
        observation, *results, info = ours.step(action)
        expected, *expected_results, expected_info = theirs.step(action)
        ended = expected_results[1] | expected_results[2]
        np.testing.assert_array_equal(observation, expected)
        for mine, other in zip(results, expected_results, strict=True):
            np.testing.assert_array_equal(mine, other.astype(mine.dtype))
        if mode is AutoresetMode.SAME_STEP:  # of a row that ended our info tells the step, theirs the reset
            assert_same(
                info,
                {name: expected_info[name] for name in ("final_obs", "final_info")} if ended.any() else {},
            )
            assert_same(info, {k: v for k, v in expected_info.items() if "final" not in k}, ~ended)
        else:
            assert_same(info, expected_info)
        episodes += ended
    assert (episodes >= 1).all()
    assert episodes.sum() >= 2 * ROWS


@pytest.mark.slow
def test_in_processes_of_their_own_they_drive_the_same() -> None:
    ours = gymnasium.make_vec(adrl.ENV_ID, num_envs=3, autoreset_mode="NextStep", **OPTIONS)
    # Spawned: JAX of other tests has threads, which a fork would break.
    theirs = gymnasium.make_vec(
        adrl.ENV_ID, num_envs=3, vectorization_mode="async", vector_kwargs={"context": "spawn"}, **OPTIONS
    )
    try:
        np.testing.assert_array_equal(ours.reset(seed=4)[0], theirs.reset(seed=4)[0])
        forward = np.tile(np.array([1.0, 0.2], np.float32), (3, 1))
        ended = np.zeros(3)
        for _ in range(120):
            observation, _, terminated, truncated, _ = ours.step(forward)
            np.testing.assert_array_equal(observation, theirs.step(forward)[0])
            ended += terminated | truncated
        assert (ended > 0).all()
    finally:
        theirs.close()


@pytest.mark.parametrize("mode", ["sync", "vector_entry_point"])
def test_environments_without_a_seed_are_no_copies(mode: str) -> None:
    """Neither each other's nor an earlier one's; nor are later episodes."""
    first = [
        gymnasium.make_vec(adrl.ENV_ID, num_envs=4, vectorization_mode=mode).reset()[0] for _ in range(2)
    ]
    rows = np.concatenate(first)
    assert len({row.tobytes() for row in rows}) == 8


@pytest.mark.parametrize("options", [{}, {"guidance": "map", "scenario": "dynamic", "task_pool": 16}])
def test_a_row_depends_on_its_own_seed_alone(options: dict[str, Any]) -> None:
    """However many others there are, and whatever they do; a seed a row as Gymnasium's own take it."""
    few, many = NavVectorEnv(2, **options), NavVectorEnv(6, **options)
    few.reset(seed=20)
    many.reset(seed=[7, 20, 8, 21, None, 9])
    rng = np.random.default_rng(1)
    for _ in range(150):
        action = rng.uniform(-1.0, 1.0, (6, 2)).astype(np.float32)
        action[:, 0] = 1.0
        np.testing.assert_array_equal(few.step(action[[1, 3]])[0], many.step(action)[0][[1, 3]])


def test_seeds_and_generators_are_where_gymnasium_has_them() -> None:
    single, vector = NavEnv(), NavVectorEnv(3)
    single.reset(seed=6)
    vector.reset(seed=6)
    assert single.np_random_seed == 6
    assert vector.np_random_seed == (6, 7, 8)
    assert vector.np_random[0].random() == single.np_random.random()
    single.np_random = np.random.default_rng(3)
    vector.np_random = tuple(np.random.default_rng(k) for k in (3, 4, 5))
    np.testing.assert_array_equal(single.reset()[0], vector.reset()[0][0])
    assert vector.np_random_seed == (-1, -1, -1)
    with pytest.raises(ConfigError, match="3 random streams"):
        vector.np_random = vector.np_random[:2]


def test_seeds_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ConfigError, match="2 seeds for 3 rows"):
        NavVectorEnv(3).reset(seed=[1, 2])
    with pytest.raises(ConfigError, match="share one random stream"):
        NavVectorEnv(3, task_priority=1.0).reset(seed=[1, 2, 3])
    with pytest.raises(gymnasium.error.Error, match="Seed"):
        NavVectorEnv(3).reset(seed=-5)


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_the_mode_is_told_in_both_places(mode: AutoresetMode) -> None:
    env = NavVectorEnv(2, autoreset_mode=mode.value)
    assert env.autoreset_mode is env.metadata["autoreset_mode"] is mode
    assert NavVectorEnv.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP


def test_an_episode_is_cut_at_max_episode_steps() -> None:
    """By Gymnasium's wrapper around one environment and by our vector alike."""
    still = np.array([-1.0, 0.0], np.float32)
    single = gymnasium.make(adrl.ENV_ID, max_episode_steps=7)
    vector = gymnasium.make_vec(adrl.ENV_ID, num_envs=2, max_episode_steps=7)
    single.reset(seed=0)
    vector.reset(seed=0)
    for step in range(1, 8):
        assert single.step(still)[3] == (step == 7)
        assert (vector.step(np.tile(still, (2, 1)))[3] == (step == 7)).all()
    with pytest.raises(ConfigError, match="max_episode_steps is 0"):
        NavVectorEnv(max_episode_steps=0)


def test_options_that_do_nothing_are_refused() -> None:
    single, vector = NavEnv(), NavVectorEnv(2)
    for env, takes in ((single, "takes none"), (vector, "takes reset_mask")):
        env.reset(seed=0, options={})
        with pytest.raises(ConfigError, match=f"hold 'foo', and this environment {takes}; leave it out"):
            env.reset(options={"foo": 1})
        env.step(env.action_space.sample())  # as it was before


def test_options_are_left_as_they_were() -> None:
    env = NavVectorEnv(2)
    env.reset(seed=0)
    options = {"reset_mask": np.array([True, False])}
    before = copy.deepcopy(options)
    _, info = env.reset(options=options)
    np.testing.assert_array_equal(options["reset_mask"], before["reset_mask"])
    np.testing.assert_array_equal(info["_success"], options["reset_mask"])
    for mask in (np.array([True]), np.array([1, 0]), np.array([False, False])):
        with pytest.raises(ConfigError, match="reset_mask"):
            env.reset(options={"reset_mask": mask})
