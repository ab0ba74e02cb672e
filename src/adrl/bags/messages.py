"""Standard ROS messages, for bags and for topics. Frames as in REP 103 and 105, free beams as in REP 117."""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from adrl.geometry import quaternion_of
from adrl.types import Array, LidarConfig


class New(Protocol):
    """Makes messages: rosbags' or those of a generation of ROS."""

    def __call__(self, kind: str, /, **fields: Any) -> Any:
        """kind: such as "geometry_msgs/msg/Pose"; all of its fields; arrays of numbers are numpy's."""
        ...


def laser_scan(
    new: New, header: Any, lidar: LidarConfig, ranges: NDArray[np.floating], period_s: float
) -> Any:
    """(K,) ranges in metres; where nothing is within reach, max_range_m or more."""
    free = ranges >= np.float32(lidar.max_range_m)
    return new(
        "sensor_msgs/msg/LaserScan",
        header=header,
        angle_min=lidar.angle_min_rad,
        angle_max=float(lidar.angles_rad[-1]),
        angle_increment=lidar.angle_increment_rad,
        time_increment=0.0,
        scan_time=period_s,
        range_min=0.0,
        range_max=lidar.max_range_m,
        ranges=np.where(free, np.inf, ranges).astype(np.float32),
        intensities=np.empty(0, np.float32),
    )


def odometry(new: New, header: Any, base: str, at: Sequence[float], speeds: Sequence[float]) -> Any:
    """Pose in the header's frame; speed (m/s) and yaw rate (rad/s) in that of the base."""
    return new(
        "nav_msgs/msg/Odometry",
        header=header,
        child_frame_id=base,
        pose=pose_with_covariance(new, at),
        twist=new("geometry_msgs/msg/TwistWithCovariance", twist=twist(new, speeds), covariance=np.zeros(36)),
    )


def path(new: New, header: Any, points: Array) -> Any:
    """Through (P, 2) points; each looks at the next, the last where the one before does."""
    ahead = np.diff(points, axis=0)
    yaws = np.arctan2(ahead[:, 1], ahead[:, 0])
    yaws = np.append(yaws, yaws[-1:] if len(yaws) else np.zeros(len(points)))
    poses = [pose_stamped(new, header, (x, y, yaw)) for (x, y), yaw in zip(points, yaws, strict=True)]
    return new("nav_msgs/msg/Path", header=header, poses=poses)


def twist(new: New, speeds: Sequence[float]) -> Any:
    """Speed (m/s) and yaw rate (rad/s)."""
    linear, angular = (speeds[0], 0.0, 0.0), (0.0, 0.0, speeds[1])
    return new("geometry_msgs/msg/Twist", linear=_vector(new, linear), angular=_vector(new, angular))


def pose(new: New, at: Sequence[float]) -> Any:
    """x, y (m), yaw (rad)."""
    x, y, yaw = at
    point = new("geometry_msgs/msg/Point", x=float(x), y=float(y), z=0.0)
    return new("geometry_msgs/msg/Pose", position=point, orientation=_quaternion(new, yaw))


def pose_stamped(new: New, header: Any, at: Sequence[float]) -> Any:
    """A pose in the header's frame."""
    return new("geometry_msgs/msg/PoseStamped", header=header, pose=pose(new, at))


def pose_with_covariance(new: New, at: Sequence[float]) -> Any:
    """The covariance is not known: zeros."""
    return new("geometry_msgs/msg/PoseWithCovariance", pose=pose(new, at), covariance=np.zeros(36))


def transform_stamped(new: New, header: Any, child: str, at: Sequence[float]) -> Any:
    """The frame `child` as a pose in the header's."""
    x, y, yaw = at
    transform = new(
        "geometry_msgs/msg/Transform",
        translation=_vector(new, (x, y, 0.0)),
        rotation=_quaternion(new, yaw),
    )
    return new("geometry_msgs/msg/TransformStamped", header=header, child_frame_id=child, transform=transform)


def _vector(new: New, values: Sequence[float]) -> Any:
    x, y, z = map(float, values)
    return new("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


def _quaternion(new: New, yaw: float) -> Any:
    x, y, z, w = quaternion_of(yaw)
    return new("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
