"""Guidance replan in the simulator, with the policy that ships."""

import dataclasses
import math

import numpy as np
import pytest

import adrl
from adrl.deploy.policy import MlpPolicy, load_policy, resolve_policy
from adrl.envs import NavSim, NavVectorEnv, Setting
from adrl.evaluation.rollout import Rollout, rollout
from adrl.observation import EncoderConfig, in_robot_frame
from adrl.planning.replanner_config import ReplannerConfig
from adrl.types import RobotConfig, Task, World
from adrl.worlds import robot_from_fields
from core.arenas import box
from env_tasks import OneTask, quiet, room, straight_task

POLICY = load_policy(resolve_policy("diffbot"))
ROBOT = robot_from_fields(POLICY.config.robot)
ENCODER = EncoderConfig(**POLICY.config.encoder)
CONFIG = ReplannerConfig(cells=200)


def task(world: World, start: tuple[float, float, float], goal: tuple[float, float]) -> Task:
    """A task whose path, which no mapless robot uses, is the straight line."""
    path = np.array([start[:2], goal])
    return Task(
        world=world, start=start, goal=goal, path=path, shortest_m=math.dist(*path), time_limit_s=60.0
    )


def u_trap() -> Task:
    """The robot heads into a pocket between it and the goal."""
    pocket = (box(1.0, 0.0, 0.06, 1.0), box(0.2, 0.95, 0.8, 0.06), box(0.2, -0.95, 0.8, 0.06))
    world = dataclasses.replace(room(10.0), polygons=pocket)
    return task(world, (-2.5, 0.0, 0.0), (3.0, 0.0))


def run(given: Task, guidance: str, seed: int = 0) -> Rollout:
    return rollout(
        POLICY,
        [given],
        Setting(
            robot=ROBOT,
            guidance=guidance,
            encoder=ENCODER,
            replanner=CONFIG,
            maturity=POLICY.config.maturity,
        ),
        seed=seed,
        num_threads=1,
    )


def test_a_trap_that_goal_guidance_never_leaves_is_left() -> None:
    stuck, freed = run(u_trap(), "goal"), run(u_trap(), "replan")
    assert not stuck.episodes.success[0]
    assert stuck.replans[0] == 0
    assert freed.episodes.success[0]
    assert freed.replans[0] >= 1


def test_a_moving_obstacle_that_stops_in_the_way_is_driven_round() -> None:
    """A disc comes from the side and shuts the doorway in the pocket's back wall. Only the replanner gets out."""
    plain = u_trap().world
    halves = (box(1.0, 0.7, 0.06, 0.3), box(1.0, -0.7, 0.06, 0.3))
    disc = [1.4, 3.0, 1.2, 0.0, 0.5, 1.0, 0.0, math.hypot(0.2, 3.0)]
    open_door = dataclasses.replace(plain, polygons=(*halves, *plain.polygons[1:]))
    shut = dataclasses.replace(open_door, discs=np.array([disc]))
    ends = (-2.5, 0.0, 0.0), (3.0, 0.0)
    assert run(task(open_door, *ends), "goal").episodes.success[0]
    assert not run(task(shut, *ends), "goal").episodes.success[0]
    driven = run(task(shut, *ends), "replan")
    assert driven.episodes.success[0]
    assert driven.replans[0] >= 1


LEFT_ALONE = dataclasses.replace(CONFIG, maturity_gain=1e6, foresight_m=0.0)
"""Eq 18 alone, and at S = 1 with thresholds that are below the noise of a scan."""


def test_a_policy_is_driven_with_its_own_s() -> None:
    """adrl.evaluate takes S of eq 20 from the policy."""
    replans = []
    for maturity in (0.0, 1.0):
        policy = MlpPolicy(POLICY.layers, dataclasses.replace(POLICY.config, maturity=maturity))
        driven = adrl.evaluate(policy, tasks=[u_trap()], guidance="replan", replanner=LEFT_ALONE)
        replans.append(int(driven.rollout.replans[0]))
    assert replans[0] >= 1
    assert replans[1] == 0


def test_thresholds_follow_s_while_robots_drive() -> None:
    """The environment's S may change between steps, as it does in training."""
    env = NavVectorEnv(
        1,
        scenario=OneTask(u_trap()),
        robot=ROBOT,
        guidance="replan",
        randomize=False,
        replanner=LEFT_ALONE,
        maturity=1.0,
    )
    env.reset(seed=0)
    assert env.sim.replanner is not None
    stand = np.array([[-1.0, 0.0]], np.float32)
    for maturity, replans in ((1.0, 0), (0.0, 1)):
        env.maturity = maturity
        for _ in range(30):
            env.step(stand)
        assert env.maturity == maturity
        assert env.sim.replanner.replans[0] == replans


