"""The LiDAR in BatchSim: even beams give the bytes of any beams; noise and dropouts keep their law."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from adrl import _core
from adrl.types import Array, LidarConfig, World
from core import twins
from core.arenas import BOUNDS, poses, worlds
from core.fleet import EMPTY, WALLED, Fleet, a_robot, a_task
from core.twins import Pose

RANGE_M = 6.0


def scan(world: World, pose: Pose, lidar: LidarConfig, steps: int = 0) -> Array:
    """(K,) what a robot that stands reads."""
    fleet = Fleet([a_task(world, start=pose)], a_robot(lidar=lidar)).reset()
    for _ in range(steps):
        fleet.step((0.0, 0.0))
    return fleet.b["ranges"][0]


def general(world: World, pose: Pose, lidar: LidarConfig, time_s: float = 0.0) -> Array:
    """(K,) of the kernel for any angles, from the mount's pose."""
    mount = twins.placed(pose, (lidar.mount_x_m, lidar.mount_y_m))
    sensor = np.array([[*mount, pose[2] + lidar.mount_yaw_rad]])
    return _core.raycast(world.native, sensor, lidar.angles_rad, lidar.max_range_m, time_s)[0]


def assert_equal_bytes(one: Array, other: Array) -> None:
    assert one.dtype == other.dtype == np.float32
    # A sensor on a wall may read 0 or -0.
    assert_array_equal((one + 0.0).view(np.uint32), (other + 0.0).view(np.uint32))


@settings(max_examples=100)
@given(worlds(), poses, st.one_of(st.integers(1, 40), st.just(2048)), st.floats(0.01, 2.0 * math.pi))
def test_even_beams_give_the_bytes_of_any_beams(world: World, pose: Pose, beams: int, fov_rad: float):
    for fov in (fov_rad, 2.0 * math.pi):
        lidar = LidarConfig(num_beams=beams, fov_rad=fov, max_range_m=RANGE_M)
        assert_equal_bytes(scan(world, pose, lidar), general(world, pose, lidar))


@settings(max_examples=70)
@given(worlds(), poses, st.integers(2, 40), st.floats(-20.0, 20.0), st.floats(-0.3, 0.3))
def test_even_beams_from_any_first_angle(
    world: World, pose: Pose, beams: int, first: float, increment: float
):
    """As drivers give them: from 0 to 2 pi, clockwise, all in one direction, or more than a turn."""
    robot = _core.Robot(
        0.2, np.empty((0, 2)), (1.0, 0.0, 1.0), beams, first, increment, (0.0, 0.0, 0.0), RANGE_M, 0.1
    )
    fleet = Fleet([a_task(world, start=pose)], a_robot(beams=beams))
    sim = _core.BatchSim(1, 1, [(robot, _core.SimConfig())], fleet.b)
    sim.set_task(0, a_task(world, start=pose).native)
    sim.reset(np.ones(1, dtype=np.uint8))
    angles = first + increment * np.arange(beams, dtype=np.float64)
    assert_equal_bytes(
        fleet.b["ranges"][0], _core.raycast(world.native, np.array([pose]), angles, RANGE_M)[0]
    )


@settings(max_examples=40)
@given(worlds(), poses, st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-4.0, 4.0), st.floats(0.5, 6.0))
def test_the_mount_is_a_pose_on_the_robot(
    world: World, pose: Pose, x: float, y: float, yaw: float, range_m: float
):
    lidar = LidarConfig(
        num_beams=24, fov_rad=2.5, mount_x_m=x, mount_y_m=y, mount_yaw_rad=yaw, max_range_m=range_m
    )
    assert_equal_bytes(scan(world, pose, lidar), general(world, pose, lidar))


def test_moving_discs_are_seen_where_they_are_now():
    world = replace(EMPTY, discs=np.array([[3.0, 0.0, 5.0, 0.0, 0.5, 0.4, 0.0, math.inf]]))
    lidar = LidarConfig(num_beams=1, max_range_m=RANGE_M)
    assert_allclose(scan(world, (0.0, 0.0, 0.0), lidar, steps=10), 2.5 + 0.4, rtol=1e-6)
    assert_equal_bytes(scan(world, (0.0, 0.0, 0.0), lidar, steps=0), general(world, (0.0, 0.0, 0.0), lidar))


