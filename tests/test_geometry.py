"""Poses in the plane: frames there and back, and the yaw of quaternions."""

import math
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl.geometry import Pose, compose, inverse, part_way, yaw_of

POSES = st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-math.pi, math.pi))


@given(a=POSES, b=POSES)
def test_there_and_back_is_the_same_pose(a: Pose, b: Pose) -> None:
    again = compose(inverse(a), compose(a, b))
    assert math.dist(again[:2], b[:2]) < 1e-9
    assert abs(math.remainder(again[2] - b[2], 2.0 * math.pi)) < 1e-9


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
