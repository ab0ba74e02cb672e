"""Shortest curves of a car: they lead to the goal, and nothing that a car can drive is shorter."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from adrl import _core
from adrl.geometry import wrapped
from adrl.types import Array
from core import twins
from core.twins import Pose

radii = st.floats(0.2, 3.0)
coordinates = st.one_of(st.floats(-6.0, 6.0), st.integers(-3, 3).map(float))
angles = st.one_of(st.floats(-math.pi, math.pi), st.integers(-2, 2).map(lambda k: 0.5 * k * math.pi))
poses = st.tuples(coordinates, coordinates, angles)
pieces = st.lists(st.tuples(st.floats(-3.0, 3.0), st.sampled_from([-1, 0, 1])), min_size=1, max_size=6)
ORIGIN = (0.0, 0.0, 0.0)


def driven(start: Pose, curve: Array, radius_m: float) -> Pose:
    """Where pieces (K, 2), length and turn, lead to."""
    pose = start
    for length, turn in curve:
        pose = twins.integrate(
            pose, 1.0 if length > 0.0 else -1.0, turn * np.sign(length) / radius_m, abs(length)
        )
    return pose


def length_m(start: Pose, goal: Pose, radius_m: float) -> float:
    return float(np.abs(_core.reeds_shepp(start, goal, radius_m)[:, 0]).sum())


@given(poses, poses, radii)
def test_a_curve_leads_to_its_goal(start: Pose, goal: Pose, radius_m: float):
    curve = _core.reeds_shepp(start, goal, radius_m)
    x, y, yaw = driven(start, curve, radius_m)
    assert_allclose((x, y), goal[:2], atol=1e-6)
    assert abs(math.remainder(yaw - goal[2], 2.0 * math.pi)) < 1e-6
    assert len(curve) <= 5


@given(poses, pieces, radii)
def test_no_drive_is_shorter(start: Pose, pieces: list[tuple[float, int]], radius_m: float):
    """Any way of tightest arcs and lines is at least as long as the curve to where it ends."""
    drive = np.array(pieces, dtype=float)
    goal = driven(start, drive, radius_m)
    assert length_m(start, goal, radius_m) <= np.abs(drive[:, 0]).sum() + 1e-6


@given(poses, poses, poses, radii)
def test_lengths_are_a_distance(a: Pose, b: Pose, c: Pose, radius_m: float):
    """The same there and back, and never shorter by a detour; no less than the straight line, and than the turn."""
    there = length_m(a, b, radius_m)
    assert_allclose(length_m(b, a, radius_m), there, atol=1e-6)
    assert there <= length_m(a, c, radius_m) + length_m(c, b, radius_m) + 1e-6
    assert there >= math.dist(a[:2], b[:2]) - 1e-9
    assert there >= radius_m * abs(math.remainder(b[2] - a[2], 2.0 * math.pi)) - 1e-6


@given(poses, radii, st.floats(0.1, 10.0), poses)
def test_mirrored_turned_round_and_scaled(goal: Pose, radius_m: float, scale: float, frame: Pose):
    x, y, yaw = goal
    length = length_m(ORIGIN, goal, radius_m)
    for same in ((x, -y, -yaw), (-x, y, -yaw), (-x, -y, yaw)):
        assert_allclose(length_m(ORIGIN, same, radius_m), length, atol=1e-6)
    larger = length_m(ORIGIN, (scale * x, scale * y, yaw), scale * radius_m)
    assert_allclose(larger, scale * length, rtol=1e-6, atol=1e-6)
    c, s = math.cos(frame[2]), math.sin(frame[2])
    moved = (frame[0] + c * x - s * y, frame[1] + s * x + c * y, float(wrapped(np.array(frame[2] + yaw))))
    assert_allclose(length_m(frame, moved, radius_m), length, atol=1e-6)


ASIDE = math.acos(11.0 / 16.0)
KNOWN = {
    "ahead": ((3.0, 0.0, 0.0), 3.0),
    "behind": ((-3.0, 0.0, 0.0), 3.0),
    "a quarter to the left": ((1.0, 1.0, 0.5 * math.pi), 0.5 * math.pi),
    "a quarter back to the right": ((-1.0, -1.0, 0.5 * math.pi), 0.5 * math.pi),
    "half round": ((0.0, 2.0, math.pi), math.pi),
    "turned round on the spot, in three arcs": ((0.0, 0.0, math.pi), math.pi),
    # R+ L- R- L+ of arcs a, b, b, a: sideways by 1 and nowhere else, so that cos b = 11/16 and 2 sin a = sin(a + b).
    "one radius aside": ((0.0, 1.0, 0.0), 2.0 * (ASIDE + math.atan2(math.sin(ASIDE), 2.0 - 11.0 / 16.0))),
}


@pytest.mark.parametrize("name", KNOWN)
def test_known_lengths(name: str):
    goal, expected = KNOWN[name]
    assert_allclose(length_m(ORIGIN, goal, 1.0), expected, atol=1e-6)