def test_one_beam_looks_straight_ahead_and_a_fan_is_centred():
    world = World(bounds=BOUNDS, segments=np.array([[2.0, -9.0, 2.0, 9.0]]))
    here = (0.0, 0.0, 0.0)
    assert_allclose(scan(world, here, LidarConfig(num_beams=1, fov_rad=1.0)), [2.0])
    fan = scan(world, here, LidarConfig(num_beams=3, fov_rad=2.0 * math.pi / 3))
    assert_allclose(fan, [4.0, 2.0, 4.0], rtol=1e-6)
    circle = scan(world, here, LidarConfig(num_beams=4, fov_rad=2.0 * math.pi))
    assert_allclose(circle, [6.0, 6.0, 2.0, 6.0], rtol=1e-6)


# --- noise --------------------------------------------------------------------------------------

N, K, STEPS = 60, 180, 12


def noisy(**p: Any) -> tuple[Array, Array]:
    """(STEPS, N, K) readings of robots that stand in a closed room, and the (K,) exact ones."""
    lidar = LidarConfig(num_beams=K, max_range_m=RANGE_M)
    room = replace(WALLED, discs=np.empty((0, 8)))
    fleet = Fleet([a_task(room)] * N, a_robot(lidar=lidar), **p).reset()
    rows = []
    for _ in range(STEPS):
        rows.append(fleet.b["ranges"].astype(np.float64))
        fleet.step((0.0, 0.0))
    return np.array(rows), general(room, (0.0, 0.0, 0.0), lidar).astype(np.float64)


@pytest.mark.parametrize("std_m", [0.005, 0.03])
def test_range_noise_has_mean_zero_and_its_standard_deviation(std_m: float):
    readings, exact = noisy(range_noise=std_m)
    error = readings - exact
    assert exact.max() < RANGE_M - 4.0 * std_m
    assert_allclose(error.mean(), 0.0, atol=4.0 * std_m / math.sqrt(error.size))
    assert_allclose(error.std(), std_m, rtol=0.01)
    assert np.abs(error).max() <= 3.47 * std_m
    # Symmetric, and near the normal's share within one standard deviation.
    assert_allclose((np.abs(error) < std_m).mean(), 0.6827, atol=0.02)
    assert_allclose((error > 0.0).mean(), 0.5, atol=0.01)


def test_noise_is_drawn_anew_for_every_beam_robot_and_step():
    readings, exact = noisy(range_noise=0.02)
    error = (readings - exact) / 0.02
    for lagged in ((error[1:], error[:-1]), (error[:, 1:], error[:, :-1]), (error[..., 1:], error[..., :-1])):
        correlation = np.mean(lagged[0] * lagged[1])
        assert abs(correlation) < 4.0 / math.sqrt(lagged[0].size)
    assert len(np.unique(readings.reshape(-1, K), axis=0)) == STEPS * N


def test_dropouts_come_at_their_rate_and_read_the_greatest_range():
    for chance in (0.01, 0.3):
        readings, exact = noisy(dropout=chance)
        dropped = readings == RANGE_M
        spread = math.sqrt(chance * (1.0 - chance) / readings.size)
        assert_allclose(dropped.mean(), chance, atol=4.0 * spread)
        assert_array_equal(readings[~dropped], np.broadcast_to(exact, readings.shape)[~dropped])


def test_dropouts_tell_nothing_about_the_noise():
    readings, exact = noisy(range_noise=0.02, dropout=0.5)
    error = (readings - exact)[readings < RANGE_M]
    assert_allclose(error.mean(), 0.0, atol=4.0 * 0.02 / math.sqrt(error.size))
    assert_allclose(error.std(), 0.02, rtol=0.02)


def test_the_seed_is_the_noise():
    lidar = LidarConfig(num_beams=K, max_range_m=RANGE_M)
    fleet = Fleet([a_task(WALLED)] * 3, a_robot(lidar=lidar), range_noise=0.02)
    fleet.b["seed"][:] = (5, 5, 6)
    for _ in range(3):
        one, same, other = fleet.reset().step((0.0, 0.0)).b["ranges"]
        assert_equal_bytes(one, same)
        assert (one != other).mean() > 0.9


def test_noise_never_leaves_the_sensors_range():
    """Nothing there reads the greatest range exactly; a wall just before it is cut off."""
    far = replace(EMPTY, segments=np.array([[5.99, -9.0, 5.99, 9.0], [-0.01, -9.0, -0.01, 9.0]]))
    lidar = LidarConfig(num_beams=4, max_range_m=RANGE_M)
    robot = a_robot(lidar=lidar, radius_m=0.01)
    fleet = Fleet([a_task(far)] * 200, robot, range_noise=0.05).reset()
    behind, right, ahead, left = fleet.b["ranges"].T
    assert behind.min() == 0.0
    assert_array_equal(right, RANGE_M)
    assert_array_equal(left, RANGE_M)
    assert ahead.max() == RANGE_M
    assert 0.3 < (ahead < RANGE_M).mean() < 0.9
