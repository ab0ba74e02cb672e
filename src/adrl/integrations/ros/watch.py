"""What a robot's topics tell whoever looks at it: the newest of each, as it is to be drawn. Sends nothing."""

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl.deploy import Odometry, Pose
from adrl.deploy.lidar import LidarAdapter
from adrl.deploy.localisation import Localisation
from adrl.geometry import in_world_frame
from adrl.integrations.ros.display import KINDS, MAP, MARKERS, displays
from adrl.integrations.ros.messages import odometry_of, pose_of, scan_of
from adrl.types import Array, RobotConfig

SENSORS = ("scan", "odom")
SILENT_S = 1.0
"""A sensor that has said nothing for so long is silent."""
HERE: Pose = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Sight:
    """What is known now. All places are in the odometry's frame."""

    odometry: Odometry | None = None
    """The newest."""
    since_s: float = 0.0
    """Its stamp's distance from the first one's."""
    ranges: NDArray[np.float32] = field(default_factory=lambda: np.empty(0, np.float32))
    """(K,) metres, of the robot's own beams."""
    goal: tuple[float, float] | None = None
    waypoint: tuple[float, float] | None = None
    plan: Array = field(default_factory=lambda: np.empty((0, 2)))
    """(P, 2) metres."""
    status: dict[str, str] | None = None
    """Key -> value of adrl/status, and "message"; None before the first."""
    silent: dict[str, float] = field(default_factory=dict)
    """Sensor's topic -> seconds for which nothing has come."""


class Watch:
    """Takes messages on one thread, tells what is known on another."""

    def __init__(
        self,
        robot: RobotConfig,
        seconds: Callable[[Any], float],
        wall_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """robot: the one that is watched. seconds: of a stamp."""
        self._robot, self._seconds, self._wall_s = robot, seconds, wall_s
        self._lock = threading.Lock()
        self._came_s = dict.fromkeys(SENSORS, wall_s())
        self.beginnings = 0
        """Counts up when all begins anew: the robot's clock went back."""
        self._forget()

    def _forget(self) -> None:
        self._adapter = LidarAdapter(self._robot.lidar)
        self._localisation = Localisation()
        self._odom_frame = ""
        self._began_s = math.nan
        self._sight = Sight()
        self._map: tuple[NDArray[np.int8], float, Pose] | None = None
        self._plan: tuple[str, Array] = ("", np.empty((0, 2)))
        self._waypoint: tuple[str, Array] | None = None

    def subscriptions(self) -> dict[str, tuple[str, Callable[[Any], None]]]:
        """Topic -> kind of message, and what takes it."""
        topics = {
            "odom": ("nav_msgs/msg/Odometry", self._take_odometry),
            "scan": ("sensor_msgs/msg/LaserScan", self._take_scan),
            "amcl_pose": ("geometry_msgs/msg/PoseWithCovarianceStamped", self._take_pose),
            "plan": ("nav_msgs/msg/Path", self._take_plan),
            "adrl/status": ("diagnostic_msgs/msg/DiagnosticArray", self._take_status),
            MARKERS: (KINDS[MARKERS], self._take_markers),
            MAP: (KINDS[MAP], self._take_map),
        }
        known = displays()
        return {
            topic: (kind, self._locked(take))
            for topic, (kind, take) in topics.items()
            if topic not in KINDS or topic in known
        }

    def _locked(self, take: Callable[[Any], None]) -> Callable[[Any], None]:
        def taken(message: Any) -> None:
            with self._lock:
                take(message)

        return taken

    def now(self) -> Sight:
        """What is known."""
        with self._lock:
            wall_s = self._wall_s()
            silent = {
                topic: wall_s - came_s for topic, came_s in self._came_s.items() if wall_s > came_s + SILENT_S
            }
            waypoint = None if self._waypoint is None else self._here(*self._waypoint)
            return replace(
                self._sight,
                plan=self._here(*self._plan),
                waypoint=None if waypoint is None or not len(waypoint) else tuple(waypoint[0].tolist()),
                goal=self._goal(),
                silent=silent,
            )

    def map(self) -> tuple[NDArray[np.int8], float, Pose] | None:
        """The robot's own map: (H, W), above 0 solid, below free; metres a cell; where its lower left corner is."""
        with self._lock:
            return self._map

    def _here(self, frame: str, points: Array) -> Array:
        """(P, 2) of a frame, in the odometry's; none where nobody tells where that frame is."""
        if frame == self._odom_frame or not len(points):
            return points
        if not self._localisation.known:
            return np.empty((0, 2))
        return in_world_frame(np.array(self._localisation.to_odom(HERE)), points)

    def _goal(self) -> tuple[float, float] | None:
        said = self._sight.status or {}
        if not said.get("goal"):
            return None
        there = self._here(said.get("goal_frame", ""), np.array([said["goal"].split()], dtype=np.float64))
        return tuple(there[0].tolist()) if len(there) else None

    # --- topics -------------------------------------------------------------------------------------------------

    def _take_odometry(self, message: Any) -> None:
        odometry = odometry_of(message, self._seconds(message.header.stamp))
        if not all(map(math.isfinite, (*odometry.pose, *odometry.twist))):
            return
        before = self._sight.odometry
        if before is not None and odometry.stamp_s < before.stamp_s - SILENT_S:
            self._forget()
            self.beginnings += 1
        self._came_s["odom"] = self._wall_s()
        self._odom_frame = message.header.frame_id
        self._localisation.take_odometry(odometry)
        if math.isnan(self._began_s):
            self._began_s = odometry.stamp_s
        self._sight = replace(self._sight, odometry=odometry, since_s=odometry.stamp_s - self._began_s)

    def _take_scan(self, message: Any) -> None:
        self._came_s["scan"] = self._wall_s()
        if len(message.ranges) < 2 or message.angle_increment == 0.0:
            return
        ranges = self._adapter(scan_of(message, self._seconds(message.header.stamp)))
        self._sight = replace(self._sight, ranges=ranges)

    def _take_pose(self, message: Any) -> None:
        self._localisation.take_pose(pose_of(message.pose.pose), self._seconds(message.header.stamp))

    def _take_plan(self, message: Any) -> None:
        points = [(each.pose.position.x, each.pose.position.y) for each in message.poses]
        self._plan = message.header.frame_id, np.array(points, dtype=np.float64).reshape(-1, 2)

    def _take_markers(self, message: Any) -> None:
        found = [marker for marker in message.markers if marker.ns == "waypoint"]
        self._waypoint = None
        if found:
            at = found[0].pose.position
            self._waypoint = found[0].header.frame_id, np.array([[at.x, at.y]])

    def _take_map(self, message: Any) -> None:
        info = message.info
        cells = np.asarray(message.data, dtype=np.int8).reshape(info.height, info.width)
        solid = np.where(cells > 0, 1, np.where(cells == 0, -1, 0)).astype(np.int8)
        self._map = solid, info.resolution, pose_of(info.origin)

    def _take_status(self, message: Any) -> None:
        for status in message.status:
            said = {value.key: value.value for value in status.values}
            if "reasons" in said:
                self._sight = replace(self._sight, status=said | {"message": status.message})
