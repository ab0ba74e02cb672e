"""Guidance, rewards and the expert as the environment puts them together."""

import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from adrl import _core
from adrl.envs import NavVectorEnv
from adrl.observation import to_action
from adrl.planning.path_guide import LOOKAHEAD_M
from adrl.rewards import REWARD_TERMS, RewardConfig, reward
from adrl.rewards.step import reference_period_s
from adrl.rewards.terms import HEADING_DECAY, HEADING_GAIN_M
from adrl.types import Array, RobotConfig, Task
from adrl.worlds import ROBOTS, single_task
from env_tasks import OneTask, quiet, room, straight_task, wrapped

NO_FOOTPRINT = np.empty((0, 2))
FORWARD = np.array([1.0, 0.0], dtype=np.float32)


def nearest_on_path(path: Array, point: Array) -> tuple[float, float]:
    """(distance to the polyline, arc length of the nearest place), segment by segment."""
    best, arc = (np.inf, 0.0), 0.0
    for a, b in pairwise(path):
        length = float(np.hypot(*(b - a)))
        along = float(np.clip((point - a) @ (b - a) / max(length, 1e-12) ** 2, 0.0, 1.0))
        best = min(best, (float(np.hypot(*(a + along * (b - a) - point))), arc + along * length))
        arc += length
    return best


def free_line(task: Task, a: Array, b: Array, radius_m: float) -> bool:
    """Whether a disc can be pushed from a to b."""
    points = a + np.linspace(0.0, 1.0, 200)[:, None] * (b - a)
    poses = np.column_stack([points, np.zeros(200)])
    return bool((_core.clearance(task.world.native, poses, radius_m, NO_FOOTPRINT, 1.0) > 0.0).all())


def along(path: Array, step_m: float) -> Array:
    """(P, 3) poses every step_m of a polyline, looking where it goes."""
    pieces = []
    for a, b in pairwise(path):
        length, heading = math.dist(a, b), math.atan2(b[1] - a[1], b[0] - a[0])
        at = np.arange(0.0, length, step_m)[:, None]
        pieces.append(np.column_stack([a + at / length * (b - a), np.full(len(at), heading)]))
    return np.concatenate(pieces)


@pytest.mark.parametrize("name", ROBOTS)
def test_map_guidance_gives_a_visible_point_of_the_path(name: str) -> None:
    """A robot carried along its path: the waypoint is on it, ahead, in the look-ahead and in plain view."""
    robot = ROBOTS[name]
    env = NavVectorEnv(
        1, scenario="complex", robot=robot, guidance="map", randomize=False, autoreset_mode="Disabled"
    )
    stand = to_action(np.zeros((1, 2)), robot)
    for seed in range(3):
        env.reset(seed=seed)
        task = env.sim.tasks[0]
        assert task is not None
        far = []
        for pose in along(task.path, 0.4)[:-1]:
            env.sim.b["pose"][0] = pose
            env.step(stand)
            waypoint, here = env.sim.b["waypoint"][0], env.sim.b["memory"][0, 0]
            gap, ahead = nearest_on_path(task.path, waypoint)
            assert gap < 1e-6
            assert here < ahead <= here + LOOKAHEAD_M + 1e-6 or ahead == pytest.approx(task.shortest_m)
            assert nearest_on_path(task.path, pose[:2])[1] == pytest.approx(here, abs=0.05)
            assert free_line(task, pose[:2], waypoint, 0.9 * robot.circumscribed_radius_m)
            far.append(ahead - here)
        assert np.median(far) > 0.7 * LOOKAHEAD_M


def test_goal_guidance_gives_the_goal() -> None:
    env = NavVectorEnv(4, scenario="complex", guidance="goal", task_pool=4)
    env.reset(seed=0)
    for _ in range(5):
        env.step(env.expert_actions())
        goals = [task.goal for task in env.sim.tasks if task is not None]
        np.testing.assert_array_equal(env.sim.b["waypoint"], goals)


@pytest.mark.parametrize("guidance", ["goal", "map"])
@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("yaw", [0.0, 0.4, -2.5])
def test_approach_rewards_of_a_drive_telescope(name: str, guidance: str, yaw: float) -> None:
    """Their sum is what start and end differ in (eq 10): no detour earns more. A new waypoint counts anew."""
    robot = quiet(ROBOTS[name])
    task = straight_task(robot, yaw=yaw, time_limit_s=200.0)
    env = NavVectorEnv(
        1, scenario=OneTask(task), robot=robot, guidance=guidance, randomize=False, autoreset_mode="Disabled"
    )
    env.reset(seed=0)
    b = env.sim.b
    total, faced, succeeded = 0.0, [], False
    distance = [to_go(env)]
    for step in range(400):
        action = env.expert_actions() if step > 20 else wiggle(step)
        waypoint, pose = b["waypoint"][0].copy(), b["pose"][0].copy()
        _, _, terminated, _, info = env.step(action)
        total += float(info["reward_terms"][0, COLUMN["approach"]])
        faced.append((facing(pose, waypoint), facing(b["pose"][0], waypoint)))
        succeeded = bool(info["success"][0])
        if terminated[0]:
            break
    assert succeeded
    distance.append(to_go(env))
    gained = sum(after - before for before, after in faced)
    if guidance == "goal":
        assert gained == pytest.approx(faced[-1][1] - faced[0][0])
    step_m = robot.max_speed_mps * reference_period_s(robot.max_speed_mps)
    assert total == pytest.approx((distance[0] - distance[1] + gained) / step_m, rel=1e-5, abs=1e-4)


