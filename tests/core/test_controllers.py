"""Laws of every local controller, and the numpy twin of MPPI."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from adrl import _core
from adrl.planning.local_control import CONTROLLERS, LocalControl
from adrl.types import Array, RobotConfig, World
from core.arenas import mirrored, worlds
from core.fleet import EMPTY, Fleet, a_task
from core.routes import ROBOTS, a_fleet, drive, routes
from core.twins import Pose

each_controller = pytest.mark.parametrize("kind", sorted(CONTROLLERS))


def led_by(fleet: Fleet, kind: str | Any, robot: RobotConfig, *, foresee: bool = True) -> Fleet:
    """The same fleet with another controller: a kind, or constants of one."""
    config = CONTROLLERS[kind](robot) if isinstance(kind, str) else kind
    n = len(fleet.b["active"])
    fleet.control = LocalControl(n, robot, config, foresee=foresee, num_threads=fleet.sim.num_threads)
    return fleet


# --- of all ---------------------------------------------------------------------------------------


@each_controller
@settings(max_examples=30, deadline=None)
@given(
    world=worlds(),
    name=st.sampled_from(sorted(ROBOTS)),
    twist=st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)),
    goal=st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0)),
)
def test_commands_lie_within_the_limits(
    kind: str, world: World, name: str, twist: Pose, goal: tuple[float, float]
):
    robot = ROBOTS[name]
    least = np.array([robot.min_speed_mps, -robot.max_yaw_rate_radps])
    most = np.array([robot.max_speed_mps, robot.max_yaw_rate_radps])
    fleet = led_by(a_fleet([a_task(world, goal=goal)], robot).reset(), kind, robot)
    fleet.b["twist"][0] = least + (np.array(twist) + 1.0) / 2.0 * (most - least)
    command = fleet.plan()[0]
    assert np.all(command >= least)
    assert np.all(command <= most)


@each_controller
@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_along_a_route_goals_are_reached_and_little_is_hit(kind: str, name: str):
    robot = ROBOTS[name]
    fleet = led_by(a_fleet(routes(robot, 20, seed=11), robot).reset(), kind, robot)
    reached, hit = drive(fleet, 900)
    assert hit.sum() <= 1
    assert reached.mean() >= 0.9


@each_controller
def test_in_the_open_a_robot_drives_straight_at_full_speed(kind: str):
    robot = ROBOTS["diffbot"]
    fleet = led_by(a_fleet([a_task(EMPTY)], robot).reset(), kind, robot)
    for _ in range(30):
        fleet.step(fleet.plan())
    assert_allclose(
        fleet.b["twist"][0], [0.6, 0.0], atol=0.06
    )  # MPPI's mean of clipped noise is below the limit
    assert_allclose(fleet.b["pose"][0, 1:], 0.0, atol=0.05)


@each_controller
def test_a_batch_does_what_each_robot_does_alone_whatever_the_threads(kind: str):
    robot = ROBOTS["rectangle both ways"]
    tasks = routes(robot, 6, seed=12, discs=2)
    courses = []
    for threads in (1, 3):
        fleet = Fleet(tasks, robot, num_threads=threads, acceleration=3.0, yaw_acceleration=6.0)
        led_by(fleet.reset(), kind, robot)
        courses.append(np.stack([fleet.step(fleet.plan()).b["pose"].copy() for _ in range(12)]))
    alone = []
    for task in tasks:
        fleet = Fleet([task], robot, acceleration=3.0, yaw_acceleration=6.0)
        led_by(fleet.reset(), kind, robot)
        alone.append(np.stack([fleet.step(fleet.plan()).b["pose"].copy() for _ in range(12)]))
    assert_array_equal(courses[0], courses[1])
    assert_array_equal(courses[0], np.concatenate(alone, axis=1))


@each_controller
def test_mirrored_world_mirrored_command(kind: str):
    """MPPI's noise is symmetric; its sums are rounded in another order."""
    robot = ROBOTS["rectangle both ways"]
    flip = np.array([1.0, -1.0])
    for task in routes(robot, 6, seed=6):
        x, y, yaw = task.start
        there = replace(
            task,
            world=mirrored(task.world),
            start=(x, -y, -yaw),
            goal=(task.goal[0], -task.goal[1]),
            path=np.ascontiguousarray(task.path * flip),
        )
        commands = [led_by(a_fleet([t], robot).reset(), kind, robot).plan() for t in (task, there)]
        assert_allclose(commands[1], commands[0] * flip, atol=2e-3 if kind == "mppi" else 1e-5)


