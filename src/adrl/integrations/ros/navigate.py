"""Nav2's action navigate_to_pose, of a node that finds its way itself."""

import math
from typing import Any

from adrl.bags.messages import New, pose_stamped
from adrl.deploy.driver import Report
from adrl.errors import GoalRefused, NotLocalised, UnknownFrame
from adrl.geometry import yaw_of
from adrl.integrations.ros.actions import ActionFailed
from adrl.integrations.ros.drive import DriveTopics
from adrl.integrations.ros.messages import message_class, new_message, point_of

UNKNOWN, TF_ERROR = 9000, 9002
"""Error codes of nav2_msgs/action/NavigateToPose."""
ACTION = "nav2_msgs/action/NavigateToPose"
SLOWEST_MPS = 0.01
"""Below this mean speed nobody knows when the robot will arrive."""


class NavigateToPose:
    """See actions.Task."""

    def __init__(
        self, topics: DriveTopics, header: Any, map_frame: str, *, turns: bool, new: New = new_message
    ) -> None:
        """header: of a stamp and a frame. turns: to the goal's heading, on arrival."""
        self._topics, self._header, self._map_frame = topics, header, map_frame
        self._turns, self._new = turns, new
        self._began_s = 0.0
        self._recoveries = 0
        self._first_m: float | None = None
        self._left_m = 0.0

    def begin(self, goal: Any, now_s: float, *, goes_on: bool) -> None:
        """See Task."""
        driver = self._topics.driver
        yaw_rad = yaw_of(goal.pose.pose.orientation) if self._turns else None
        try:
            driver.set_goal(point_of(goal.pose.pose), goal.pose.header.frame_id, yaw_rad=yaw_rad)
        except (NotLocalised, UnknownFrame) as refusal:
            raise ActionFailed(TF_ERROR, str(refusal)) from None
        except GoalRefused as refusal:
            raise ActionFailed(UNKNOWN, str(refusal)) from None
        self._began_s, self._recoveries = now_s, driver.navigator.recoveries
        self._first_m = None

    def check(self, report: Report, now_s: float) -> None:
        """See Task. A robot that is held waits: what ends it is who sent the goal."""
        if report.outcome == "failed":
            raise ActionFailed(UNKNOWN, report.message)

    def feedback(self, report: Report, now_s: float) -> Any:
        """See Task."""
        driver = self._topics.driver
        if report.command.distance_m is not None:
            self._left_m = report.command.distance_m
            self._first_m = self._first_m if self._first_m is not None else self._left_m
        feedback = message_class(ACTION).Feedback()
        here = driver.here_on_map
        if here is not None:
            feedback.current_pose = pose_stamped(self._new, self._header(now_s, self._map_frame), here)
        passed_s = max(now_s - self._began_s, 0.0)
        speed = ((self._first_m or 0.0) - self._left_m) / max(passed_s, 1e-9)
        _set(feedback.navigation_time, passed_s)
        _set(feedback.estimated_time_remaining, self._left_m / speed if speed > SLOWEST_MPS else 0.0)
        feedback.number_of_recoveries = driver.navigator.recoveries - self._recoveries
        feedback.distance_remaining = float(self._left_m)
        return feedback

    def result(self, code: int, message: str) -> Any:
        """See Task."""
        result = message_class(ACTION).Result()
        result.error_code, result.error_msg = code, message
        return result


def _set(duration: Any, seconds: float) -> None:
    """Of a builtin_interfaces/Duration."""
    fraction, whole = math.modf(seconds)
    duration.sec, duration.nanosec = int(whole), int(1e9 * fraction)