def test_what_has_not_been_seen_does_not_matter() -> None:
    """Behind the pocket's back wall the world may be anything: the same scans give the same waypoints."""
    plain = u_trap()
    hidden = dataclasses.replace(plain.world, circles=np.array([[3.0, 2.2, 0.3], [2.0, -0.3, 0.4]]))
    tracks = []
    for world in (plain.world, hidden):
        sim = NavSim(1, ROBOT, guidance="replan", encoder=ENCODER, replanner=CONFIG)
        inside = dataclasses.replace(plain, world=world, start=(0.6, 0.0, 0.0))
        sim.reset(np.array([0]), [inside], np.array([1], dtype=np.uint64), np.random.default_rng(0))
        track = []
        for _ in range(28):
            sim.step(np.array([[-1.0, 0.0]], dtype=np.float32))
            track.append(sim.b["waypoint"][0].copy())
        assert sim.replanner is not None
        assert sim.replanner.replans[0] == 1
        tracks.append(track)
    np.testing.assert_array_equal(*tracks)


def test_the_observation_shows_where_the_waypoint_is_from_the_odometry() -> None:
    """Its direction: a waypoint is near, and is shown as far as a goal that is not about to be reached."""
    sim = NavSim(1, ROBOT, guidance="replan", encoder=ENCODER, replanner=CONFIG)
    start = dataclasses.replace(u_trap(), start=(0.6, 0.0, 0.0))
    sim.reset(np.array([0]), [start], np.array([1], dtype=np.uint64), np.random.default_rng(0))
    for _ in range(25):
        sim.step(np.array([[-1.0, 0.2]], dtype=np.float32))
    goal = in_robot_frame(sim.b["odometry"], sim.b["waypoint"])
    far = goal / np.hypot(*goal.T) * CONFIG.lookahead_m
    shown = sim.encoder.encode(sim.b["ranges"], far, sim.b["twist"], sim._last_action)
    np.testing.assert_allclose(sim.observe(), shown, atol=1e-6)
    assert not np.array_equal(sim.b["waypoint"][0], start.goal)


def test_only_the_goal_itself_ends_an_episode() -> None:
    """A robot that drives over its waypoints has not arrived."""
    given = u_trap()
    robot = quiet(ROBOT)
    env = NavVectorEnv(
        1, scenario=OneTask(given), robot=robot, guidance="replan", randomize=False, replanner=CONFIG
    )
    observation, _ = env.reset(seed=0)
    waypoints, places = [], []
    terminated = np.zeros(1, dtype=bool)
    while not terminated[0]:
        waypoints.append(env.sim.b["waypoint"][0].copy())
        places.append(env.sim.b["pose"][0, :2].copy())
        observation, _, terminated, truncated, info = env.step(POLICY.act(observation))
        assert not truncated[0]
        assert terminated[0] == info["success"][0]
    goals = np.hypot(*(np.array(waypoints) - given.goal).T) < 1e-9
    assert (~goals).sum() > 20
    # The track leads within an arrival's distance of points that were waypoints.
    gaps = np.hypot(*(np.array(waypoints)[~goals, None] - np.array(places)[None]).transpose(2, 0, 1))
    assert gaps.min() < given.goal_tolerance_m


def test_approach_rewards_of_a_straight_run_are_those_of_guidance_goal() -> None:
    robot = quiet(RobotConfig())
    rewards = []
    for guidance in ("goal", "replan"):
        env = NavVectorEnv(
            1, scenario=OneTask(straight_task(robot)), robot=robot, guidance=guidance, randomize=False
        )
        env.reset(seed=0)
        rewards.append([env.step(np.array([[1.0, 0.1]], np.float32))[4]["reward_terms"][0] for _ in range(8)])
    np.testing.assert_allclose(*rewards, rtol=1e-5)


@pytest.mark.parametrize("threads", [1, 2])
def test_resumed_equals_never_stopped(threads: int) -> None:
    def make() -> NavVectorEnv:
        return NavVectorEnv(
            4, scenario="complex", guidance="replan", task_pool=2, replanner=CONFIG, num_threads=threads
        )

    env, other = make(), make()
    observation, _ = env.reset(seed=3)
    for _ in range(50):
        observation = env.step(POLICY.act(observation))[0]
    other.set_state(env.state())
    for _ in range(20):
        action = POLICY.act(observation)
        a, b = env.step(action), other.step(action)
        observation = a[0]
        for x, y in zip(a[:4], b[:4], strict=True):
            np.testing.assert_array_equal(x, y)
    state, twin = env.state(), other.state()
    assert state["replanner.replans"].sum() > 0
    for name, array in state.items():
        np.testing.assert_array_equal(array, twin[name], err_msg=name)