@each_controller
def test_what_is_not_foreseen_is_taken_to_stand_still(kind: str):
    """A disc that will cross the way counts where it is: as one that never moves."""
    robot = ROBOTS["diffbot"]
    moving = np.array([[0.6, -0.8, 0.6, 0.8, 0.3, 1.0, 0.0, math.inf]])
    still = moving.copy()
    still[0, 5] = 0.0
    plans = {}
    for name, discs, foresee in (("foreseen", moving, True), ("not", moving, False), ("still", still, True)):
        task = a_task(World(bounds=EMPTY.bounds, discs=discs))
        fleet = led_by(a_fleet([task], robot).reset(), kind, robot, foresee=foresee)
        fleet.b["twist"][0, 0] = 0.5
        plans[name] = fleet.plan()
    # MPPI looks up what stands still on a lattice, and reckons with what moves.
    assert_allclose(plans["not"], plans["still"], atol=0.02 if kind == "mppi" else 0.0)
    assert np.abs(plans["foreseen"] - plans["not"]).max() > 0.03


# --- recovery -------------------------------------------------------------------------------------


@each_controller
@pytest.mark.parametrize("name", ["diffbot", "rectangle both ways"])
def test_a_robot_that_is_stuck_moves(kind: str, name: str):
    """At a wall that the path leads through: where no place has more room, turning is better than to stand."""
    robot = ROBOTS[name]
    world = World(bounds=EMPTY.bounds, segments=np.array([[1.0, -3.0, 1.0, 3.0]]))
    fleet = led_by(a_fleet([a_task(world, goal=(3.0, 0.0))], robot).reset(), kind, robot)
    poses = np.array([fleet.step(fleet.plan()).b["pose"][0].copy() for _ in range(160)])
    assert not fleet.b["collided"].any()
    stuck = poses[60:]
    assert np.ptp(stuck[:, 0]) + np.ptp(stuck[:, 1]) + np.ptp(stuck[:, 2]) > 0.25


# --- pure pursuit ---------------------------------------------------------------------------------


@given(st.floats(-3.1, 3.1), st.floats(0.0, 0.6))
def test_on_a_straight_line_pursuit_has_no_curvature(yaw: float, speed: float):
    robot = ROBOTS["diffbot"]
    path = np.array([[0.0, 0.0], [8.0 * math.cos(yaw), 8.0 * math.sin(yaw)]])
    task = a_task(EMPTY, start=(0.0, 0.0, yaw), goal=tuple(path[1]), path=path)
    fleet = led_by(a_fleet([task], robot).reset(), "pursuit", robot)
    fleet.b["twist"][0, 0] = speed
    command = fleet.plan()[0]
    assert command[0] > 0.0
    assert abs(command[1]) < 1e-9


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_pursuit_turns_in_place_towards_a_path_behind(side: float):
    robot = ROBOTS["diffbot"]
    path = np.array([[0.0, 0.0], [-3.0, 0.5 * side]])
    task = a_task(EMPTY, goal=tuple(path[1]), path=path)
    command = led_by(a_fleet([task], robot).reset(), "pursuit", robot).plan()[0]
    assert command[0] == 0.0
    assert command[1] * side > 0.5


# --- MPPI -----------------------------------------------------------------------------------------


def small(**values: float) -> _core.MppiConfig:
    config = _core.MppiConfig()
    for name, value in values.items():
        setattr(config, name, value)
    return config


