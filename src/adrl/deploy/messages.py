"""What goes into a robot's control step and what comes out. Times are seconds of one clock, the caller's."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from adrl.geometry import Pose
from adrl.types import Array

Twist = tuple[float, float]
"""Forward speed (m/s), yaw rate (rad/s)."""

Status = Literal["idle", "driving", "reached", "stopped", "failed"]
"""idle: no goal. driving: on the way. reached: at the goal. stopped: on the way, but held by the reasons given, and
going on by itself when they are gone. failed: the goal cannot be reached; it is dropped."""

Reason = Literal[
    "no_scan",
    "scan_stale",
    "scan_invalid",
    "scan_sparse",
    "scan_frozen",
    "mount",
    "no_odometry",
    "odometry_stale",
    "odometry_invalid",
    "odometry_frozen",
    "odometry_jumped",
    "not_localised",
    "clock_jumped",
    "clock_stopped",
    "command_invalid",
    "command_late",
    "scan_late",
    "scan_empty",
    "odometry_late",
    "base_late",
    "base_weak",
    "odometry_contradicts",
    "limited",
    "unseen",
    "obstacle",
    "recovering",
]
"""Why a command is not the one asked for; docs/how-to/robot.md explains each. All but the last ten stop the robot, and
scan_empty, when too little is left to drive by."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Scan:
    """A LiDAR scan as sensors give it: any number of beams, either direction, infinity and NaN allowed.

    +inf, or range_max_m and more: nothing within reach. NaN or 0: the beam tells nothing, nor does it of anything else
    below range_min_m, but the supervisor takes that for an obstacle. -inf: something nearer than range_min_m (REP 117).
    """

    ranges: Array
    """(K,) metres."""
    angle_min_rad: float
    """Angle of beam 0 in the sensor's frame."""
    angle_increment_rad: float
    """Angle from one beam to the next; below 0 for a scan that runs clockwise."""
    angle_max_rad: float = math.nan
    """Angle of the last beam, where the driver gives it too: the other two are checked by it."""
    range_min_m: float = 0.0
    range_max_m: float
    stamp_s: float
    """When its first beam was taken."""
    time_increment_s: float = 0.0
    """Time from one beam to the next; 0 where all are of one moment."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "ranges", np.asarray(self.ranges, dtype=np.float64))

    @property
    def lasts_s(self) -> float:
        """From its first beam to its last."""
        return (self.ranges.size - 1) * self.time_increment_s


@dataclass(frozen=True, kw_only=True)
class Odometry:
    """Where the robot is by its own reckoning, and how fast it drives."""

    pose: Pose
    """In the frame of the odometry."""
    twist: Twist
    """Measured, in the robot's frame."""
    stamp_s: float
    """When it was measured."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Command:
    """What to do in the control period that begins now."""

    twist: Twist
    """To send to the base."""
    status: Status
    reasons: tuple[Reason, ...] = ()
    """Why twist is not what the policy asked for; empty when it is."""
    message: str = ""
    """For people: why a goal failed."""
    waypoint: tuple[float, float] | None = None
    """Where the policy heads, in the goal's frame."""
    plan: Array
    """(P, 2) the way from here to the goal as far as it is known, in the goal's frame; empty without a goal."""
    distance_m: float | None = None
    """To the goal: along the path with guidance `map`, straight with the others."""
