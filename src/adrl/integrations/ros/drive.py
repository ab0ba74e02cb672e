"""The driving node of either generation, but for the middleware: which topics, and what happens on them."""

import contextlib
import logging
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from adrl.bags.messages import New
from adrl.deploy import Scan
from adrl.deploy.driver import Driver, Report
from adrl.deploy.frames import Frames
from adrl.errors import GoalRefused, TransformError
from adrl.geometry import yaw_of
from adrl.integrations.ros.config import DriveConfig, RuntimeConfig
from adrl.integrations.ros.display import Display, displays
from adrl.integrations.ros.messages import new_message, odometry_of, point_of, pose_of
from adrl.integrations.ros.outbox import Outbox, Publish
from adrl.integrations.ros.sensor import Sensor
from adrl.integrations.ros.transforms import TF, take_transforms

LOG = logging.getLogger("adrl.driver")

NAME = "adrl"
"""Of the node."""
TICKS = 4
"""A control period: so often the node looks whether a scan is missing."""
FASTER = 4
"""So many times as often where the clock is simulated, for one that runs faster than real time."""
CLOCK_LATE_PERIODS = 2
"""A simulated clock may be so late; a scan that is farther ahead of it has another clock."""
CLOCK_PATIENCE_S = 1.0
"""A simulated clock that stands still for so long, by the wall's, has stopped."""
UNSTAMPED_S = 1.0
"""A stamp of 0 is none once the clock has gone so far."""
LATCHED = ("amcl_pose", "adrl/status")
"""Topics whose last message is for whoever comes late."""


def publications(config: RuntimeConfig) -> dict[str, str]:
    """Topic -> kind of message."""
    command = "geometry_msgs/msg/TwistStamped" if config.commands_are_stamped else "geometry_msgs/msg/Twist"
    return {
        "cmd_vel": command,
        "plan": "nav_msgs/msg/Path",
        "adrl/status": "diagnostic_msgs/msg/DiagnosticArray",
    } | displays()