def test_one_sample_is_that_sample():
    """Mean and noise of the first step, brought inside the limits; the mean of the next is its second step."""
    robot = ROBOTS["diffbot"]
    config = small(batch_size=1, time_steps=5)
    noise = _core.mppi_noise(config)[:, :, 0].astype(np.float64)
    std = np.array([config.vx_std * robot.max_speed_mps, config.wz_std * robot.max_yaw_rate_radps])
    low = np.array([robot.min_speed_mps, -robot.max_yaw_rate_radps])
    high = np.array([robot.max_speed_mps, robot.max_yaw_rate_radps])
    fleet = led_by(a_fleet([a_task(EMPTY)], robot).reset(), config, robot)
    mean = np.zeros((5, 2))
    for _ in range(3):
        sample = np.clip(mean + noise * std, low, high)
        assert_allclose(fleet.plan()[0], sample[0], atol=1e-6)
        mean = np.concatenate([sample[1:], sample[-1:]])


def test_noise_is_symmetric_and_as_wide_and_correlated_as_told():
    noise = _core.mppi_noise(small(batch_size=1000, time_steps=20, noise_correlation=0.6))
    assert_array_equal(noise[:, 0, ::2], noise[:, 0, 1::2])
    assert_array_equal(noise[:, 1, ::2], -noise[:, 1, 1::2])
    assert_allclose(noise.std(axis=2), 1.0, atol=0.12)
    assert_allclose(np.mean(noise[1:] * noise[:-1]), 0.6, atol=0.05)


def twin(
    robot: RobotConfig, config: _core.MppiConfig, path: Array, twist: Array, mean: Array, circle: Array | None
) -> tuple[Array, Array]:
    """MPPI of a disc at the origin, heading along x: the command, and the next mean (T, 2). Far from the goal."""
    steps, count, dt = config.time_steps, config.batch_size, robot.control_period_s
    noise = np.moveaxis(_core.mppi_noise(config).astype(np.float64), 2, 0)  # (B, T, 2)
    std = np.array([config.vx_std * robot.max_speed_mps, config.wz_std * robot.max_yaw_rate_radps])
    low = np.array([robot.min_speed_mps, -robot.max_yaw_rate_radps])
    high = np.array([robot.max_speed_mps, robot.max_yaw_rate_radps])
    change = np.array([robot.max_acceleration_mps2, robot.max_yaw_acceleration_radps2]) * dt
    response = -math.expm1(-dt / robot.lag_s) if robot.lag_s > 0.0 else 1.0
    controls = np.clip(mean + noise * std, low, high)
    far = robot.max_speed_mps * steps * dt
    spacing = (far + config.path_follow_offset_m) / 63
    along = np.arange(64) * spacing
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    points = np.column_stack([np.interp(along, lengths, path[:, k]) for k in (0, 1)])
    cost, ends, alive = np.zeros(count), np.zeros((count, 3)), np.ones(count, bool)
    for i in range(count):
        (v, w), x, y, yaw, travelled = twist, 0.0, 0.0, 0.0, 0.0
        for t in range(steps):
            was = np.array([v, w])
            v, w = was + np.clip(response * (controls[i, t] - was), -change, change)
            chord, turn = 0.5 * (was[0] + v) * dt, 0.5 * (was[1] + w) * dt
            x += chord * np.sinc(turn / 2.0 / np.pi) * math.cos(yaw + turn / 2.0)
            y += chord * np.sinc(turn / 2.0 / np.pi) * math.sin(yaw + turn / 2.0)
            yaw, travelled = yaw + turn, travelled + abs(chord)
            cost[i] += config.gamma * np.sum(mean[t] / std**2 * (controls[i, t] - mean[t]))
            cost[i] += 0.5 * config.prefer_forward_weight * (abs(chord) - chord)
            if circle is not None and alive[i]:
                clear = math.hypot(x - circle[0], y - circle[1]) - circle[2] - robot.circumscribed_radius_m
                cost[i] += config.repulsion_weight / steps * max(0.0, 1.0 - clear / config.inflation_m)
                if clear < config.collision_margin_m:
                    cost[i] += config.collision_cost * (1.0 + (steps - t) / steps)
                    alive[i] = False
            if t % 4 == 3:
                k = min(63, int(travelled / spacing))
                away = math.hypot(x - points[k, 0], y - points[k, 1])
                cost[i] += 4.0 / steps * config.path_align_weight * away
        ends[i] = x, y, yaw
    nearest = np.hypot(*(ends[:, None, :2] - points).transpose(2, 0, 1)).argmin(axis=1)
    target = points[min(63, max(nearest[alive], default=0) + round(config.path_follow_offset_m / spacing))]
    offset = target - ends[:, :2]
    distance = np.hypot(*offset.T)
    cost += config.path_follow_weight * distance
    if abs(math.atan2(target[1], target[0])) > config.max_angle_to_furthest:
        ahead = (np.cos(ends[:, 2]) * offset[:, 0] + np.sin(ends[:, 2]) * offset[:, 1]) / distance
        cost += config.path_angle_weight * (1.0 - ahead)
    weights = np.exp((cost.min() - cost) / config.temperature)
    new = np.tensordot(weights / weights.sum(), controls, 1)
    return new[0], np.concatenate([new[1:], new[-1:]])


