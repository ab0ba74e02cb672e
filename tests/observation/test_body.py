"""What the body is, in the observation: scaled for the family, rising, mirrored as the robot is; metres that are the
same for all."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl.envs import NavSim
from adrl.observation import EncoderConfig, ObservationEncoder
from adrl.observation.body import AROUND, body_numbers, extents_m
from adrl.types import LidarConfig, RobotConfig, Task
from adrl.worlds import FAMILIES, ROBOTS
from env_tasks import quiet, room
from random_robots import robots

ANY = FAMILIES["any"]
WITH_BODY = EncoderConfig(body=True, reach_m=10.0, history_steps=2)


def test_the_family_fills_about_minus_one_to_one() -> None:
    drawn = [body_numbers(ANY.draw("train", number)) for number in range(500)]
    for name in drawn[0]:
        values = [numbers[name] for numbers in drawn]
        assert -1.3 <= min(values) <= max(values) <= 1.3, name
        if name != "mount_cos":  # of which the family has one end alone
            assert max(values) - min(values) > 0.85, name


LIDAR = {"fov_rad", "max_range_m", "mount_x_m", "mount_y_m"}
RISES = {
    "max_speed_mps": ("forward_mps", (0.01, 50.0)),
    "max_yaw_rate_radps": ("yaw_rate_radps", (0.01, 50.0)),
    "max_acceleration_mps2": ("acceleration_mps2", (0.01, 1000.0)),
    "max_yaw_acceleration_radps2": ("yaw_acceleration_radps2", (0.01, 1000.0)),
    "lag_s": ("lag_s", (0.0, 10.0)),
    "latency_s": ("latency_s", (0.0, 4.8)),
    "control_period_s": ("control_period_s", (0.7, 2.0)),
    "min_turning_radius_m": ("turning_radius_m", (0.0, 10.0)),
    "radius_m": ("extent_3", (0.01, 10.0)),
    "fov_rad": ("fov_rad", (0.001, math.tau)),
    "max_range_m": ("range_m", (0.05, 1000.0)),
    "mount_x_m": ("mount_x_m", (-10.0, 10.0)),
    "mount_y_m": ("mount_y_m", (-10.0, 10.0)),
}


@given(st.sampled_from(sorted(RISES)), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_each_number_rises_over_all_of_its_domain_and_stays_finite(
    field: str, one: float, other: float
) -> None:
    name, (low, high) = RISES[field]
    told = []
    for share in sorted((one, other)):
        number = low + share * (high - low)
        changes: dict[str, Any] = {field: number}
        robot = RobotConfig(control_period_s=0.7)
        if field in LIDAR:
            changes = {"lidar": replace(robot.lidar, **changes)}
        told.append(body_numbers(replace(robot, **changes))[name])
    assert np.isfinite(told).all()
    assert told[0] <= told[1]
    if abs(one - other) > 1e-6:
        assert told[0] < told[1]


@given(robots())
def test_any_robot_is_told_in_finite_numbers(robot: RobotConfig) -> None:
    encoder = ObservationEncoder(robot, WITH_BODY)
    numbers = encoder.components["body"].numbers  # pyright: ignore[reportAttributeAccessIssue]
    assert np.isfinite(numbers).all()
    assert encoder.limit >= np.abs(numbers).max()
    stop = body_numbers(replace(robot, max_acceleration_mps2=0.5 * robot.max_acceleration_mps2))
    assert stop["stop_distance_m"] >= body_numbers(robot)["stop_distance_m"]
    assert stop["stop_time_s"] >= body_numbers(robot)["stop_time_s"]


def test_extents_are_of_the_footprint_from_the_origin() -> None:
    corners = ((0.5, 0.2), (-0.1, 0.2), (-0.1, -0.2), (0.5, -0.2))
    cart = RobotConfig(radius_m=None, footprint_m=corners)
    told = dict(zip(np.degrees(AROUND).round().tolist(), extents_m(cart, AROUND).tolist(), strict=True))
    assert (told[0], told[90], told[180], told[-90]) == pytest.approx((0.5, 0.2, 0.1, 0.2))
    assert told[45] == pytest.approx(0.7 / math.sqrt(2.0))
    assert extents_m(ROBOTS["diffbot"], AROUND).tolist() == [0.2] * 8


def mirrored(robot: RobotConfig) -> RobotConfig:
    corners = robot.footprint_m and tuple((x, -y) for x, y in robot.footprint_m)
    lidar = replace(robot.lidar, mount_y_m=-robot.lidar.mount_y_m, mount_yaw_rad=-robot.lidar.mount_yaw_rad)
    return replace(robot, footprint_m=corners, lidar=lidar)


def seen(robot: RobotConfig, task: Task, actions: np.ndarray) -> np.ndarray:
    """(T, D) observations on the way."""
    sim = NavSim(1, robot, guidance="goal", encoder=WITH_BODY)
    sim.reset(np.arange(1), [task], np.zeros(1, np.uint64), np.random.default_rng(0))
    rows = [sim.observe()]
    for action in actions:
        sim.step(action[None])
        rows.append(sim.observe())
    return np.concatenate(rows)


@pytest.mark.parametrize("number", range(12))
def test_the_mirrored_robot_in_the_mirrored_world_sees_the_mirrored_observation(number: int) -> None:
    drawn = quiet(ANY.draw("train", number))
    # An odd number of beams looks straight ahead: none of them lies on the border of two sectors and of an obstacle.
    robot = replace(drawn, odometry_drift=0.0)
    rng = np.random.default_rng(number)
    pillars = np.column_stack([rng.uniform(-5.0, 5.0, (20, 2)), rng.uniform(0.1, 0.4, 20)])
    pillars = pillars[np.hypot(pillars[:, 0], pillars[:, 1]) > 1.8]
    walls = [[-5.0, 1.0, -3.0, 2.0], [2.5, -3.0, 4.0, -1.0]]
    flip = np.array([1.0, -1.0])

    def task(side: float) -> Task:
        world = room(
            segments=(np.array(walls) * [1.0, side, 1.0, side]).tolist(),
            circles=(pillars * [1.0, side, 1.0]).tolist(),
        )
        path = np.array([[0.0, 0.0], [3.0, 1.0 * side]])
        return Task(
            world=world, start=(0.0, 0.0, 0.3 * side), goal=(3.0, 1.0 * side), path=path, shortest_m=3.2,
            time_limit_s=60.0, goal_tolerance_m=0.3,
        )  # fmt: skip

    actions = rng.uniform(-1.0, 1.0, (6, 2)).astype(np.float32)
    one = seen(robot, task(1.0), actions)
    other = seen(mirrored(robot), task(-1.0), actions * flip.astype(np.float32))
    mirror = ObservationEncoder([robot, mirrored(robot)], WITH_BODY).mirror
    assert mirror is not None
    mirror.observation(one)
    np.testing.assert_allclose(other, one, atol=2e-5)
    assert np.abs(one[:, :36]).max() > 0.0


def test_without_a_body_an_observation_is_that_of_before() -> None:
    plain, told = EncoderConfig(), EncoderConfig(body=True)
    for robot in ROBOTS.values():
        rng = np.random.default_rng(1)
        ranges = rng.uniform(0.0, robot.lidar.max_range_m, (3, robot.lidar.num_beams)).astype(np.float32)
        rest = rng.normal(size=(3, 2)), rng.normal(size=(3, 2)), np.zeros((3, 2), np.float32)
        before = ObservationEncoder(robot, plain).encode(ranges, *rest)
        after = ObservationEncoder(robot, told).encode(ranges, *rest)
        assert after[:, : before.shape[1]].tobytes() == before.tobytes()
        assert after.shape[1] - before.shape[1] == len(body_numbers(robot))
    assert plain.fields() == {"num_sectors": 36, "near_m": 0.3, "goal_scale_m": 1.0, "history_steps": 0}
    assert told.fields() == plain.fields() | {"body": True}
    assert EncoderConfig(reach_m=8.0).fields() == plain.fields() | {"reach_m": 8.0}


@given(metres=st.floats(0.0, 40.0))
def test_metres_read_the_same_whatever_the_lidar_reaches(metres: float) -> None:
    config = EncoderConfig(reach_m=10.0)

    def reads(reach_m: float) -> float:
        robot = RobotConfig(lidar=LidarConfig(num_beams=36, max_range_m=reach_m))
        ranges = np.full((1, 36), min(metres, reach_m), np.float32)
        zeros = np.zeros((1, 2))
        return float(
            ObservationEncoder(robot, config).encode(ranges, zeros, zeros, zeros.astype(np.float32))[0, 0]
        )

    free = math.log1p((10.0 - 0.2) / 0.3) / math.log1p(10.0 / 0.3)
    far = math.log1p(max(metres - 0.2, 0.0) / 0.3) / math.log1p(10.0 / 0.3)
    for reach_m in (4.0, 10.0, 30.0):
        out_of_reach = np.float32(metres) >= np.float32(min(reach_m, 10.0))
        assert reads(reach_m) == pytest.approx(free if out_of_reach else far, abs=1e-5)
