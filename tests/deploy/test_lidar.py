"""Any LiDAR reads as the trained one: by ray casts of both in the same world."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl import _core
from adrl.deploy import Pose, Scan
from adrl.deploy.lidar import LidarAdapter, beam_angles, beam_towards, readings, sees_all_round
from adrl.types import Array, LidarConfig
from env_tasks import room

TRAINED = LidarConfig(num_beams=180, noise_std_m=0.0)
PILLARS = room(6.0, circles=[(1.5, 0.5, 0.3), (-1.0, 1.2, 0.2), (0.3, -1.8, 0.4)])


def cast(angles: Array, sensor: Pose = (0.0, 0.0, 0.0), reach_m: float = 6.0) -> Array:
    """(K,) ranges of beams from a sensor's pose."""
    return _core.raycast(PILLARS.native, np.array([sensor], dtype=np.float64), angles, reach_m)[0].astype(
        np.float64
    )


def a_scan(
    ranges: Array, angle_min: float, increment: float, reach_m: float = 6.0, least_m: float = 0.0
) -> Scan:
    return Scan(
        ranges=ranges,
        angle_min_rad=angle_min,
        angle_increment_rad=increment,
        range_min_m=least_m,
        range_max_m=reach_m,
        stamp_s=0.0,
    )


def scan_of(
    count: int, *, fov_rad: float = 2.0 * math.pi, clockwise: bool = False, sensor: Pose = (0, 0, 0)
) -> Scan:
    """A scan of another LiDAR at a pose on the robot, which stands at the origin."""
    whole = fov_rad > 2.0 * math.pi - 1e-9
    increment = fov_rad / (count if whole else count - 1)
    first = -0.5 * fov_rad
    if clockwise:
        first, increment = -first, -increment
    return a_scan(cast(first + increment * np.arange(count, dtype=np.float64), sensor), first, increment)


def agreeing(ours: Array, truth: Array, tolerance_m: float) -> float:
    """Share of the beams that agree; at the rims of pillars a beam may fall on either side."""
    return float(np.mean(np.abs(ours - truth) < tolerance_m))


def test_its_own_lidar_reads_the_same():
    """To the last bit that training sees, noise and all."""
    rng = np.random.default_rng(0)
    for lidar in (
        TRAINED,
        LidarConfig(num_beams=720, fov_rad=1.5 * math.pi, max_range_m=30.0, mount_x_m=0.12),
    ):
        ranges = rng.uniform(0.05, lidar.max_range_m, lidar.num_beams).astype(np.float32)
        ranges[::7] = lidar.max_range_m
        scan = a_scan(
            ranges.astype(np.float64), lidar.angle_min_rad, lidar.angle_increment_rad, lidar.max_range_m
        )
        np.testing.assert_allclose(LidarAdapter(lidar)(scan), ranges, atol=1e-6)


@pytest.mark.parametrize("clockwise", [False, True])
@pytest.mark.parametrize("count", [120, 181, 360, 721, 1440])
def test_more_beams_fewer_beams_either_way_round(count: int, clockwise: bool):
    truth = cast(TRAINED.angles_rad)
    ours = LidarAdapter(TRAINED)(scan_of(count, clockwise=clockwise)).astype(np.float64)
    assert agreeing(ours, truth, 0.03 if count > 130 else 0.06) > 0.9


def test_a_post_between_two_trained_beams_is_not_lost():
    scan = scan_of(1440)
    at = int(np.argmin(np.abs(scan.angle_min_rad + scan.angle_increment_rad * np.arange(1440) - 0.015)))
    ranges = scan.ranges.copy()
    ranges[at] = 0.7
    ours = LidarAdapter(TRAINED)(dataclasses.replace(scan, ranges=ranges))
    assert ours.min() == pytest.approx(0.7)


@given(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(-math.pi, math.pi))
def test_another_mount(x_m: float, y_m: float, yaw: float):
    """The LiDAR sits elsewhere on the robot: what it sees is what the trained one would, but for what is hidden."""
    truth = cast(TRAINED.angles_rad)
    ours = LidarAdapter(TRAINED, (x_m, y_m, yaw))(scan_of(720, sensor=(x_m, y_m, yaw)))
    assert agreeing(ours.astype(np.float64), truth, 0.05) > 0.85


def test_what_it_does_not_see_reads_free():
    ours = LidarAdapter(TRAINED)(scan_of(181, fov_rad=math.pi))
    behind = np.abs(TRAINED.angles_rad) > 0.5 * math.pi + 0.12
    assert (ours[behind] == TRAINED.max_range_m).all()
    ahead = np.abs(TRAINED.angles_rad) < 0.5 * math.pi
    assert agreeing(ours[ahead].astype(np.float64), cast(TRAINED.angles_rad)[ahead], 0.03) > 0.9


def test_a_lidar_of_shorter_or_longer_reach():
    short = a_scan(cast(TRAINED.angles_rad, reach_m=2.0), -math.pi, TRAINED.angle_increment_rad, reach_m=2.0)
    ours = LidarAdapter(TRAINED)(short)
    truth = cast(TRAINED.angles_rad)
    assert (ours[truth > 2.1] == TRAINED.max_range_m).all()
    np.testing.assert_allclose(ours[truth < 1.9], truth[truth < 1.9], atol=1e-5)
    far = a_scan(np.full(180, 25.0), -math.pi, TRAINED.angle_increment_rad, reach_m=30.0)
    assert (LidarAdapter(TRAINED)(far) == TRAINED.max_range_m).all()


def test_beams_that_tell_nothing_are_filled_from_their_neighbours():
    scan = scan_of(180)
    holes = scan.ranges.copy()
    holes[::3] = np.nan
    holes[1::30] = 0.0
    holes[2::30] = -1.0
    ours = LidarAdapter(TRAINED)(dataclasses.replace(scan, ranges=holes)).astype(np.float64)
    assert np.isfinite(ours).all()
    assert agreeing(ours, scan.ranges, 0.06) > 0.85


def test_what_the_readings_mean():
    scan = a_scan(np.array([np.inf, np.nan, -np.inf, 0.0, 0.05, 0.5, 6.0, 9.0, -3.0]), 0.0, 0.1, least_m=0.1)
    ranges, told = readings(scan)
    assert told.tolist() == [True, False, True, False, False, True, True, True, False]
    assert ranges[told].tolist() == [np.inf, 0.1, 0.5, np.inf, np.inf]


@given(
    count=st.integers(2, 400),
    share=st.floats(0.05, 1.0),
    first=st.floats(-7.0, 7.0),
    clockwise=st.booleans(),
    turns=st.integers(-2, 2),
)
def test_a_beam_looks_where_it_looks(count: int, share: float, first: float, clockwise: bool, turns: int):
    """Whatever the direction is called; and where there is none, none does."""
    increment = (-1.0 if clockwise else 1.0) * share * 2.0 * math.pi / count
    scan = a_scan(np.ones(count), first, increment)
    bearings = beam_angles(scan) + 0.4 * increment + 2.0 * math.pi * turns
    assert beam_towards(scan, bearings).tolist() == list(range(count))
    behind = first + 0.5 * increment * (count - 1) + math.pi
    if not sees_all_round(scan) and share * (count - 1) / count < 0.9:
        assert beam_towards(scan, np.array([behind]))[0] == -1


def test_no_beam_tells_anything():
    ours = LidarAdapter(TRAINED)(a_scan(np.full(90, np.nan), -math.pi, 2.0 * math.pi / 90))
    assert (ours == TRAINED.max_range_m).all()
