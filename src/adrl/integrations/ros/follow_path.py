"""Nav2's action follow_path: which path is followed, when it is given up, with which of Nav2's error codes."""

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from adrl.deploy import Pose, Reason
from adrl.deploy.driver import Report
from adrl.errors import BadGoal, ConfigError, GoalRefused
from adrl.geometry import yaw_of
from adrl.integrations.ros.actions import ActionFailed
from adrl.integrations.ros.config import ControllerConfig
from adrl.integrations.ros.drive import DriveTopics
from adrl.integrations.ros.messages import message_class

LOG = logging.getLogger("adrl.driver")

NONE, UNKNOWN, INVALID_CONTROLLER, TF_ERROR, INVALID_PATH = 0, 100, 101, 102, 103
PATIENCE_EXCEEDED, FAILED_TO_MAKE_PROGRESS, NO_VALID_CONTROL, CONTROLLER_TIMED_OUT = 104, 105, 106, 107
"""Error codes of nav2_msgs/action/FollowPath."""
ACTION = "nav2_msgs/action/FollowPath"
TURNED_RAD = 0.5
"""Turning so far is progress for a robot that has arrived; of Nav2's PoseProgressChecker."""
OF_SENSORS = ("scan", "odometry", "clock", "no_")
"""How reasons begin that are of missing or unbelievable sensors."""


@dataclass(frozen=True, kw_only=True)
class GoalChecker:
    """When a path's end is reached; names and defaults of Nav2's SimpleGoalChecker."""

    xy_goal_tolerance: float = 0.25
    yaw_goal_tolerance: float = 0.25


@dataclass(frozen=True, kw_only=True)
class ProgressChecker:
    """When a robot comes nowhere; names and defaults of Nav2's SimpleProgressChecker."""

    required_movement_radius: float = 0.5
    movement_time_allowance: float = 10.0


@dataclass(frozen=True, kw_only=True)
class Plugins:
    """By the names that goals ask for."""

    controllers: tuple[str, ...]
    goal_checkers: dict[str, GoalChecker]
    progress_checkers: dict[str, ProgressChecker]

    @classmethod
    def of(cls, get: Callable[[str, Any], Any]) -> "Plugins":
        """get(name, default): a parameter's value. Raises ConfigError."""
        return cls(
            controllers=tuple(_names(get, "controller_plugins", "FollowPath")),
            goal_checkers={
                name: _filled(GoalChecker, name, get)
                for name in _names(get, "goal_checker_plugins", "goal_checker")
            },
            progress_checkers={
                name: _filled(ProgressChecker, name, get)
                for name in _names(get, "progress_checker_plugins", "progress_checker")
            },
        )


def _names(get: Callable[[str, Any], Any], parameter: str, default: str) -> list[str]:
    names = get(parameter, [default])
    if not names or not all(isinstance(name, str) and name for name in names):
        raise ConfigError(f"parameter {parameter} is {names!r}; give a list of names")
    return list(names)


def _filled(kind: Any, name: str, get: Callable[[str, Any], Any]) -> Any:
    values = {field: get(f"{name}.{field}", value) for field, value in vars(kind()).items()}
    for field, value in values.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not value > 0.0:
            raise ConfigError(f"parameter {name}.{field} is {value!r}; give a number above 0")
    return kind(**{field: float(value) for field, value in values.items()})