COLUMN = {name: i for i, name in enumerate(REWARD_TERMS)}


def wiggle(step: int) -> NDArray[np.float32]:
    """(1, 2) slowly ahead, turning to and fro."""
    return np.array([[0.2, 0.9 * (-1) ** (step // 5)]], dtype=np.float32)


def to_go(env: NavVectorEnv) -> float:
    """Metres to the goal, along the path with a map."""
    b = env.sim.b
    return float(
        b["route_left"][0] if env.sim.guidance == "map" else np.hypot(*(b["waypoint"] - b["pose"][:, :2])[0])
    )


def facing(pose: Array, waypoint: Array) -> float:
    """What looking at the waypoint is worth in metres: 1/4 exp(-2 |h|)."""
    x, y = waypoint - pose[:2]
    return HEADING_GAIN_M * math.exp(-HEADING_DECAY * abs(wrapped(math.atan2(y, x) - pose[2])))


def test_straight_drive_earns_its_length() -> None:
    """At full speed at the goal: the approach terms are 1 a step but for speeding up; nothing else costs."""
    robot = quiet(RobotConfig(lag_s=0.0, max_acceleration_mps2=100.0))
    env = NavVectorEnv(1, scenario=OneTask(straight_task(robot)), robot=robot, randomize=False)
    env.reset(seed=0)
    rows = []
    while True:
        _, _, terminated, _, info = env.step(FORWARD[None])
        rows.append(info["reward_terms"][0])
        if terminated[0]:
            break
    terms = np.array(rows)
    assert terms[:, COLUMN["approach"]].sum() * 0.06 == pytest.approx(0.06 * len(rows) - 0.03)
    np.testing.assert_allclose(terms[1:, COLUMN["approach"]], 1.0, atol=1e-6)
    np.testing.assert_allclose(terms[1:, COLUMN["motion"]], 0.0, atol=1e-6)
    assert (terms[:, [1, 4, 5]] == 0.0).all()
    assert terms[-1, 0] == RewardConfig().success_reward


def test_reward_is_formed_from_what_info_tells() -> None:
    """eq 17 with the environment's S; features are of the state before the action."""
    env = NavVectorEnv(16, maturity=0.3)
    env.reset(seed=0)
    before = None
    for _ in range(60):
        _, rewards, terminated, truncated, info = env.step(env.expert_actions())
        again = reward(info["reward_terms"], info["features"], 0.3, RewardConfig())
        np.testing.assert_allclose(rewards, again, rtol=1e-6)
        if before is not None:
            rows = ~before[1]
            np.testing.assert_array_equal(info["features"][rows, 0], before[0][rows])
        threat = np.clip(1.0 - env.sim.b["clearance"] / RewardConfig().safe_clearance_m, 0.0, 1.0)
        before = threat.astype(np.float32), terminated | truncated


def test_the_expert_sees_through_noise_and_around_corners() -> None:
    """It knows the map: its actions do not depend on the scan, and it gets round a wall before the goal."""
    robot = RobotConfig()
    world = room(segments=[[0.0, -3.0, 0.0, 3.0]])
    task = single_task(world, (-2.0, 0.0, 0.0), (2.0, 0.0), robot)
    env = NavVectorEnv(1, scenario=OneTask(task), autoreset_mode="Disabled")
    env.reset(seed=0)
    for _ in range(300):
        action = env.expert_actions()
        assert action in env.action_space
        env.sim.b["ranges"][:] = 0.0
        np.testing.assert_array_equal(env.expert_actions(), action)
        _, _, terminated, _, info = env.step(action)
        if terminated[0]:
            break
    assert info["success"][0]  # pyright: ignore


def test_the_literal_eq_8_counts_an_obstacle_beside_a_long_robot() -> None:
    """Its middle is nearer than the circumscribed radius of 0.41 m, and 0.1 m of air is between them."""
    corners = ((0.4, 0.1), (-0.4, 0.1), (-0.4, -0.1), (0.4, -0.1))
    robot = quiet(RobotConfig(radius_m=None, footprint_m=corners))
    beside, clear = (
        dataclasses.replace(straight_task(robot), world=room(circles=[(-2.0, y, 0.05)])) for y in (0.25, 0.45)
    )
    for given, paid in ((beside, -200.0), (clear, 0.0)):
        env = NavVectorEnv(
            1,
            scenario=OneTask(given),
            robot=robot,
            randomize=False,
            reward_config=RewardConfig(eq8="literal"),
        )
        env.reset(seed=0)
        *_, info = env.step(to_action(np.zeros((1, 2)), robot))
        assert not info["collision"][0]
        assert info["reward_terms"][0, list(REWARD_TERMS).index("failure")] == paid
