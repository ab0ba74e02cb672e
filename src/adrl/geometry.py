"""Poses in the plane, and the frames that they are given in (REP 105)."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
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


def wrapped(angles: Array) -> Array:
    """The same angles in [-pi, pi)."""
    return np.remainder(angles + math.pi, 2.0 * math.pi) - math.pi


def in_robot_frame(poses: Array, points: Array) -> Array:
    """(..., 3) poses, (..., 2) points in the world -> (..., 2) as robots there see them: x ahead, y to the left."""
    cos, sin = np.cos(poses[..., 2]), np.sin(poses[..., 2])
    dx, dy = points[..., 0] - poses[..., 0], points[..., 1] - poses[..., 1]
    return np.stack([cos * dx + sin * dy, cos * dy - sin * dx], axis=-1)


def in_world_frame(poses: Array, points: Array) -> Array:
    """The inverse of in_robot_frame."""
    cos, sin = np.cos(poses[..., 2]), np.sin(poses[..., 2])
    x, y = points[..., 0], points[..., 1]
    return np.stack([poses[..., 0] + cos * x - sin * y, poses[..., 1] + sin * x + cos * y], axis=-1)


def relative(a: Array, b: Array) -> Array:
    """(..., 3) poses b in the frames of poses a."""
    return np.concatenate([in_robot_frame(a, b[..., :2]), wrapped(b[..., 2:] - a[..., 2:])], axis=-1)


def composed(a: Array, b: Array) -> Array:
    """(..., 3) poses b, given in the frames of poses a, in the frame that these are given in."""
    return np.concatenate([in_world_frame(a, b[..., :2]), wrapped(a[..., 2:] + b[..., 2:])], axis=-1)


def nearest_on_segments(start: Array, end: Array, points: Array) -> Array:
    """(..., 2) the point of each segment from start to end that is nearest to points (..., 2)."""
    way = end - start
    share = ((points - start) * way).sum(axis=-1) / np.maximum((way * way).sum(axis=-1), 1e-12)
    return start + np.clip(share, 0.0, 1.0)[..., None] * way


def lies_within(corners: Array, points: Array) -> NDArray[np.bool_]:
    """(V, 2) a convex polygon, counter-clockwise; (..., 2) points -> (...) which lie in it, its edge left out."""
    within = np.ones(points.shape[:-1], dtype=np.bool_)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge, offset = end - start, points - start
        within &= edge[0] * offset[..., 1] > edge[1] * offset[..., 0]
    return within


TILT_RAD = 0.05
"""A LiDAR that is tilted by more sees the floor and no plane."""


def level_mount(place: Array, axes: Array) -> tuple[Pose, bool]:
    """Where a LiDAR sits on a robot, and whether upside down: it then turns the other way round.

    place: (3,) in the robot's frame. axes: (3, 3), its x, y and z axis as columns. Raises ValueError, whose text goes
    on from the LiDAR's name, for one that does not scan the plane.
    """
    tilt = math.acos(min(1.0, abs(axes[2, 2])))
    if not tilt <= TILT_RAD:
        raise ValueError(
            f"is tilted by {math.degrees(tilt):.1f} degrees; only one that scans level, or upside down, can be used"
        )
    return (float(place[0]), float(place[1]), math.atan2(axes[1, 0], axes[0, 0])), bool(axes[2, 2] < 0.0)
