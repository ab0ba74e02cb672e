"""Actions of a node that finds its way itself: Nav2's navigate_to_pose, and move_base of ROS 1."""

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


class ToPose:
    """What both generations' actions have in common; see actions.Task."""

    def __init__(
        self, topics: DriveTopics, header: Any, map_frame: str, *, turns: bool, new: New = new_message
    ) -> None:
        """header: of a stamp and a frame. turns: to the goal's heading, on arrival."""
        self._topics, self._header, self._map_frame = topics, header, map_frame
        self._turns, self._new = turns, new

    def target(self, goal: Any) -> Any:
        """The geometry_msgs/PoseStamped of a goal."""
        return goal.pose

    def begin(self, goal: Any, now_s: float, *, goes_on: bool) -> None:
        """See Task."""
        target = self.target(goal)
        yaw_rad = yaw_of(target.pose.orientation) if self._turns else None
        try:
            self._topics.driver.set_goal(point_of(target.pose), target.header.frame_id, yaw_rad=yaw_rad)
        except (NotLocalised, UnknownFrame) as refusal:
            raise ActionFailed(TF_ERROR, str(refusal)) from None
        except GoalRefused as refusal:
            raise ActionFailed(UNKNOWN, str(refusal)) from None

    def check(self, report: Report, now_s: float) -> None:
        """See Task. A robot that is held waits: what ends it is who sent the goal."""
        if report.outcome == "failed":
            raise ActionFailed(UNKNOWN, report.message)

    def place(self, now_s: float) -> Any:
        """Where the robot is on the map, as a geometry_msgs/PoseStamped; None where that is not known."""
        here = self._topics.driver.here_on_map
        if here is None:
            return None
        return pose_stamped(self._new, self._header(now_s, self._map_frame), here)


class MoveBase(ToPose):
    """ROS 1's move_base_msgs/MoveBaseAction: what went wrong is in the words of its end."""

    def target(self, goal: Any) -> Any:
        """See ToPose."""
        return goal.target_pose

    def feedback(self, report: Report, now_s: float) -> Any:
        """See Task."""
        feedback = message_class("move_base_msgs/msg/MoveBaseFeedback")()
        feedback.base_position = self.place(now_s) or feedback.base_position
        return feedback

    def result(self, code: int, message: str) -> Any:
        """See Task."""
        return message_class("move_base_msgs/msg/MoveBaseResult")()


class NavigateToPose(ToPose):
    """Nav2's, with time, metres and recoveries."""

    _began_s = 0.0
    _recoveries = 0
    _first_m: float | None = None
    _left_m = 0.0

    def begin(self, goal: Any, now_s: float, *, goes_on: bool) -> None:
        """See Task."""
        super().begin(goal, now_s, goes_on=goes_on)
        self._began_s, self._recoveries = now_s, self._topics.driver.navigator.recoveries
        self._first_m = None

    def feedback(self, report: Report, now_s: float) -> Any:
        """See Task."""
        if report.command.distance_m is not None:
            self._left_m = report.command.distance_m
            self._first_m = self._first_m if self._first_m is not None else self._left_m
        feedback = message_class(ACTION).Feedback()
        feedback.current_pose = self.place(now_s) or feedback.current_pose
        passed_s = max(now_s - self._began_s, 0.0)
        speed = ((self._first_m or 0.0) - self._left_m) / max(passed_s, 1e-9)
        _set(feedback.navigation_time, passed_s)
        _set(feedback.estimated_time_remaining, self._left_m / speed if speed > SLOWEST_MPS else 0.0)
        feedback.number_of_recoveries = self._topics.driver.navigator.recoveries - self._recoveries
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
