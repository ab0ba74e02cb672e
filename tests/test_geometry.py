"""Poses in the plane: frames there and back, and the yaw of quaternions."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl.geometry import (
    Pose,
    compose,
    composed,
    in_robot_frame,
    in_world_frame,
    inverse,
    lies_within,
    nearest_on_segments,
    part_way,
    relative,
    yaw_of,
)

POSES = st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-math.pi, math.pi))


@given(a=POSES, b=POSES)
def test_there_and_back_is_the_same_pose(a: Pose, b: Pose) -> None:
    again = compose(inverse(a), compose(a, b))
    assert math.dist(again[:2], b[:2]) < 1e-9
    assert abs(math.remainder(again[2] - b[2], 2.0 * math.pi)) < 1e-9


@given(a=POSES, b=POSES)
def test_arrays_of_poses_are_as_single_ones(a: Pose, b: Pose) -> None:
    first, second = np.array([a, b]), np.array([b, a])
    for (x, y, yaw), wanted in zip(composed(first, second), (compose(a, b), compose(b, a)), strict=True):
        assert math.dist((x, y), wanted[:2]) < 1e-9
        assert abs(math.remainder(yaw - wanted[2], 2.0 * math.pi)) < 1e-9
    again = composed(first, relative(first, second))
    assert np.abs(again[:, :2] - second[:, :2]).max() < 1e-9
    assert np.abs(np.sin(0.5 * (again[:, 2] - second[:, 2]))).max() < 1e-9
    there = in_world_frame(np.array(a), second[:, :2])  # one pose, many points
    assert np.abs(in_robot_frame(np.array(a), there) - second[:, :2]).max() < 1e-9


PLACES = st.tuples(st.floats(-50, 50), st.floats(-50, 50))


@given(start=PLACES, end=PLACES, point=PLACES, share=st.floats(0, 1))
def test_no_point_of_a_segment_is_nearer_than_the_nearest(
    start: tuple[float, float], end: tuple[float, float], point: tuple[float, float], share: float
) -> None:
    a, b = np.array(start), np.array(end)
    found = nearest_on_segments(a, b, np.array(point))
    assert math.dist(found, point) <= math.dist(a + share * (b - a), point) + 1e-5
    assert math.dist(a, found) + math.dist(found, b) == pytest.approx(math.dist(a, b), abs=1e-9)
    rows = nearest_on_segments(np.array([a, b]), np.array([b, a]), np.array(point))
    assert np.abs(rows - found).max() < 1e-5


@given(
    angles=st.lists(st.floats(0, 6.28), min_size=3, max_size=12, unique_by=lambda angle: round(angle, 3)),
    shares=st.lists(st.floats(0.01, 1), min_size=12, max_size=12),
)
def test_a_mean_of_all_corners_lies_within_and_a_corner_or_what_is_beyond_does_not(
    angles: list[float], shares: list[float]
) -> None:
    corners = np.array([(math.cos(angle), math.sin(angle)) for angle in sorted(angles)])
    weights = np.array(shares[: len(corners)]) / sum(shares[: len(corners)])
    middle = weights @ corners
    width = np.linalg.svd(corners - corners.mean(axis=0))[1].min()
    assert lies_within(corners, middle[None, :])[0] or width < 1e-3
    assert not lies_within(corners, corners).any()
    assert not lies_within(corners, middle + 2.1 * np.array([[1.0, 0.0], [0.0, -1.0]])).any()


@given(
    a=POSES,
    place=st.tuples(st.floats(-50, 50), st.floats(-50, 50)),
    turn=st.floats(-3.1, 3.1),
    frame=POSES,
    share=st.floats(0, 1),
)
def test_part_of_the_way_is_the_same_in_every_frame(
    a: Pose, place: tuple[float, float], turn: float, frame: Pose, share: float
) -> None:
    b = (*place, a[2] + turn)
    moved = part_way(compose(frame, a), compose(frame, b), share)
    wanted = compose(frame, part_way(a, b, share))
    assert math.dist(moved[:2], wanted[:2]) < 1e-9
    assert abs(math.remainder(moved[2] - wanted[2], 2.0 * math.pi)) < 1e-9
    assert part_way(a, b, 0.0) == pytest.approx(a)
    assert part_way(a, b, 1.0) == pytest.approx(b)


@given(yaw=st.floats(-math.pi, math.pi), sign=st.sampled_from([-1.0, 1.0]))
def test_a_quaternion_and_its_negative_are_the_same_yaw(yaw: float, sign: float) -> None:
    q = SimpleNamespace(w=sign * math.cos(0.5 * yaw), x=0.0, y=0.0, z=sign * math.sin(0.5 * yaw))
    assert abs(math.remainder(yaw_of(q) - yaw, 2.0 * math.pi)) < 1e-9


@pytest.mark.parametrize("numbers", [(0, 0, 0, 0), (2, 0, 0, 0), (math.nan, 0, 0, 1)])
def test_what_is_no_rotation_has_no_yaw(numbers: tuple[float, ...]) -> None:
    assert math.isnan(yaw_of(SimpleNamespace(**dict(zip("wxyz", numbers, strict=True)))))
