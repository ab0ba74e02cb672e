"""Where the odometry's frame lies on the map, with poses that come late and clocks that jump."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl.deploy import Odometry, Pose
from adrl.deploy.localisation import Localisation
from adrl.geometry import compose

POSES = st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-math.pi, math.pi))


@given(frame=POSES, late=st.integers(0, 20))
def test_a_pose_that_comes_late_tells_of_then(frame: Pose, late: int) -> None:
    """A robot drives a circle; localisation reports where it was some periods ago."""
    place = Localisation()
    track: list[Pose] = [(math.cos(0.05 * k), math.sin(0.05 * k), 0.05 * k) for k in range(40)]
    for k, pose in enumerate(track):
        place.take_odometry(Odometry(pose=pose, twist=(0.5, 0.5), stamp_s=0.1 * k))
    then = 39 - late
    assert place.take_pose(compose(frame, track[then]), 0.1 * then)
    assert math.dist(place.to_map(track[-1])[:2], compose(frame, track[-1])[:2]) < 1e-6
    assert math.dist(place.to_odom(place.to_map(track[5]))[:2], track[5][:2]) < 1e-6


def test_a_pose_without_odometry_or_sense_is_of_no_use() -> None:
    place = Localisation()
    assert not place.take_pose((1.0, 2.0, 0.0), 0.0)
    place.take_odometry(Odometry(pose=(0.0, 0.0, 0.0), twist=(0.0, 0.0), stamp_s=0.0))
    assert not place.take_pose((math.nan, 2.0, 0.0), 0.0)
    assert not place.known


def standing_at(x_m: float, stamp_s: float) -> Odometry:
    return Odometry(pose=(x_m, 0.0, 0.0), twist=(0.0, 0.0), stamp_s=stamp_s)


@pytest.mark.parametrize("jump_s", [-100.0, 3.0, 100.0])
def test_a_clock_that_jumps_leaves_the_place_right(jump_s: float) -> None:
    """The odometry's frame is the map's; the robot drives at 1 m/s, and messages of either clock come in any order."""
    place = Localisation()
    for k in range(50):
        place.take_odometry(standing_at(0.1 * k, 200.0 + 0.1 * k))
    assert place.take_pose((4.9, 0.0, 0.0), 204.9)
    # The new clock's pose comes before its odometry; the old clock's after.
    place.take_pose((5.0, 0.0, 0.0), 205.0 + jump_s)
    place.take_odometry(standing_at(5.0, 205.0 + jump_s))
    assert place.to_map((5.0, 0.0, 0.0)) == pytest.approx((5.0, 0.0, 0.0), abs=0.11)
    place.take_pose((4.9, 0.0, 0.0), 204.9)
    assert place.to_map((5.0, 0.0, 0.0)) == pytest.approx((5.0, 0.0, 0.0), abs=0.11)


@pytest.mark.parametrize("jumps_s", [(-100.0,), (-3.0,), (3.0,), (100.0, -100.0)])
def test_odometry_is_followed_through_jumps_of_its_clock(jumps_s: tuple[float, ...]) -> None:
    place, shift_s = Localisation(), 0.0
    for jump_s in (0.0, *jumps_s):
        shift_s += jump_s
        for k in range(50):
            odometry = standing_at(0.1 * k, 200.0 + shift_s + 0.1 * k)
            place.take_odometry(odometry)
            assert place.newest == odometry


def test_the_first_pose_may_be_of_long_before_the_odometry() -> None:
    """Localisation tells of it again when the robot has moved, and the driver has only just come up."""
    place = Localisation()
    place.take_odometry(standing_at(1.0, 500.0))
    assert place.take_pose((3.0, 0.0, 0.0), 20.0)
    assert place.to_map((1.0, 0.0, 0.0)) == pytest.approx((3.0, 0.0, 0.0))
