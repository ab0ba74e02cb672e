"""Laws of the environment: determinism, resume, autoreset and the two endings."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from adrl.envs import NavEnv, NavVectorEnv
from adrl.observation import to_action
from adrl.rewards import reward_terms
from adrl.types import RobotConfig
from adrl.worlds import ROBOTS, single_task
from env_tasks import OneTask, quiet, room, straight_task

FORWARD = np.array([1.0, 0.0], dtype=np.float32)
STOP = np.array([-1.0, 0.0], dtype=np.float32)


def fingerprint(values: Any) -> bytes:
    """All bytes of what step() or reset() returned, with shapes and types."""
    if isinstance(values, dict):
        return b"".join(key.encode() + fingerprint(values[key]) for key in sorted(values))
    if isinstance(values, tuple):
        return b"".join(fingerprint(value) for value in values)
    array = np.asarray(values)
    if array.dtype == object:  # a row's observation, or None
        return b"".join(fingerprint(value) if value is not None else b"-" for value in array)
    return f"{array.shape}{array.dtype}".encode() + array.tobytes()


def drive(env: NavVectorEnv, seed: int, steps: int) -> Iterator[bytes]:
    """Random but forward driving: episodes end often."""
    rng = np.random.default_rng(seed)
    for _ in range(steps):
        action = rng.uniform(-1.0, 1.0, (env.num_envs, 2)).astype(np.float32)
        action[:, 0] = 1.0
        yield fingerprint(env.step(action))


def random_robot() -> RobotConfig:
    """Everything that is random at once."""
    robot = ROBOTS["diffbot"]
    lidar = dataclasses.replace(robot.lidar, noise_std_m=0.05, dropout_probability=0.1)
    return dataclasses.replace(robot, lidar=lidar, latency_s=0.13, odometry_drift=0.1)


OPTIONS: list[dict[str, Any]] = [
    {},
    {"guidance": "map", "scenario": "dynamic", "task_pool": 8},
    {"robot": random_robot(), "task_pool": 32},
    {"robot": "jackal", "task_pool": 16, "maturity": 0.9, "task_priority": 2.0},
]


@pytest.mark.parametrize("options", OPTIONS)
def test_equal_seeds_equal_bytes(options: dict[str, Any]) -> None:
    """Two environments, other numbers of threads, and the same one a second time."""
    runs = []
    env = NavVectorEnv(7, **options)
    for instance in (env, NavVectorEnv(7, num_threads=3, seed=1, **options), env):
        runs.append([fingerprint(instance.reset(seed=11)), *drive(instance, 1, 120)])
    assert runs[0] == runs[1] == runs[2]
    assert runs[0] != [fingerprint(env.reset(seed=12)), *drive(env, 1, 120)]


def test_constructor_seed_is_that_of_the_first_reset() -> None:
    one, other = NavVectorEnv(3, seed=4), NavVectorEnv(3, seed=5)
    assert fingerprint(one.reset()) == fingerprint(other.reset(seed=4))


@pytest.mark.parametrize("options", OPTIONS)
def test_vector_env_of_one_equals_the_single_env(options: dict[str, Any]) -> None:
    """Over episodes: the single env's last observation is next_obs, its reset() the vector's autoreset."""
    vector, single = NavVectorEnv(1, **options), NavEnv(**options)
    observation, _ = vector.reset(seed=3)
    alone, _ = single.reset(seed=3)
    assert observation[0].tobytes() == alone.tobytes()
    rng, episodes = np.random.default_rng(0), 0
    for _ in range(400):
        action = np.array([1.0, rng.uniform(-1.0, 1.0)], dtype=np.float32)
        observation, reward, terminated, truncated, info = vector.step(action[None])
        alone, alone_reward, alone_terminated, alone_truncated, alone_info = single.step(action)
        assert info["next_obs"][0].tobytes() == alone.tobytes()
        assert (reward[0], terminated[0], truncated[0]) == (alone_reward, alone_terminated, alone_truncated)
        assert all(fingerprint(info[name][0]) == fingerprint(alone_info[name]) for name in alone_info)
        assert set(alone_info) == {"reward_terms", "features", "success", "is_success", "collision"}
        if terminated[0] or truncated[0]:
            alone, reset_info = single.reset()
            assert set(reset_info) == set(alone_info)
            episodes += 1
        assert observation[0].tobytes() == alone.tobytes()
    assert episodes >= 2


@pytest.mark.parametrize("options", OPTIONS)
def test_state_continues_to_the_same_bytes(options: dict[str, Any]) -> None:
    """Taken mid-episode and put into an environment that has lived another life."""
    env = NavVectorEnv(6, **options)
    env.reset(seed=8)
    list(drive(env, 2, 57))
    state = env.state()
    kept = {name: array.copy() for name, array in state.items()}
    expected = [fingerprint(env.expert_actions()), *drive(env, 3, 150)]
    assert all(np.array_equal(state[name], kept[name]) for name in kept), "state() must hand out copies"
    other = NavVectorEnv(6, seed=99, num_threads=2, **options)
    other.reset()
    list(drive(other, 4, 31))
    other.set_state(state)
    assert [fingerprint(other.expert_actions()), *drive(other, 3, 150)] == expected
    assert fingerprint(other.state()) == fingerprint(env.state())
    assert all(array.dtype != object for array in state.values())


@pytest.mark.parametrize("guidance", ["goal", "map"])
def test_next_obs_is_the_true_successor(guidance: str) -> None:
    """What an environment without autoreset observes after the very same step."""
    env = NavVectorEnv(16, guidance=guidance)
    twin = NavVectorEnv(16, guidance=guidance, autoreset_mode="Disabled")
    env.reset(seed=1)
    twin.reset(seed=1)
    rng, ended_rows = np.random.default_rng(1), 0
    for _ in range(150):
        action = rng.uniform(-1.0, 1.0, (16, 2)).astype(np.float32)
        observation, _, terminated, truncated, info = env.step(action)
        before_reset, _, twin_terminated, twin_truncated, _ = twin.step(action)
        ended = terminated | truncated
        np.testing.assert_array_equal(ended, twin_terminated | twin_truncated)
        assert info["next_obs"].tobytes() == before_reset.tobytes()
        np.testing.assert_array_equal(observation[~ended], info["next_obs"][~ended])
        assert (observation[ended] != info["next_obs"][ended]).any(axis=1).all()
        assert ("final_obs" in info) == ("final_info" in info) == ended.any()
        if ended.any():
            np.testing.assert_array_equal(info["_final_obs"], ended)
            np.testing.assert_array_equal(np.stack(info["final_obs"][ended]), before_reset[ended])
            fresh, _ = twin.reset(options={"reset_mask": ended})
            assert fresh.tobytes() == observation.tobytes()
        ended_rows += int(ended.sum())
    assert ended_rows > 10


def test_endings_exclude_each_other_and_say_why() -> None:
    """terminated = success or collision, never both, never with truncated; all three happen."""
    task = straight_task(RobotConfig(), yaw=np.pi, time_limit_s=12.0)
    env = NavVectorEnv(30, scenario=OneTask(task))
    env.reset(seed=0)
    counts = np.zeros(3, dtype=int)
    for _ in range(150):
        action = env.expert_actions()  # turns round and arrives
        action[10:20] = STOP
        action[20:] = FORWARD  # into the wall
        _, _, terminated, truncated, info = env.step(action)
        np.testing.assert_array_equal(terminated, info["success"] | info["collision"])
        assert not (info["success"] & info["collision"]).any()
        assert not (terminated & truncated).any()
        np.testing.assert_array_equal(info["reward_terms"][:, 0] > 0.0, info["success"])
        np.testing.assert_array_equal(info["reward_terms"][:, 1] < 0.0, info["collision"])
        counts += [info["success"].sum(), info["collision"].sum(), truncated.sum()]
    assert (counts >= 10).all()


def test_standing_still_truncates_at_the_time_limit() -> None:
    task = straight_task(RobotConfig(), time_limit_s=1.5)
    env = NavVectorEnv(3, scenario=OneTask(task), autoreset_mode="Disabled")
    env.reset(seed=0)
    for step in range(1, 16):
        _, _, terminated, truncated, info = env.step(np.tile(STOP, (3, 1)))
        assert not terminated.any()
        assert truncated.all() == truncated.any() == (step == 15)
        assert (info["reward_terms"][:, :2] == 0.0).all(), "a timeout costs nothing by itself"


def test_arriving_at_the_time_limit_is_an_arrival() -> None:
    robot = quiet(RobotConfig())
    env = NavEnv(scenario=OneTask(straight_task(robot)), robot=robot, randomize=False)
    env.reset(seed=0)
    steps = next(i for i in range(1, 200) if env.step(FORWARD)[2])
    for limit, arrives in ((steps, True), (steps - 1, False)):
        task = straight_task(robot, time_limit_s=0.1 * limit)
        env = NavEnv(scenario=OneTask(task), robot=robot, randomize=False)
        env.reset(seed=0)
        for _ in range(limit):
            _, _, terminated, truncated, _ = env.step(FORWARD)
        assert (terminated, truncated) == (arrives, not arrives)  # pyright: ignore


def test_driving_into_a_wall_collides() -> None:
    robot = RobotConfig()
    task = single_task(room(segments=[[0.0, -1.0, 0.0, 1.0]]), (-1.0, 0.0, 0.0), (2.0, 0.0), robot)
    env = NavVectorEnv(2, scenario=OneTask(task), autoreset_mode="Disabled")
    env.reset(seed=0)
    for _ in range(40):
        _, _, terminated, _, info = env.step(np.tile(FORWARD, (2, 1)))
        if terminated.all():
            break
    assert info["collision"].all()  # pyright: ignore
    assert not info["success"].any()  # pyright: ignore
    np.testing.assert_allclose(env.sim.b["pose"][:, 0], -0.2, atol=2e-3)


def test_reset_mask_leaves_the_others_alone() -> None:
    env = NavVectorEnv(4, autoreset_mode="Disabled")
    env.reset(seed=5)
    list(drive(env, 0, 5))
    before: dict[str, NDArray[Any]] = env.state()
    env.reset(options={"reset_mask": np.array([False, True, False, True])})
    after = env.state()
    assert (after["time"] == [before["time"][0], 0.0, before["time"][2], 0.0]).all()
    for name in ("pose", "ranges", "features", "displacements", "last_action", "memory", "params"):
        np.testing.assert_array_equal(after[name][[0, 2]], before[name][[0, 2]])
        assert (after[name][[1, 3]] != before[name][[1, 3]]).any() or name in ("features",)


def test_tasks_that_fail_are_drawn_more_often():
    """Of eight tasks in which robots run straight on, those that end in a crash come again more often."""
    plain, prioritised = (
        NavVectorEnv(16, task_pool=8, task_priority=priority, randomize=False) for priority in (0.0, 4.0)
    )
    crashes = {}
    for env in (plain, prioritised):
        env.reset(seed=5)
        ended_in = np.zeros((2, 8))
        for _ in range(400):
            before = env._task_index.copy()
            *_, info = env.step(np.where(before[:, None] < 4, FORWARD, env.expert_actions()))
            np.add.at(ended_in[0], before[info["success"]], 1)
            np.add.at(ended_in[1], before[info["collision"]], 1)
        assert ended_in[1, :4].sum() > 20
        crashes[env] = ended_in[1].sum() / ended_in.sum()
    assert crashes[prioritised] > crashes[plain]


def test_every_ending_of_a_task_counts():
    """Robots that end one and the same task in one step: its failure rate falls by 0.3 of itself for each."""
    env = NavVectorEnv(3, task_pool=1, task_priority=1.0, randomize=False, autoreset_mode="Disabled")
    env.reset(seed=0)
    env.sim.b["pose"][:2, :2] = env._pool[0].goal
    *_, info = env.step(np.zeros((3, 2), np.float32))
    assert info["success"].tolist() == [True, True, False]
    assert env.state()["failure_rate"].tolist() == pytest.approx([0.7**2])


@pytest.mark.parametrize("robot", ROBOTS)
def test_periods_are_what_a_step_is_paid_for(robot: str) -> None:
    """A standing robot far from all pays eq 9's -1 a reference period."""
    env = NavVectorEnv(3, robot=robot, task_pool=4, seed=0)
    env.reset()
    paid = env.step(to_action(np.zeros((3, 2)), env.robot))[-1]["reward_terms"]
    motion = list(reward_terms(env.sim.reward)).index("motion")
    np.testing.assert_allclose(-paid[:, motion], env.periods, rtol=1e-6)
