"""A policy on another robot than the one it was trained for: what it takes it for, and what is other there."""

from collections.abc import Collection
from dataclasses import asdict, replace
from typing import Any

from adrl.errors import ConfigError
from adrl.types import RobotConfig
from adrl.worlds.families import RobotFamily

UNREAD = frozenset({"odometry_drift", "lidar.dropout_probability"})
"""What no encoder reads of a robot."""
READ_BY_BODY = frozenset(
    {
        "min_speed_mps",
        "min_turning_radius_m",
        "max_acceleration_mps2",
        "max_yaw_acceleration_radps2",
        "lag_s",
        "latency_s",
        "control_period_s",
    }
)
"""What is read by those that tell what the body is."""
READ_BY_MOTION_CUES = frozenset({"control_period_s", "lidar.noise_std_m"})
"""What is read by those with motion cues. All else every encoder reads."""


def as_trained(driven: RobotConfig, trained: RobotConfig) -> RobotConfig:
    """The robot that is driven, as a policy of another one takes it.

    Speeds are shares of its greatest ones, distances begin at its own footprint. It reverses only as the policy's own
    robot does, and the LiDAR reaches no other way than the policy's, whose scale of distances that is.
    """
    reverse = driven.max_speed_mps * trained.min_speed_mps / trained.max_speed_mps
    lidar = replace(driven.lidar, max_range_m=trained.lidar.max_range_m)
    return replace(driven, min_speed_mps=reverse, lidar=lidar)


def require_encodable(
    policy: str, trained: RobotConfig, taken_as: RobotConfig, history_steps: int, *, body: bool
) -> None:
    """For a policy with its robot's encoder inside, which cannot be made anew for the robot that is driven.

    taken_as: that robot, as the policy takes it. body: whether the encoder tells what the body is. Raises ConfigError
    where an encoder of that robot would give other numbers.
    """
    read = (READ_BY_BODY if body else set()) | (READ_BY_MOTION_CUES if history_steps > 0 else set())
    unread = (UNREAD | READ_BY_BODY | READ_BY_MOTION_CUES) - read
    found = robot_differences(trained, taken_as, ignored=unread)
    if found:
        raise ConfigError(
            f"policy {policy} holds the encoder of robot {trained.name}, and {taken_as.name} has {', '.join(found)}; "
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


def outside_family(policy: str, family: RobotFamily, driven: RobotConfig) -> str | None:
    """A line that names what of a robot the family of a policy does not have, or None."""
    found = family.outside(driven)
    if not found:
        return None
    numbers = "; ".join(found)
    return f"policy {policy} was trained for robots of family {family.name}, and {driven.name} is outside: {numbers}"


def _numbers(robot: RobotConfig) -> dict[str, Any]:
    fields = asdict(robot)
    lidar = {f"lidar.{name}": value for name, value in fields.pop("lidar").items()}
    return {name: value for name, value in (fields | lidar).items() if name != "name"}


def _text(value: Any) -> str:
    if value is None:
        return "none"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
