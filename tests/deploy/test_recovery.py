"""A robot that comes nowhere gets on, touches nothing, and is left alone while it gets on by itself."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest

from adrl.deploy import Command, MlpPolicy, Navigator, Odometry, Pose, Scan, Supervisor
from adrl.deploy.recovery import MOST_TRIES, PATIENCE_S, WAY_M, Recovery
from adrl.envs import NavSim
from adrl.evaluation.supervised import as_scan
from adrl.observation import to_action
from adrl.types import RobotConfig, Task, World
from adrl.worlds import ROBOTS
from deploy.closed_loop import obstacle_course, rid_of_noise, task_in
from deploy.faulty_loop import Loop
from deploy.recorded import a_policy

ROBOT = ROBOTS["diffbot"]
EXACT, JACKAL = rid_of_noise(ROBOT), rid_of_noise(ROBOTS["jackal"])
BOUNDS = (-3.0, -3.0, 6.0, 3.0)
AT_REST = (0.0, 0.0, 0.0)
WALL_AHEAD = World(bounds=BOUNDS, segments=np.array([[0.3, -3.0, 0.3, 3.0]]))
"""Its edge is 0.1 m from diffbot's, and parallel to it at the robot's left and right."""


def asks_for(v: float, w: float) -> MlpPolicy:
    """A policy that wants the same for ever."""
    shipped = a_policy(ROBOT)
    layers = list(shipped.layers)
    weight, bias = layers[-1]
    action = to_action(np.array([[v, w]]), ROBOT)[0].astype(np.float64)
    layers[-1] = (
        np.zeros_like(weight),
        np.arctanh(np.clip(action, -1 + 1e-12, 1 - 1e-12)).astype(bias.dtype),
    )
    return MlpPolicy(layers, shipped.config)


def beside_a_pillar(clear_m: float) -> Task:
    """The pillar stands to the right, a little ahead."""
    away, bearing = 0.15 + 0.2 + clear_m, math.radians(-75.0)
    pillar = [away * math.cos(bearing), away * math.sin(bearing), 0.15]
    return task_in(World(bounds=BOUNDS, circles=np.array([pillar])), AT_REST)


class Helped(Loop):
    """Guidance is the goal alone. Keeps the reasons that were given, and when help began."""

    def __init__(self, policy: MlpPolicy, *tasks: Task, recovery: bool = True) -> None:
        self.recovery = recovery
        self.reasons: set[str] = set()
        self.began_s: list[float] = []
        super().__init__(tasks, ROBOT, guidance="goal", policy=policy)

    def navigator(self, task: Task) -> Navigator:
        return Navigator(self.policy, guidance="goal", recovery=self.recovery)

    def drive(self, seconds: float, **channel: object) -> "Helped":
        before: set[str] = set()
        for _ in range(round(seconds / ROBOT.control_period_s)):
            self.run(1, **channel)  # pyright: ignore
            now = {reason for command in self.commands if command is not None for reason in command.reasons}
            if "recovering" in now - before:
                self.began_s.append(self.step * ROBOT.control_period_s)
            self.reasons |= now
            before = now
        return self


# --- closed loops -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("recovery", [False, True])
def test_a_policy_that_hugs_a_pillar_passes_it(recovery: bool):
    """It asks for straight on, which the supervisor cannot grant; without help the robot stands for ever."""
    loop = Helped(asks_for(0.5, 0.0), beside_a_pillar(0.01), recovery=recovery).drive(15.0)
    assert (loop.sim.b["travelled"][0] > 1.0) == recovery
    assert ("recovering" in loop.reasons) == recovery
    assert not loop.hit.any()


def test_scans_that_fail_now_and_then_do_not_put_it_off():
    loop = Helped(asks_for(0.5, 0.0), beside_a_pillar(0.01))
    loop.drive(15.0, channel=lambda k, i, scan: None if k % 18 < 3 else scan)
    assert loop.sim.b["travelled"][0] > 1.0


def test_who_stands_by_itself_is_helped_as_soon_as_who_is_held():
    """A policy that knows no way on asks for nothing; one that passes too near asks for what it cannot have."""
    waits = [
        Helped(asks_for(speed, 0.0), beside_a_pillar(0.01)).drive(3.0 * PATIENCE_S).began_s[0]
        for speed in (0.0, 0.5)
    ]
    assert waits[0] == waits[1] < 2.0 * PATIENCE_S


@pytest.mark.parametrize("speed", [0.0, 0.3])
def test_turning_on_the_spot_is_left_alone(speed: float):
    """Also where the policy wants to drive besides, which the supervisor does not grant."""
    loop = Helped(asks_for(speed, 0.3), beside_a_pillar(0.01)).drive(5.0)
    assert loop.sim.b["pose"][0][2] > 0.9
    assert "recovering" not in loop.reasons


def test_without_a_free_way_it_waits():
    """Pillars all round, too near to each other to pass between."""
    angles = np.arange(8) * math.pi / 4
    ring = np.stack([0.4 * np.cos(angles), 0.4 * np.sin(angles), np.full(8, 0.1)], axis=1)
    loop = Helped(asks_for(0.5, 0.0), task_in(World(bounds=BOUNDS, circles=ring), AT_REST)).drive(15.0)
    assert "obstacle" in loop.reasons
    assert "recovering" not in loop.reasons
    assert not loop.hit.any()


class ToGoal(Navigator):
    """Drives straight to its goal: turns to it first."""

    def _drive(
        self, scan: Scan, odometry: Odometry, place: Pose, goal: tuple[float, float], now_s: float
    ) -> Command:
        bearing = math.remainder(math.atan2(goal[1] - place[1], goal[0] - place[0]) - place[2], 2.0 * math.pi)
        self.policy = asks_for(0.5 if abs(bearing) < 0.3 else 0.0, min(max(2.0 * bearing, -1.0), 1.0))
        return super()._drive(scan, odometry, place, goal, now_s)


def test_it_gives_up_where_the_policy_comes_back_for_ever():
    """A wall between robot and goal: some ways are tried, all different, and the robot is left where it was."""
    loop = Helped(asks_for(0.5, 0.0), task_in(WALL_AHEAD, AT_REST))
    loop.navigators[0] = ToGoal(loop.policy, guidance="goal")
    loop.navigators[0].set_goal((5.0, 0.0))
    loop.drive(90.0)
    assert len(loop.began_s) == MOST_TRIES
    assert not loop.hit.any()
    assert loop.standing(range(800, 900))


def test_a_new_goal_ends_it_and_one_that_localisation_moved_does_not():
    for moved_m, ends in ((1.0, True), (0.05, False)):
        loop = Helped(asks_for(0.5, 0.0), beside_a_pillar(0.01))
        while "recovering" not in loop.reasons:
            loop.drive(0.1)
        x, y = loop.tasks[0].goal
        loop.navigators[0].set_goal((x - moved_m, y))
        loop.reasons.clear()
        loop.drive(0.1)
        assert ("recovering" not in loop.reasons) == ends


def test_among_obstacles_it_touches_nothing_and_gets_about():
    """Straight on for ever, in full yards: without it each robot ends at the first obstacle."""
    rng = np.random.default_rng(0)
    tasks = [task_in(obstacle_course(rng, 0.6), AT_REST) for _ in range(8)]
    way_m = []
    for recovery in (False, True):
        loop = Helped(asks_for(0.5, 0.0), *tasks, recovery=recovery).drive(40.0)
        assert not loop.hit.any()
        way_m.append(loop.sim.b["travelled"].copy())
    assert (way_m[1] > way_m[0] + 0.2).all(), way_m


# --- its parts ----------------------------------------------------------------------------------------------


def standing_in(world: World, robot: RobotConfig) -> Supervisor:
    """That has seen the world once, from the origin."""
    sim = NavSim(1, robot)
    sim.reset(np.array([0]), [task_in(world, AT_REST)], np.zeros(1, np.uint64), np.random.default_rng(0))
    supervisor = Supervisor(robot)
    scan = as_scan(sim.b["ranges"][0], robot.lidar, 0.0)
    assert supervisor.watch(scan, Odometry(pose=AT_REST, twist=(0.0, 0.0), stamp_s=0.0), 0.0) == ()
    return supervisor


@pytest.mark.parametrize(
    ("wall_m", "degrees", "free"),
    [(0.3, 0, False), (0.3, 90, True), (0.3, -90, True), (0.3, 180, True), (0.6, 0, True), (0.52, 0, False)],
)
def test_a_free_way_keeps_its_distance(wall_m: float, degrees: float, free: bool):
    """0.3 m on, diffbot's front is at 0.5 m: at a wall at 0.52 m it would be nearer than margin and spare allow."""
    wall = World(bounds=BOUNDS, segments=np.array([[wall_m, -3.0, wall_m, 3.0]]))
    assert standing_in(wall, EXACT).could_drive(math.radians(degrees), WAY_M, 0.0) == free