class DriveTopics:
    """What comes in and what goes out. One call at a time."""

    def __init__(
        self,
        config: RuntimeConfig,
        publish: Mapping[str, Publish],
        *,
        now_s: Callable[[], float],
        seconds: Callable[[Any], float],
        header: Callable[[float, str], Any],
        simulated: bool,
        heard: Callable[[str], bool] = lambda topic: True,
        new: New = new_message,
        wall_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """publish: of the publications. now_s: the node's clock, simulated if use_sim_time says so; wall_s: one that
        nobody sets; seconds: of a stamp; header: of a stamp and a frame; heard: whether anybody listens to a topic;
        new: makes messages. Raises AdrlError."""
        self._config = config
        self.frames = Frames(tolerance_s=config.transform_tolerance)
        """Where frames are in each other, as transforms tell."""
        self.driver: Driver = config.driver(self.frames)
        """What drives."""
        navigator = self.driver.navigator
        self._sensor = Sensor(config, self.frames, navigator.robot.lidar)
        self.heed: list[Callable[[Report, float], None]] = []
        """Called with each report, and when it is of, after what it says has been published."""
        self.active = True
        """Whether commands are published at all."""
        self.open = True
        """Whether anything is: not once the publishers are no more, whatever is still on its way."""
        self._outbox = Outbox(
            config, navigator.robot.name, publish, header, new, wall_s, navigator.other_robot
        )
        self._display = Display(config, publish, heard, header, new, wall_s)
        self._now_s, self._seconds, self._wall_s = now_s, seconds, wall_s
        self._simulated = simulated
        self._clock = (-math.inf, wall_s())
        """What the node's clock said last, and since when."""
        self._stood_s = -math.inf
        self._unstamped: set[str] = set()

    @property
    def tick_s(self) -> float:
        """Seconds of real time between two calls of tick(): a simulated clock may run faster."""
        return self.driver.period_s / (TICKS * (FASTER if self._simulated else 1))

    def subscriptions(self) -> dict[str, tuple[str, Callable[[Any], None]]]:
        """Topic -> kind of message, and what takes it."""
        topics: dict[str, tuple[str, Callable[[Any], None]]] = {
            "odom": ("nav_msgs/msg/Odometry", self._take_odometry),
            self._sensor.topic: (self._sensor.kind, self._take_scan),
        }
        if self._config.source == "tf":
            for topic, static in TF.items():
                topics[topic] = ("tf2_msgs/msg/TFMessage", lambda m, s=static: self._take_transforms(m, s))
        if self._config.source == "pose":
            topics["amcl_pose"] = ("geometry_msgs/msg/PoseWithCovarianceStamped", self._take_pose)
        if isinstance(self._config, DriveConfig):
            topics["goal_pose"] = ("geometry_msgs/msg/PoseStamped", self._take_goal)
            topics["adrl/cancel"] = ("std_msgs/msg/Empty", lambda _: self.driver.cancel())
        return topics

    def tick(self) -> None:
        """The step that is due without a scan; with a simulated clock that has stopped, those by the wall's."""
        now_s, wall_s = self._now_s(), self._wall_s()
        if now_s != self._clock[0]:
            self._clock = (now_s, wall_s)
        if not self._simulated or wall_s < self._clock[1] + CLOCK_PATIENCE_S:
            self._deliver(self.driver.tick(now_s), now_s)
        elif wall_s >= self._stood_s + self.driver.period_s - 1e-6:
            self._stood_s = wall_s
            self._publish(self.driver.stand("clock_stopped", now_s), now_s)

    def stand(self) -> None:
        """The goal is forgotten, and the base told to stand at once."""
        self.driver.cancel()
        self._outbox.stand(self._now_s())

    def stop(self) -> None:
        """The last command, if the base is ours. In ROS 1 scans still come while the node ends: by other threads."""
        self._outbox.close(self._now_s(), stand=self.driver.has_base)

    def _stamp_s(self, topic: str, header: Any) -> float:
        """When a message was taken; one without a stamp is of now."""
        stamp_s, now_s = self._seconds(header.stamp), self._now_s()
        if stamp_s != 0.0 or now_s < UNSTAMPED_S:
            return stamp_s
        if topic not in self._unstamped:
            self._unstamped.add(topic)
            LOG.warning(
                "%s is stamped 0: it is taken to be of the moment it comes; have its driver stamp it", topic
            )
        return now_s

    def _take_scan(self, message: Any) -> None:
        stamp_s, now_s = self._stamp_s("scan", message.header), self._now_s()
        scan = self._scan_of(message, stamp_s)
        if scan is None:
            return
        # In simulation the clock is a topic as well, and may come after the scan of its time; not much after.
        if self._simulated and now_s < stamp_s <= now_s + CLOCK_LATE_PERIODS * self.driver.period_s:
            now_s = stamp_s
        self._deliver(self.driver.take_scan(scan, now_s), now_s)

    def _scan_of(self, message: Any, stamp_s: float) -> Scan | None:
        """None where nobody tells where on the robot the sensor is; once somebody does, the driver goes by it."""
        try:
            scan, mount = self._sensor.read(message, stamp_s)
        except TransformError as error:
            self._sensor.tell(error)
            return None
        if mount is not None:
            self.driver.take_navigator(self._config.navigator(mount))
        return scan

    def _take_transforms(self, message: Any, static: bool) -> None:
        take_transforms(self.frames, message, self._seconds, static=static)

    def _deliver(self, report: Report | None, now_s: float) -> None:
        if report is None:
            return
        made_s = self._now_s()
        if report.send and any(report.command.twist) and made_s > now_s + self.driver.period_s:
            now_s, report = made_s, self.driver.withhold(report, made_s)
        self._publish(report, now_s)

    def _publish(self, report: Report, now_s: float) -> None:
        if not self.open:
            return
        self._outbox.deliver(report if self.active else replace(report, send=False), now_s)
        for heed in self.heed:
            heed(report, now_s)
        self._display.show(self.driver, report, now_s)

    def _take_odometry(self, message: Any) -> None:
        odometry = odometry_of(message, self._stamp_s("odom", message.header))
        self.driver.take_odometry(odometry, getattr(message.header, "frame_id", ""))

    def _take_pose(self, message: Any) -> None:
        header = message.header
        self.driver.take_pose(pose_of(message.pose.pose), header.frame_id, self._stamp_s("amcl_pose", header))

    def _take_goal(self, message: Any) -> None:
        yaw_rad = yaw_of(message.pose.orientation) if self._turns else None
        with contextlib.suppress(GoalRefused):  # logged, and in the status
            self.driver.set_goal(point_of(message.pose), message.header.frame_id, yaw_rad=yaw_rad)

    @property
    def _turns(self) -> bool:
        return isinstance(self._config, DriveConfig) and self._config.goal_yaw
