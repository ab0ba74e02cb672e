"""ROS messages and our types. Both generations name packages, messages and fields alike; only stamps differ."""

import math
from typing import Any

import numpy as np

from adrl.deploy import Odometry, Pose, Scan, Twist
from adrl.integrations.driver import Report
from adrl.poses import yaw_of
from adrl.types import Array, LidarConfig


def scan_of(message: Any, stamp_s: float) -> Scan:
    """Of a sensor_msgs/LaserScan."""
    return Scan(
        ranges=np.asarray(message.ranges),
        angle_min_rad=message.angle_min,
        angle_increment_rad=message.angle_increment,
        range_min_m=message.range_min,
        range_max_m=message.range_max,
        stamp_s=stamp_s,
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


def set_pose(pose: Any, value: Pose) -> None:
    """Fill a geometry_msgs/Pose."""
    pose.position.x, pose.position.y = value[0], value[1]
    pose.orientation.z, pose.orientation.w = math.sin(0.5 * value[2]), math.cos(0.5 * value[2])


def set_twist(twist: Any, value: Twist) -> None:
    """Fill a geometry_msgs/Twist."""
    twist.linear.x, twist.angular.z = value


def scan_message(lidar: LidarConfig, ranges: Array, period_s: float, header: Any) -> Any:
    """A sensor_msgs/LaserScan; what is out of reach is infinity (REP 117)."""
    from sensor_msgs.msg import LaserScan  # pyright: ignore[reportMissingImports]

    message = LaserScan(header=header)
    message.angle_min = lidar.angle_min_rad
    message.angle_increment = lidar.angle_increment_rad
    message.angle_max = lidar.angle_min_rad + (lidar.num_beams - 1) * lidar.angle_increment_rad
    message.range_min, message.range_max = 0.0, lidar.max_range_m
    message.scan_time = period_s
    message.ranges = np.where(ranges >= lidar.max_range_m, np.inf, ranges).astype(np.float32).tolist()
    return message


def odometry_message(odometry: Odometry, base_frame: str, header: Any) -> Any:
    """A nav_msgs/Odometry."""
    from nav_msgs.msg import Odometry as Message  # pyright: ignore[reportMissingImports]

    message = Message(header=header, child_frame_id=base_frame)
    set_pose(message.pose.pose, odometry.pose)
    set_twist(message.twist.twist, odometry.twist)
    return message


def pose_message(pose: Pose, header: Any) -> Any:
    """A geometry_msgs/PoseWithCovarianceStamped."""
    from geometry_msgs.msg import PoseWithCovarianceStamped  # pyright: ignore[reportMissingImports]

    message = PoseWithCovarianceStamped(header=header)
    set_pose(message.pose.pose, pose)
    return message


def twist_message(twist: Twist, header: Any, *, stamped: bool) -> Any:
    """A geometry_msgs/Twist, or TwistStamped."""
    from geometry_msgs.msg import (  # pyright: ignore[reportMissingImports]
        Twist as Message,
    )
    from geometry_msgs.msg import (  # pyright: ignore[reportMissingImports]
        TwistStamped,
    )

    message = TwistStamped(header=header) if stamped else Message()
    set_twist(message.twist if stamped else message, twist)
    return message


def path_message(plan: Array, header: Any) -> Any:
    """A nav_msgs/Path through (P, 2) points."""
    from geometry_msgs.msg import PoseStamped  # pyright: ignore[reportMissingImports]
    from nav_msgs.msg import Path  # pyright: ignore[reportMissingImports]

    message = Path(header=header)
    headings = np.arctan2(*np.diff(plan, axis=0).T[::-1]) if len(plan) > 1 else np.zeros(len(plan))
    for (x, y), yaw in zip(plan.tolist(), [*headings, *headings[-1:]], strict=False):
        at = PoseStamped(header=header)
        set_pose(at.pose, (x, y, float(yaw)))
        message.poses.append(at)
    return message


def status_message(report: Report, hardware: str, header: Any) -> Any:
    """A diagnostic_msgs/DiagnosticArray with one status."""
    from diagnostic_msgs.msg import (  # pyright: ignore[reportMissingImports]
        DiagnosticArray,
        DiagnosticStatus,
        KeyValue,
    )

    values = status_values(report)
    level = DiagnosticStatus.OK
    if report.refusal is not None or report.outcome == "failed":
        level = DiagnosticStatus.ERROR
    elif report.command.status == "stopped":
        level = DiagnosticStatus.WARN
    status = DiagnosticStatus(level=level, name="adrl: navigation", hardware_id=hardware)
    status.message = report.message or ", ".join(filter(None, (values["status"], values["reasons"])))
    status.values = [KeyValue(key=key, value=value) for key, value in values.items()]
    return DiagnosticArray(header=header, status=[status])


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
