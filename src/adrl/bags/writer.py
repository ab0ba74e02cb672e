"""Writes what a robot saw, was told and did as ROS messages."""

import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from adrl.bags import messages
from adrl.errors import ConfigError, MissingExtra
from adrl.geometry import compose, inverse
from adrl.outputs import require_folder
from adrl.types import Array, RobotConfig

TOPICS = {
    "/scan": "sensor_msgs/msg/LaserScan",
    "/odom": "nav_msgs/msg/Odometry",
    "/cmd_vel": "geometry_msgs/msg/Twist",
    "/goal_pose": "geometry_msgs/msg/PoseStamped",
    "/plan": "nav_msgs/msg/Path",
    "/tf": "tf2_msgs/msg/TFMessage",
}
"""What is written, and as what."""
MAP, ODOM, BASE, LASER = "map", "odom", "base_link", "base_scan"
"""Frames: the world, the robot's own reckoning, the robot, its LiDAR."""


def require_new_bag(option: str, path: str | os.PathLike[str]) -> None:
    """Before the work starts: a bag can be made at path. Raises ConfigError, and MissingExtra without rosbags."""
    path = Path(path)
    try:
        import rosbags  # noqa: F401  # pyright: ignore[reportUnusedImport]
    except ImportError:
        raise MissingExtra.named("bags", "writing bags") from None
    if path.suffix in (".mcap", ".db3"):
        raise ConfigError(
            f"{option} {path}: a bag of ROS 2 is a folder; give {path.with_suffix('')}, or a file .bag for ROS 1"
        )
    if path.exists():
        raise ConfigError(f"{option} {path} exists already; give another place or delete it")
    require_folder(option, path.parent)


class BagWriter:
    """A new bag: a file of ROS 1 where the name ends in .bag, else a folder of ROS 2 with MCAP in it.

    Use it with `with`: the bag is there, whole, when that ends without an error. Times are seconds, 0 or more.
    """

    def __init__(self, path: str | os.PathLike[str], robot: RobotConfig) -> None:
        """robot: whose LiDAR takes the scans. Raises ConfigError for a path that exists, MissingExtra."""
        require_new_bag("bag", path)
        self.path = path = Path(path)
        self._robot = robot
        self._ros1 = path.suffix == ".bag"
        # rosbags names the file in a folder by the folder's name: what is temporary is the one above.
        self._temporary = path.absolute().parent / f".{path.name[:200]}.{uuid4().hex}.tmp"
        self._store = _typestore(ros1=self._ros1)
        self._lines: dict[str, Any] = {}

    def __enter__(self) -> Self:
        self._temporary.mkdir(parents=True)
        try:
            self._writer = _writer(self._temporary / self.path.name, ros1=self._ros1)
            self._writer.open()
        except BaseException:
            shutil.rmtree(self._temporary, ignore_errors=True)
            raise
        return self

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        try:
            self._writer.close()
            if kind is None:
                os.replace(self._temporary / self.path.name, self.path)
        finally:
            shutil.rmtree(self._temporary, ignore_errors=True)

    def scan(self, time_s: float, ranges: NDArray[np.floating]) -> None:
        """(K,) ranges in metres; where nothing is within reach, max_range_m or more."""
        header, robot = self._header(time_s, LASER), self._robot
        scan = messages.laser_scan(self._new, header, robot.lidar, ranges, robot.control_period_s)
        self._write("/scan", time_s, scan)

    def odometry(self, time_s: float, pose: Sequence[float], twist: Sequence[float]) -> None:
        """Pose in the frame odom; speed (m/s) and yaw rate (rad/s) in base_link."""
        self._write(
            "/odom", time_s, messages.odometry(self._new, self._header(time_s, ODOM), BASE, pose, twist)
        )

    def command(self, time_s: float, twist: Sequence[float]) -> None:
        """Speed (m/s) and yaw rate (rad/s) that the base is told."""
        self._write("/cmd_vel", time_s, messages.twist(self._new, twist))

    def goal(self, time_s: float, goal: Sequence[float], frame: str) -> None:
        """A goal (x, y) in metres, without a heading."""
        header = self._header(time_s, frame)
        self._write("/goal_pose", time_s, messages.pose_stamped(self._new, header, (*goal, 0.0)))

    def plan(self, time_s: float, path: Array, frame: str) -> None:
        """(P, 2) the way to the goal."""
        self._write("/plan", time_s, messages.path(self._new, self._header(time_s, frame), path))

    def transforms(self, time_s: float, pose: Sequence[float], odometry: Sequence[float]) -> None:
        """Where the robot is in the world, and by its own reckoning; and where on it the LiDAR is."""
        lidar = self._robot.lidar
        links = [
            (MAP, ODOM, compose(pose, inverse(odometry))),
            (ODOM, BASE, odometry),
            (BASE, LASER, lidar.mount),
        ]
        transforms = [
            messages.transform_stamped(self._new, self._header(time_s, parent), child, at)
            for parent, child, at in links
        ]
        self._write("/tf", time_s, self._new("tf2_msgs/msg/TFMessage", transforms=transforms))

    def _new(self, kind: str, /, **fields: Any) -> Any:
        return self._store.types[kind](**fields)

    def _header(self, time_s: float, frame: str) -> Any:
        seconds, nanoseconds = divmod(_nanoseconds(time_s), 10**9)
        stamp = self._new("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
        number = {"seq": 0} if self._ros1 else {}
        return self._new("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **number)

    def _write(self, topic: str, time_s: float, message: Any) -> None:
        kind = TOPICS[topic]
        if topic not in self._lines:
            self._lines[topic] = self._writer.add_connection(topic, kind, typestore=self._store)
        serialize = self._store.serialize_ros1 if self._ros1 else self._store.serialize_cdr
        self._writer.write(self._lines[topic], _nanoseconds(time_s), serialize(message, kind))


def _typestore(*, ros1: bool) -> Any:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    if not ros1:
        return get_typestore(Stores.ROS2_HUMBLE)
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TOPICS["/tf"]))
    return store


def _writer(path: Path, *, ros1: bool) -> Any:
    if ros1:
        from rosbags.rosbag1 import Writer

        return Writer(path)
    from rosbags.rosbag2 import StoragePlugin, Writer

    # Version 9 lays out quality of service anew; older releases read 8 too.
    return Writer(path, version=8, storage_plugin=StoragePlugin.MCAP)


def _nanoseconds(time_s: float) -> int:
    return round(time_s * 1e9)
