"""A policy on another robot than the one it was trained for: what it takes it for, and what is other there."""

from collections.abc import Collection
from dataclasses import asdict, replace
from typing import Any

from adrl.errors import ConfigError
from adrl.types import RobotConfig

UNREAD = frozenset(
    {
        "min_speed_mps",
        "min_turning_radius_m",
        "max_acceleration_mps2",
        "max_yaw_acceleration_radps2",
        "lag_s",
        "latency_s",
        "odometry_drift",
        "lidar.dropout_probability",
    }
)
"""What no encoder reads of a robot as_trained."""
READ_BY_MOTION_CUES = frozenset({"control_period_s", "lidar.noise_std_m"})
"""And what those without motion cues do not read."""


def as_trained(driven: RobotConfig, trained: RobotConfig) -> RobotConfig:
    """The robot that is driven, as a policy of another one takes it.

    Speeds are shares of its greatest ones, distances begin at its own footprint. It reverses only as the policy's own
    robot does, and the LiDAR reaches no other way than the policy's, whose scale of distances that is.
    """
    reverse = driven.max_speed_mps * trained.min_speed_mps / trained.max_speed_mps
    lidar = replace(driven.lidar, max_range_m=trained.lidar.max_range_m)
    return replace(driven, min_speed_mps=reverse, lidar=lidar)


def require_encodable(policy: str, trained: RobotConfig, driven: RobotConfig, history_steps: int) -> None:
    """For a policy with its robot's encoder inside, which cannot be made anew for the robot that is driven.

    Raises ConfigError where an encoder of that robot as_trained would give other numbers.
    """
    unread = UNREAD if history_steps > 0 else UNREAD | READ_BY_MOTION_CUES
    found = robot_differences(trained, as_trained(driven, trained), ignored=unread)
    if found:
        raise ConfigError(
            f"policy {policy} holds the encoder of robot {trained.name}, and {driven.name} has {', '.join(found)}; "
            "give the run that it was exported from, whose encoder is made for the robot that drives, or leave out "
            "another robot"
        )


def robot_differences(
    trained: RobotConfig, driven: RobotConfig, ignored: Collection[str] = ()
) -> tuple[str, ...]:
    """What is another number on the robot that is driven, as "max_speed_mps 0.9 instead of 0.6"; names do not count."""
    there, here = _numbers(trained), _numbers(driven)
    differing = [name for name in here if here[name] != there[name] and name not in ignored]
    return tuple(f"{name} {_text(here[name])} instead of {_text(there[name])}" for name in differing)


def other_robot(policy: str, trained: RobotConfig, driven: RobotConfig) -> str | None:
    """A line that says what is other on the robot that is driven than on the one a policy was trained for, or None."""
    found = robot_differences(trained, driven)
    if not found:
        return None
    name = driven.name if driven.name != trained.name else f"another {driven.name}"
    return f"policy {policy} was trained for robot {trained.name} and drives {name}: {', '.join(found)}"


def _numbers(robot: RobotConfig) -> dict[str, Any]:
    fields = asdict(robot)
    lidar = {f"lidar.{name}": value for name, value in fields.pop("lidar").items()}
    return {name: value for name, value in (fields | lidar).items() if name != "name"}


def _text(value: Any) -> str:
    if value is None:
        return "none"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
