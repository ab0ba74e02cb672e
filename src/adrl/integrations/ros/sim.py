"""The simulated robot's node of either generation, but for the middleware."""

import time
from collections.abc import Callable, Mapping
from typing import Any

from adrl.integrations.ros.config import SimConfig
from adrl.integrations.ros.messages import odometry_message, pose_message, scan_message
from adrl.integrations.ros.outbox import Publish
from adrl.integrations.ros.robot import SimulatedRobot

NAME = "adrl_sim"
"""Of the node."""
PATIENCE_S = 0.02
"""With speed 0 the simulator waits so long for a command."""
LATCHED = ("amcl_pose", "collisions")
"""Topics whose last message is for whoever comes late."""


def publications() -> dict[str, Any]:
    """Topic -> message class."""
    from geometry_msgs.msg import PoseWithCovarianceStamped  # pyright: ignore[reportMissingImports]
    from nav_msgs.msg import Odometry  # pyright: ignore[reportMissingImports]
    from rosgraph_msgs.msg import Clock  # pyright: ignore[reportMissingImports]
    from sensor_msgs.msg import LaserScan  # pyright: ignore[reportMissingImports]
    from std_msgs.msg import UInt32  # pyright: ignore[reportMissingImports]

    return {
        "/clock": Clock,
        "odom": Odometry,
        "amcl_pose": PoseWithCovarianceStamped,
        "scan": LaserScan,
        "collisions": UInt32,
    }


def subscription(config: SimConfig) -> Any:
    """Message class of cmd_vel."""
    from geometry_msgs.msg import Twist, TwistStamped  # pyright: ignore[reportMissingImports]

    return TwistStamped if config.stamped else Twist


class SimTopics:
    """A robot that publishes each period and goes on to the next. One call at a time."""

    def __init__(
        self, config: SimConfig, publish: Mapping[str, Publish], header: Callable[[float, str], Any]
    ) -> None:
        """publish: of the publications. header: of a stamp and a frame. Raises AdrlError."""
        self._config = config
        self._publish = publish
        self._header = header
        self._kinds = publications()
        self._robot = SimulatedRobot.of(config)
        self._free = config.speed == 0.0
        self._advanced_s = time.monotonic()
        self._count()

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
        robot, config, publish = self._robot, self._config, self._publish
        collisions = robot.collisions
        robot.advance()
        self._advanced_s = time.monotonic()
        if robot.collisions != collisions:
            self._count()
        in_odom = self._header(robot.time_s, config.odom_frame)
        on_base = self._header(robot.time_s, config.base_frame)
        publish["/clock"](self._kinds["/clock"](clock=in_odom.stamp))
        publish["odom"](odometry_message(robot.odometry, config.base_frame, in_odom))
        if config.localised:
            publish["amcl_pose"](pose_message(robot.pose, self._header(robot.time_s, config.map_frame)))
        publish["scan"](scan_message(robot.robot.lidar, robot.ranges, robot.robot.control_period_s, on_base))

    def _count(self) -> None:
        self._publish["collisions"](self._kinds["collisions"](data=self._robot.collisions))