class FollowPath:
    """See actions.Task."""

    def __init__(self, config: ControllerConfig, plugins: Plugins, topics: DriveTopics) -> None:
        self._config, self._plugins, self._topics = config, plugins, topics
        self._progress = ProgressChecker()
        self._end: tuple[float, float] | None = None
        self._from: tuple[Pose, float] | None = None
        """Where and when the robot last made progress."""
        self._held_s: float | None = None
        """Since when it is held."""
        self._left_m = 0.0

    def begin(self, goal: Any, now_s: float, *, goes_on: bool) -> None:
        """See Task. A new path to the same end goes on with what was driven."""
        if goal.controller_id and goal.controller_id not in self._plugins.controllers:
            raise ActionFailed(INVALID_CONTROLLER, _unknown("controller", goal, self._plugins.controllers))
        checker = _chosen("goal_checker", goal, self._plugins.goal_checkers)
        self._progress = _chosen("progress_checker", goal, self._plugins.progress_checkers)
        poses = goal.path.poses
        path = np.array([(p.pose.position.x, p.pose.position.y) for p in poses]).reshape(-1, 2)
        if len(path) == 0:
            raise ActionFailed(INVALID_PATH, "the path has no poses")
        yaw_rad = yaw_of(poses[-1].pose.orientation)
        asked = checker.yaw_goal_tolerance < math.pi and math.isfinite(yaw_rad)
        driver = self._topics.driver
        driver.navigator.goal_tolerance_m = checker.xy_goal_tolerance
        driver.navigator.yaw_tolerance_rad = checker.yaw_goal_tolerance
        x, y = path[-1].tolist()
        try:
            driver.set_goal((x, y), goal.path.header.frame_id, path=path, yaw_rad=yaw_rad if asked else None)
        except BadGoal as refusal:
            raise ActionFailed(INVALID_PATH, str(refusal)) from None
        except GoalRefused as refusal:
            raise ActionFailed(TF_ERROR, str(refusal)) from None
        if not goes_on or self._end is None or math.dist(self._end, (x, y)) > checker.xy_goal_tolerance:
            self._from = self._held_s = None
        self._end = (x, y)

    def check(self, report: Report, now_s: float) -> None:
        """See Task."""
        if report.outcome == "failed":
            raise ActionFailed(NO_VALID_CONTROL, report.message)
        self._check_held(report, now_s)
        here = self._topics.driver.here
        if here is None:
            return
        if self._from is None or now_s < self._from[1] or self._has_moved(self._from[0], here):
            self._from = (here, now_s)
        allowed_s = self._progress.movement_time_allowance
        if now_s - self._from[1] > allowed_s:
            why = f" ({', '.join(report.command.reasons)})" if report.command.reasons else ""
            raise ActionFailed(
                FAILED_TO_MAKE_PROGRESS,
                f"less than {self._progress.required_movement_radius:g} m in {allowed_s:g} s{why}",
            )

    def feedback(self, report: Report, now_s: float) -> Any:
        """See Task."""
        feedback = message_class(ACTION).Feedback()
        # In later releases of Nav2 they are part of another message.
        about = feedback if hasattr(feedback, "distance_to_goal") else feedback.tracking_feedback
        if report.command.distance_m is not None:
            self._left_m = report.command.distance_m
        about.distance_to_goal = float(self._left_m)
        about.speed = abs(float(report.command.twist[0]))
        return feedback

    def result(self, code: int, message: str) -> Any:
        """See Task."""
        return message_class(ACTION).Result(error_code=code, error_msg=message)

    def _has_moved(self, before: Pose, here: Pose) -> bool:
        if math.dist(before[:2], here[:2]) > self._progress.required_movement_radius:
            return True
        turned = abs(math.remainder(here[2] - before[2], 2.0 * math.pi))
        return self._topics.driver.navigator.is_turning and turned > TURNED_RAD

    def _check_held(self, report: Report, now_s: float) -> None:
        if report.command.status != "stopped":
            self._held_s = None
            return
        if self._held_s is None or now_s < self._held_s:
            self._held_s = now_s
        reasons = report.command.reasons
        reason: Reason = "not_localised" if "not_localised" in reasons else reasons[0]
        of_sensors = reason.startswith(OF_SENSORS)
        patience_s = self._config.costmap_update_timeout if of_sensors else self._config.failure_tolerance
        if now_s - self._held_s < patience_s or patience_s == -1.0:
            return
        words = f"held for {now_s - self._held_s:.1f} s: {', '.join(report.command.reasons)}"
        if report.message:
            words += f": {report.message}"
        if reason == "not_localised":
            raise ActionFailed(TF_ERROR, words)
        if of_sensors:
            raise ActionFailed(CONTROLLER_TIMED_OUT, words)
        raise ActionFailed(NO_VALID_CONTROL if patience_s == 0.0 else PATIENCE_EXCEEDED, words)


def _unknown(what: str, goal: Any, known: Any) -> str:
    return f"no {what.replace('_', ' ')} {getattr(goal, what + '_id')!r}; known: {', '.join(known)}"


def _chosen(what: str, goal: Any, known: dict[str, Any]) -> Any:
    """The checker that a goal names; without a name the only one. Raises ActionFailed."""
    name = getattr(goal, f"{what}_id", "")
    if not name and len(known) == 1:
        return next(iter(known.values()))
    if name not in known:
        raise ActionFailed(UNKNOWN, _unknown(what, goal, known))
    return known[name]
