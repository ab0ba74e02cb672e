"""Environments pickle and copy as they stand: a copy goes on to the same bytes, and neither touches the other."""

import copy
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import adrl
from adrl.envs import NavEnv, NavVectorEnv
from adrl.errors import ConfigError
from adrl.types import RobotConfig
from adrl.worlds import MapScenario
from env_tasks import OneTask, straight_task
from map_files import write_map

COPIES: dict[str, Callable[[Any], Any]] = {
    "pickle": lambda env: pickle.loads(pickle.dumps(env)),
    "deepcopy": copy.deepcopy,
}
EVERY_WAY = pytest.mark.parametrize("way", COPIES)
TURNING = np.array([1.0, 0.4], np.float32)


@EVERY_WAY
@pytest.mark.parametrize(
    "options",
    [
        {"guidance": "replan", "scenario": "complex", "task_pool": 4, "maturity": 0.9},
        {"guidance": "map", "scenario": "dynamic", "task_pool": 4, "task_priority": 2.0},
        {"robot": "jackal", "encoder": {"history_steps": 3}, "task_pool": 8, "autoreset_mode": "NextStep"},
        {"scenario": OneTask(straight_task(RobotConfig())), "robot": RobotConfig()},
    ],
)
def test_a_vector_goes_on_as_it_would_have(options: dict[str, Any], way: str) -> None:
    env = NavVectorEnv(3, **options)
    env.reset(seed=5)
    actions = np.tile(TURNING, (3, 1))
    for _ in range(40):
        env.step(actions)
    env.maturity = 0.7
    env.action_space.seed(3)
    twin = COPIES[way](env)
    assert (twin.maturity, twin.metadata, twin.robot.name) == (env.maturity, env.metadata, env.robot.name)
    np.testing.assert_array_equal(twin.action_space.sample(), env.action_space.sample())
    for _ in range(120):
        for mine, other in zip(env.step(actions)[:4], twin.step(actions)[:4], strict=True):
            np.testing.assert_array_equal(mine, other)
    for name, array in env.state().items():
        np.testing.assert_array_equal(array, twin.state()[name], err_msg=name)


@EVERY_WAY
def test_a_single_one_in_its_wrappers(way: str) -> None:
    env = gymnasium.make(adrl.ENV_ID, render_mode="rgb_array")
    env.reset(seed=2)
    for _ in range(4):
        env.step(TURNING)
    twin = COPIES[way](env)
    np.testing.assert_array_equal(env.render(), twin.render())
    alone = twin.step(TURNING)[0]
    twin.reset()
    np.testing.assert_array_equal(env.step(TURNING)[0], alone)  # the twin's reset touches the twin alone
    assert env.unwrapped.np_random is env.unwrapped._env.np_random[0]  # pyright: ignore[reportAttributeAccessIssue]
    inner: NavEnv = twin.unwrapped
    assert inner.np_random is inner._env.np_random[0]


@EVERY_WAY
def test_before_the_first_reset(way: str) -> None:
    """A copy of an environment that nothing has seeded is seeded by itself."""
    env = NavEnv(seed=8)
    np.testing.assert_array_equal(COPIES[way](env).reset()[0], NavEnv().reset(seed=8)[0])
    unseeded = NavEnv()
    assert (COPIES[way](unseeded).reset()[0] != unseeded.reset()[0]).any()


@EVERY_WAY
def test_in_a_world_from_a_file(way: str, tmp_path: Path) -> None:
    pixels = np.full((200, 200), 254)
    pixels[[0, -1]] = pixels[:, [0, -1]] = 0
    env = NavEnv(scenario=MapScenario(write_map(tmp_path, pixels)), task_pool=2)
    env.reset(seed=0)
    np.testing.assert_array_equal(COPIES[way](env).step(TURNING)[0], env.step(TURNING)[0])


@EVERY_WAY
def test_robots_of_another_program_are_not_copied(way: str) -> None:
    class Still:
        num_envs = 1

        def reset(self, indices: Any, tasks: Any, b: Any) -> None: ...

        def step(self, b: Any) -> None: ...

    env = NavVectorEnv(1, body=Still(), randomize=False)
    with pytest.raises(ConfigError, match="cannot be copied"):
        COPIES[way](env)
