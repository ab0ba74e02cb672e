"""The simulated robot's node of either generation, but for the middleware."""

import logging
import time
from collections.abc import Callable, Mapping
from typing import Any

from adrl.bags.messages import New, laser_scan, odometry, pose_with_covariance, transform_stamped
from adrl.geometry import compose, inverse
from adrl.integrations.ros.config import SimConfig
from adrl.integrations.ros.messages import new_message
from adrl.integrations.ros.outbox import Publish
from adrl.integrations.ros.robot import SimulatedRobot
from adrl.integrations.ros.transforms import TF

LOG = logging.getLogger("adrl.sim")

NAME = "adrl_sim"
"""Of the node."""
PATIENCE_S = 0.02
"""With speed 0 the simulator waits so long for a command."""
LATCHED = ("amcl_pose", "collisions", "/tf_static")
"""Topics whose last message is for whoever comes late."""


PUBLICATIONS = {
    "/clock": "rosgraph_msgs/msg/Clock",
    "odom": "nav_msgs/msg/Odometry",
    "amcl_pose": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "scan": "sensor_msgs/msg/LaserScan",
    "collisions": "std_msgs/msg/UInt32",
}
"""Topic -> kind of message."""
TRANSFORMS = dict.fromkeys(TF, "tf2_msgs/msg/TFMessage")
"""The same, of transforms, where they are wanted."""


def publications(config: SimConfig) -> dict[str, str]:
    """Topic -> kind of message."""
    return PUBLICATIONS | (TRANSFORMS if config.tf else {})


def subscription(config: SimConfig) -> str:
    """Kind of cmd_vel."""
    return "geometry_msgs/msg/TwistStamped" if config.stamped else "geometry_msgs/msg/Twist"


class SimTopics:
    """A robot that publishes each period and goes on to the next. One call at a time."""

    def __init__(
        self,
        config: SimConfig,
        robot: SimulatedRobot,
        publish: Mapping[str, Publish],
        header: Callable[[float, str], Any],
        new: New = new_message,
    ) -> None:
        """robot: of the config. publish: of the publications. header: of a stamp and a frame. new: makes messages."""
        self._config = config
        self._publish = publish
        self._header = header
        self._new = new
        self._robot = robot
        self._free = config.speed == 0.0
        self._advanced_s = time.monotonic()
        self._mount_told = False
        self._count()
        x, y, yaw = robot.pose
        names = [
            *(name for name in publications(config) if name != "amcl_pose" or config.localised),
            "cmd_vel",
        ]
        LOG.info(
            "robot %s at (%.2f, %.2f, %.2f) in %s; topics %s (in)",
            *(robot.robot.name, x, y, yaw, config.map_frame, ", ".join(names)),
        )

    @property
    def tick_s(self) -> float:
        """Seconds of real time between two calls of tick()."""
        return 0.5 * PATIENCE_S if self._free else self._robot.robot.control_period_s / self._config.speed

    def take_command(self, message: Any) -> None:
        """Do as told; with speed 0 the next period begins."""
        twist = message.twist if self._config.stamped else message
        self._robot.command((twist.linear.x, twist.angular.z))
        if self._free:
            self._advance()

    def tick(self) -> None:
        """The next period; with speed 0 only when no command has come for long."""
        if not self._free or time.monotonic() - self._advanced_s >= PATIENCE_S:
            self._advance()

    def _advance(self) -> None:
        robot, config, publish, new = self._robot, self._config, self._publish, self._new
        collisions = robot.collisions
        robot.advance()
        self._advanced_s = time.monotonic()
        if robot.collisions != collisions:
            self._count()
        in_odom, on_map, in_scan = (
            self._header(robot.time_s, frame)
            for frame in (config.odom_frame, config.map_frame, config.scan_frame)
        )
        told = robot.odometry
        publish["/clock"](new(PUBLICATIONS["/clock"], clock=in_odom.stamp))
        publish["odom"](odometry(new, in_odom, config.base_frame, told.pose, told.twist))
        if config.localised:
            at = pose_with_covariance(new, robot.pose)
            publish["amcl_pose"](new(PUBLICATIONS["amcl_pose"], header=on_map, pose=at))
        if config.tf:
            self._tell_frames(in_odom, on_map)
        lidar, period_s = robot.robot.lidar, robot.robot.control_period_s
        publish["scan"](laser_scan(new, in_scan, lidar, robot.ranges, period_s))

    def _tell_frames(self, in_odom: Any, on_map: Any) -> None:
        """map -> odom -> base; and once the LiDAR on it."""
        robot, config, new = self._robot, self._config, self._new
        told = robot.odometry.pose
        links = [
            transform_stamped(new, in_odom, config.base_frame, told),
            transform_stamped(new, on_map, config.odom_frame, compose(robot.pose, inverse(told))),
        ]
        self._publish["/tf"](new(TRANSFORMS["/tf"], transforms=links))
        if not self._mount_told:
            self._mount_told = True
            at = self._header(robot.time_s, config.base_frame)
            mount = transform_stamped(new, at, config.scan_frame, robot.robot.lidar.mount)
            self._publish["/tf_static"](new(TRANSFORMS["/tf_static"], transforms=[mount]))

    def _count(self) -> None:
        self._publish["collisions"](self._new(PUBLICATIONS["collisions"], data=self._robot.collisions))