@pytest.mark.parametrize("circle", [None, (0.9, 0.25, 0.2)])
@pytest.mark.parametrize("end", [(6.0, 0.0), (4.0, 3.0), (-2.0, 4.0)])
def test_mppi_is_its_numpy_twin(end: tuple[float, float], circle: tuple[float, float, float] | None):
    """In single precision; with an obstacle, to what the lattice of distances is off by."""
    robot = ROBOTS["diffbot"]
    config = small(batch_size=40, time_steps=8, noise_correlation=0.5)
    obstacle = None if circle is None else np.array(circle)
    path = np.array([[0.0, 0.0], [0.5 * end[0], 0.2 * end[1]], end])
    world = World(bounds=EMPTY.bounds, circles=np.empty((0, 3)) if circle is None else np.array([circle]))
    fleet = led_by(a_fleet([a_task(world, goal=end, path=path)], robot).reset(), config, robot)
    fleet.b["twist"][0] = twist = np.array([0.3, -0.2])
    mean = np.zeros((8, 2))
    for _ in range(3):
        expected, mean = twin(robot, config, path, twist, mean, obstacle)
        assert_allclose(fleet.plan()[0], expected, atol=1e-5 if circle is None else 3e-2)


@pytest.mark.parametrize(
    ("kind", "name", "value"),
    [
        ("mppi", "batch_size", 0),
        ("mppi", "time_steps", 65),
        ("mppi", "temperature", 0.0),
        ("mppi", "collision_margin_m", 0.0),
        ("mppi", "noise_correlation", 1.1),
        ("dwa", "lookahead_m", 0.0),
        ("dwa", "horizon_s", 0.0),
        ("dwa", "horizon_s", math.inf),
        ("dwa", "comfort_m", 0.0),
        ("dwa", "comfort_m", math.nan),
        ("dwa", "margin_m", -0.01),
        ("pursuit", "cost_scaling_dist", 0.0),
        ("pursuit", "min_lookahead_dist", 0.0),
        ("pursuit", "max_lookahead_dist", 0.1),
        ("pursuit", "margin_m", -0.01),
    ],
)
def test_constants_that_mean_nothing_are_refused(kind: str, name: str, value: float):
    robot = ROBOTS["diffbot"]
    config = CONTROLLERS[kind](robot)
    setattr(config, name, value)
    with pytest.raises(ValueError, match=f"{kind}: .*{name}"):
        LocalControl(1, robot, config)


@pytest.mark.parametrize("steps", [1, 8, 64])
def test_mppi_remembers_two_numbers_a_step_beside_what_every_controller_does(steps: int):
    own = _core.control_memory(small(time_steps=steps)) - _core.control_memory(_core.DwaConfig())
    assert own == 2 * steps
    assert _core.control_memory(_core.PursuitConfig()) == _core.control_memory(_core.DwaConfig())
