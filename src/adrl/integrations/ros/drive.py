"""The driving node of either generation, but for the middleware: which topics, and what happens on them."""

import contextlib
from collections.abc import Callable, Mapping
from typing import Any

from adrl.bags.messages import New
from adrl.deploy.driver import Report
from adrl.errors import GoalRefused
from adrl.integrations.ros.config import DriveConfig
from adrl.integrations.ros.messages import new_message, odometry_of, point_of, pose_of, scan_of
from adrl.integrations.ros.outbox import Outbox, Publish

NAME = "adrl"
"""Of the node."""
TICKS = 4
"""A control period: so often the node looks whether a scan is missing."""
CLOCK_LATE_PERIODS = 2
"""A simulated clock may be so late; a scan that is farther ahead of it has another clock."""
LATCHED = ("amcl_pose", "adrl/status")
"""Topics whose last message is for whoever comes late."""


def publications(config: DriveConfig) -> dict[str, str]:
    """Topic -> kind of message."""
    command = "geometry_msgs/msg/TwistStamped" if config.stamped else "geometry_msgs/msg/Twist"
    return {
        "cmd_vel": command,
        "plan": "nav_msgs/msg/Path",
        "adrl/status": "diagnostic_msgs/msg/DiagnosticArray",
    }


class DriveTopics:
    """What comes in and what goes out. One call at a time."""

    def __init__(
        self,
        config: DriveConfig,
        publish: Mapping[str, Publish],
        *,
        now_s: Callable[[], float],
        seconds: Callable[[Any], float],
        header: Callable[[float, str], Any],
        simulated: bool,
        new: New = new_message,
    ) -> None:
        """publish: of the publications. now_s: the node's clock, simulated if use_sim_time says so; seconds: of a
        stamp; header: of a stamp and a frame; new: makes messages. Raises AdrlError."""
        self._driver = config.driver()
        self._outbox = Outbox(config, self._driver.navigator.robot.name, publish, header, new)
        self._now_s, self._seconds = now_s, seconds
        self._simulated = simulated
        self._ended = False

    @property
    def tick_s(self) -> float:
        """Seconds between two calls of tick()."""
        return self._driver.period_s / TICKS

    def subscriptions(self) -> dict[str, tuple[str, Callable[[Any], None]]]:
        """Topic -> kind of message, and what takes it."""
        return {
            "scan": ("sensor_msgs/msg/LaserScan", self._take_scan),
            "odom": ("nav_msgs/msg/Odometry", self._take_odometry),
            "goal_pose": ("geometry_msgs/msg/PoseStamped", self._take_goal),
            "amcl_pose": ("geometry_msgs/msg/PoseWithCovarianceStamped", self._take_pose),
            "adrl/cancel": ("std_msgs/msg/Empty", lambda _: self._driver.cancel()),
        }

    def tick(self) -> None:
        """The step that is due without a scan."""
        now_s = self._now_s()
        self._deliver(self._driver.tick(now_s), now_s)

    def stop(self) -> None:
        """The last command, if the base is ours. In ROS 1 scans still come while the node ends: by other threads."""
        self._ended = True
        if self._driver.has_base:
            self._outbox.command((0.0, 0.0), self._now_s())

    def _take_scan(self, message: Any) -> None:
        stamp_s, now_s = self._seconds(message.header.stamp), self._now_s()
        # In simulation the clock is a topic as well, and may come after the scan of its time; not much after.
        if self._simulated and now_s < stamp_s <= now_s + CLOCK_LATE_PERIODS * self._driver.period_s:
            now_s = stamp_s
        self._deliver(self._driver.take_scan(scan_of(message, stamp_s), now_s), now_s)

    def _deliver(self, report: Report | None, now_s: float) -> None:
        if report is None or self._ended:
            return
        made_s = self._now_s()
        if report.send and any(report.command.twist) and made_s > now_s + self._driver.period_s:
            now_s, report = made_s, self._driver.withhold(report, made_s)
        self._outbox.deliver(report, now_s)

    def _take_odometry(self, message: Any) -> None:
        self._driver.take_odometry(odometry_of(message, self._seconds(message.header.stamp)))

    def _take_pose(self, message: Any) -> None:
        header = message.header
        self._driver.take_pose(pose_of(message.pose.pose), header.frame_id, self._seconds(header.stamp))

    def _take_goal(self, message: Any) -> None:
        with contextlib.suppress(GoalRefused):  # logged, and in the status
            self._driver.set_goal(point_of(message.pose), message.header.frame_id)