def test_the_corners_of_a_robot_that_is_not_round_need_room_to_turn():
    """Its nose is 0.254 m ahead, its corners 0.333 m away: before a wall at 0.3 m it cannot turn, at 0.6 m it can."""
    for wall_m, free in ((0.3, False), (0.6, True)):
        wall = World(bounds=BOUNDS, segments=np.array([[wall_m, -3.0, wall_m, 3.0]]))
        assert standing_in(wall, JACKAL).could_drive(math.radians(90.0), WAY_M, 0.0) == free


def turns(recovery: Recovery, bearing_rad: float, tries: int) -> list[float]:
    """The yaw rates asked for at the beginnings of so many tries, of a robot that does not move at all."""
    rates, now_s = [], 0.0
    for _ in range(tries):
        while (helped := recovery.twist(bearing_rad, now_s)) is None:
            recovery.watch(now_s)
            now_s += 0.1
            assert now_s < 1e3
        rates.append(helped[1])
        while recovery.twist(bearing_rad, now_s) is not None:
            now_s += 0.1
    return rates


@pytest.mark.parametrize(("bearing_rad", "left"), [(0.4, True), (-0.4, False)])
def test_the_nearest_way_is_tried_first_then_the_others(bearing_rad: float, left: bool):
    """Before a wall the ways to the left and to the right are as free: the waypoint's side comes first."""
    recovery = Recovery(standing_in(WALL_AHEAD, EXACT))
    first, *others = turns(recovery, bearing_rad, MOST_TRIES)
    assert (first > 0.0) == left
    assert any((other > 0.0) != left for other in others)
    now_s = 1e3
    for _ in range(200):  # all tried
        recovery.watch(now_s)
        now_s += 0.1
        assert recovery.twist(bearing_rad, now_s) is None


@pytest.mark.parametrize("change", [lambda r: r.forget(), lambda r: None], ids=["forgotten", "not"])
def test_what_is_forgotten_is_tried_again(change: Callable[[Recovery], None], request: pytest.FixtureRequest):
    recovery = Recovery(standing_in(WALL_AHEAD, EXACT))
    before = turns(recovery, 0.4, 3)
    change(recovery)
    assert (turns(recovery, 0.4, 3) == before) == (request.node.callspec.id == "forgotten")


def test_slow_bases_have_the_time_that_they_need():
    """Half a turn at 0.1 rad/s after 0.7 s of latency, and the way at 0.05 m/s."""
    slow = dataclasses.replace(
        EXACT, max_speed_mps=0.1, max_yaw_rate_radps=0.2, max_yaw_acceleration_radps2=0.1, latency_s=0.7
    )
    recovery, now_s = Recovery(standing_in(WALL_AHEAD, slow)), 0.0
    while recovery.twist(math.pi, now_s) is None:
        recovery.watch(now_s)
        now_s += 0.1
    begun_s = now_s
    while recovery.twist(math.pi, now_s) is not None:
        now_s += 0.1
    assert now_s - begun_s > math.pi / 0.1 + WAY_M / 0.05 + 0.7
