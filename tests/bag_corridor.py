"""A ROS 2 bag of a robot that drives along a walled corridor to a goal, in which anything can be changed."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from adrl.bags import messages

STORE = get_typestore(Stores.ROS2_HUMBLE)
KINDS = {
    "/scan": "sensor_msgs/msg/LaserScan",
    "/rear": "sensor_msgs/msg/LaserScan",
    "/odom": "nav_msgs/msg/Odometry",
    "/cmd_vel": "geometry_msgs/msg/Twist",
    "/goal_pose": "geometry_msgs/msg/PoseStamped",
    "/amcl_pose": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
}
BEAMS, REACH_M, YAW, SPEED_MPS, DT_S = 180, 6.0, 2.0, 0.4, 0.1
"""YAW: where the corridor points in the odometry's frame."""
GOAL = (3.0 * math.cos(YAW), 3.0 * math.sin(YAW))
ANGLES = -math.pi + 2.0 * math.pi / BEAMS * np.arange(BEAMS)

Edit = Callable[[float, Any], Any]
"""(seconds, message) -> the message to write instead, or None for none."""


@dataclass(frozen=True, kw_only=True)
class Link:
    """A transform: place (m), roll, pitch, yaw (rad); a function of time for one that moves."""

    parent: str
    child: str
    place: Sequence[float] = (0.0, 0.0, 0.0)
    turn: Sequence[float] = (0.0, 0.0, 0.0)
    at: Callable[[float], tuple[Sequence[float], Sequence[float]]] | None = None

    def message(self, now_s: float) -> Any:
        """As tf has it."""
        place, turn = self.at(now_s) if self.at is not None else (self.place, self.turn)
        x, y, z, w = Rotation.from_euler("xyz", turn).as_quat()
        return new(
            "geometry_msgs/msg/TransformStamped",
            header=header(now_s, self.parent),
            child_frame_id=self.child,
            transform=new(
                "geometry_msgs/msg/Transform",
                translation=new(
                    "geometry_msgs/msg/Vector3", **dict(zip("xyz", map(float, place), strict=True))
                ),
                rotation=new("geometry_msgs/msg/Quaternion", x=float(x), y=float(y), z=float(z), w=float(w)),
            ),
        )


def new(kind: str, /, **fields: Any) -> Any:
    """A message."""
    return STORE.types[kind](**fields)


def header(now_s: float, frame: str) -> Any:
    """Stamped."""
    stamp = new("builtin_interfaces/msg/Time", sec=int(now_s), nanosec=round(now_s % 1.0 * 1e9))
    return new("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def corridor(x: float, angles: np.ndarray) -> np.ndarray:
    """Ranges from (x, 0) in the corridor -2 < x < 9.03, -1 < y < 1.6."""
    c, s = np.cos(angles), np.sin(angles)
    with np.errstate(divide="ignore"):
        ends = np.where(c > 0.0, (9.03 - x) / c, (-2.0 - x) / c)
        ranges = np.minimum(ends, np.where(s > 0.0, 1.6, 1.0) / np.abs(s))
    return np.where(ranges > REACH_M, np.inf, ranges).astype(np.float32)


def corridor_bag(
    path: Path,
    *,
    lidar: Link | None = None,
    seen_at: Callable[[np.ndarray], np.ndarray] = lambda angles: angles,
    links: Sequence[Link] = (),
    goal: tuple[float, float] = GOAL,
    goal_frame: str = "odom",
    edit: dict[str, Edit] | None = None,
    more: Sequence[tuple[str, float, Any]] = (),
    storage: StoragePlugin = StoragePlugin.MCAP,
) -> Path:
    """12 s from 1 s on; it stands, drives 3 m from 2 s to 9.5 s, and stands.

    lidar: on the robot, at its place when None. seen_at: the robot's angle of each of the LiDAR's angles. links: those
    with `at` ten times a second on /tf, others once on /tf_static. edit: by topic. more: (topic, seconds, message).
    """
    edits = edit or {}
    written: dict[str, Any] = {}
    with Writer(path, version=8, storage_plugin=storage) as writer:

        def put(topic: str, now_s: float, message: Any) -> None:
            message = edits.get(topic, lambda _, same: same)(now_s, message)
            if message is None:
                return
            if topic not in written:
                written[topic] = writer.add_connection(topic, KINDS[topic], typestore=STORE)
            writer.write(written[topic], round(now_s * 1e9), STORE.serialize_cdr(message, KINDS[topic]))

        fixed = [
            lidar or Link(parent="base_link", child="laser"),
            *(link for link in links if link.at is None),
        ]
        put(
            "/tf_static", 1.0, new("tf2_msgs/msg/TFMessage", transforms=[link.message(1.0) for link in fixed])
        )
        waiting = sorted(more, key=lambda item: item[1])
        for k in range(120):
            now_s = 1.0 + DT_S * k
            while waiting and waiting[0][1] <= now_s + 1e-9:
                put(*waiting.pop(0))
            v, way = (SPEED_MPS if 10 <= k < 85 else 0.0), SPEED_MPS * DT_S * (min(max(k, 10), 85) - 10)
            at = (way * math.cos(YAW), way * math.sin(YAW), YAW)
            if k == 5:
                put("/goal_pose", now_s, messages.pose_stamped(new, header(now_s, goal_frame), (*goal, 0.0)))
            put("/scan", now_s, scan(now_s, corridor(way, seen_at(ANGLES))))
            put("/odom", now_s, messages.odometry(new, header(now_s, "odom"), "base_link", at, (v, 0.0)))
            moving = [link.message(now_s) for link in links if link.at is not None]
            base = Link(parent="odom", child="base_link", place=(*at[:2], 0.0), turn=(0.0, 0.0, YAW))
            put("/tf", now_s, new("tf2_msgs/msg/TFMessage", transforms=[base.message(now_s), *moving]))
            put("/cmd_vel", now_s, messages.twist(new, (v, 0.0)))
    return path


def scan(now_s: float, ranges: np.ndarray) -> Any:
    """Of frame laser."""
    return new(
        KINDS["/scan"],
        header=header(now_s, "laser"),
        angle_min=-math.pi,
        angle_max=math.pi - 2.0 * math.pi / BEAMS,
        angle_increment=2.0 * math.pi / BEAMS,
        time_increment=0.0,
        scan_time=DT_S,
        range_min=0.0,
        range_max=REACH_M,
        ranges=ranges.astype(np.float32),
        intensities=np.empty(0, np.float32),
    )


def pose_on_map(now_s: float, at: Sequence[float]) -> Any:
    """As AMCL says it."""
    return new(KINDS["/amcl_pose"], header=header(now_s, "map"), pose=messages.pose_with_covariance(new, at))
