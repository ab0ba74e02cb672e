"""Poses in the plane, and the frames that they are given in (REP 105)."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Pose = tuple[float, float, float]
"""x (m), y (m), yaw (rad)."""


def compose(a: Sequence[float], b: Sequence[float]) -> Pose:
    """The pose b, given in the frame of a, in the frame that a is given in."""
    c, s = math.cos(a[2]), math.sin(a[2])
    x, y = a[0] + c * b[0] - s * b[1], a[1] + s * b[0] + c * b[1]
    return x, y, math.remainder(a[2] + b[2], 2.0 * math.pi)


def inverse(a: Sequence[float]) -> Pose:
    """compose(a, inverse(a)) is the origin."""
    c, s = math.cos(a[2]), math.sin(a[2])
    return -c * a[0] - s * a[1], s * a[0] - c * a[1], -a[2]


def part_way(a: Sequence[float], b: Sequence[float], share: float) -> Pose:
    """The pose at this share of the way from a to b, turning the shorter way round."""
    turn = math.remainder(b[2] - a[2], 2.0 * math.pi)
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * turn


def quaternion_of(yaw: float) -> tuple[float, float, float, float]:
    """x, y, z, w."""
    return 0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)


def yaw_of(q: Any) -> float:
    """Of a quaternion with w, x, y, z, as ROS has it; NaN where it is none: all zeros, as of who leaves it out."""
    if not 0.5 < q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z < 2.0:
        return math.nan
    return math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))


def in_robot_frame(pose: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 3) poses, (N, 2) points in the world -> (N, 2) as the robots see them: x ahead, y to the left."""
    offset = points - pose[:, :2]
    cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    return np.stack(
        [cos * offset[:, 0] + sin * offset[:, 1], cos * offset[:, 1] - sin * offset[:, 0]], axis=1
    )
