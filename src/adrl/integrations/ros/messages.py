"""ROS messages and our types. Both generations name packages, messages and fields alike; only stamps differ."""

import math
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

from adrl.bags.messages import New
from adrl.deploy import Odometry, Pose, Scan
from adrl.deploy.driver import Report
from adrl.geometry import yaw_of

OK, WARN, ERROR = range(3)
"""Levels of a status."""
STATUS = "diagnostic_msgs/msg/DiagnosticStatus"


@cache
def message_class(kind: str) -> Any:
    """Of a name such as "geometry_msgs/msg/Pose", in the generation that is on the path. Raises ImportError."""
    package, folder, name = kind.split("/")
    return getattr(import_module(f"{package}.{folder}"), name)


def new_message(kind: str, /, **fields: Any) -> Any:
    """A message with these fields."""
    made = message_class(kind)
    plain = {name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in fields.items()}
    if kind == STATUS and isinstance(made.OK, bytes):  # ROS 2 has bytes where ROS 1 has small numbers
        plain["level"] = bytes([plain["level"]])
    return made(**plain)


def scan_of(message: Any, stamp_s: float) -> Scan:
    """Of a sensor_msgs/LaserScan."""
    return Scan(
        ranges=np.asarray(message.ranges),
        angle_min_rad=message.angle_min,
        angle_increment_rad=message.angle_increment,
        angle_max_rad=getattr(message, "angle_max", math.nan),
        range_min_m=message.range_min,
        range_max_m=message.range_max,
        stamp_s=stamp_s,
        time_increment_s=message.time_increment,
    )


def odometry_of(message: Any, stamp_s: float) -> Odometry:
    """Of a nav_msgs/Odometry."""
    twist = message.twist.twist
    return Odometry(pose=pose_of(message.pose.pose), twist=(twist.linear.x, twist.angular.z), stamp_s=stamp_s)


def pose_of(pose: Any) -> Pose:
    """Of a geometry_msgs/Pose; NaN as yaw where its quaternion is none."""
    return pose.position.x, pose.position.y, yaw_of(pose.orientation)


def point_of(pose: Any) -> tuple[float, float]:
    """x, y of a geometry_msgs/Pose: goals have no heading for us."""
    return pose.position.x, pose.position.y


def status_message(new: New, report: Report, hardware: str, header: Any, policy: str | None = None) -> Any:
    """A diagnostic_msgs/DiagnosticArray with one status. policy: what is to be said of it, if anything."""
    values = status_values(report) | ({} if policy is None else {"policy": policy})
    level = OK
    if report.outcome == "failed" or (report.refusal is not None and report.goal is None):
        level = ERROR
    elif report.command.status == "stopped" or report.refusal is not None:
        level = WARN
    status = new(
        STATUS,
        level=level,
        name="adrl: navigation",
        message=status_words(report),
        hardware_id=hardware,
        values=[new("diagnostic_msgs/msg/KeyValue", key=key, value=value) for key, value in values.items()],
    )
    return new("diagnostic_msgs/msg/DiagnosticArray", header=header, status=[status])


def status_words(report: Report) -> str:
    """What the node does, with the goal in its frame, and why; where a goal failed or was refused, why that."""
    words: str = report.command.status
    if report.goal is not None:
        x, y = report.goal
        words += f" on the way to ({x:.2f}, {y:.2f}) in {report.goal_frame}"
    return report.message or ", ".join((words, *report.command.reasons))


def status_values(report: Report) -> dict[str, str]:
    """What a status says: key -> value."""
    command = report.command
    return {
        "status": command.status,
        "reasons": ", ".join(command.reasons),
        "outcome": report.outcome,
        "refusal": "" if report.refusal is None else type(report.refusal).__name__,
        "goal": "" if report.goal is None else f"{report.goal[0]:.3f} {report.goal[1]:.3f}",
        "goal_frame": "" if report.goal is None else report.goal_frame,
        "distance_m": "" if command.distance_m is None else f"{command.distance_m:.2f}",
        "goals": str(report.goals),
    }
