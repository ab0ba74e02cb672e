"""The observation encoder: scan, goal and twist in, one vector out. Training, evaluation and robots all use this one."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adrl.errors import ConfigError
from adrl.types import Array, RobotConfig

F32 = NDArray[np.float32]

GOAL_FEATURES = 4
TWIST_FEATURES = 2
ACTION_FEATURES = 2


@dataclass(frozen=True, kw_only=True)
class EncoderConfig:
    """How a scan becomes features. Stored with every policy."""

    num_sectors: int = 36
    """Sectors of a full circle; each holds the nearest range of its beams."""
    near_m: float = 0.3
    """Range at which the logarithmic scale turns: gaps of this size and below get most of the resolution."""
    goal_scale_m: float = 1.0
    """Same for the distance to the goal."""

    def __post_init__(self) -> None:
        if not 4 <= self.num_sectors <= 2048:
            raise ConfigError(f"encoder.num_sectors is {self.num_sectors}; give 4 to 2048")
        for name in ("near_m", "goal_scale_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"encoder.{name} is {value}; give a positive number")


class ObservationEncoder:
    """(N, K) ranges, goals, twists and last actions -> (N, D) float32, D = num_sectors + 8."""

    def __init__(self, robot: RobotConfig, config: EncoderConfig | None = None) -> None:
        self.config = config or EncoderConfig()
        self.robot = robot
        sectors = self.config.num_sectors
        angles = robot.lidar.angles_rad + robot.lidar.mount_yaw_rad
        # Sector s is centred on the heading -pi + (s + 0.5) 2 pi / sectors: none is centred on a beam at -pi, so a
        # mirrored scan gives mirrored sectors.
        sector = np.floor((angles + math.pi) / (2.0 * math.pi) * sectors + 1e-9).astype(np.int64) % sectors
        self._order = np.argsort(sector, kind="stable")
        self._in_order = bool((self._order == np.arange(len(angles))).all())
        self._covered, self._first = np.unique(sector[self._order], return_index=True)
        centres = -math.pi + (np.arange(sectors) + 0.5) * 2.0 * math.pi / sectors
        self._extent = _extent(robot, centres).astype(np.float32)
        self._log_scale = np.float32(1.0 / math.log1p(robot.lidar.max_range_m / self.config.near_m))
        self._inverse_near = np.float32(1.0 / self.config.near_m)

    @property
    def size(self) -> int:
        """D, the length of an observation."""
        return self.config.num_sectors + GOAL_FEATURES + TWIST_FEATURES + ACTION_FEATURES

    def encode(self, ranges: F32, goal: Array, twist: Array, last_action: F32) -> F32:
        """Encode N robots.

        ranges (N, K) metres; goal (N, 2) metres, in the robot's frame; twist (N, 2) m/s, rad/s; last_action (N, 2).
        Each sector: 0 at contact, 1 at the LiDAR's greatest range, logarithmic between. A sector no beam falls in
        reads 1.
        """
        sectors = self.config.num_sectors
        out = np.empty((len(ranges), self.size), dtype=np.float32)
        scan = out[:, :sectors]
        scan[:] = self.robot.lidar.max_range_m
        ordered = ranges if self._in_order else ranges[:, self._order]
        scan[:, self._covered] = np.minimum.reduceat(ordered, self._first, axis=1)
        scan -= self._extent
        np.maximum(scan, 0.0, out=scan)
        scan *= self._inverse_near
        np.log1p(scan, out=scan)
        scan *= self._log_scale
        distance = np.hypot(goal[:, 0], goal[:, 1])
        safe = np.maximum(distance, 1e-9)
        out[:, sectors] = goal[:, 0] / safe
        out[:, sectors + 1] = goal[:, 1] / safe
        # Two scales: one tells near goals apart, one far ones; both end at 1.
        out[:, sectors + 2] = distance / (distance + self.config.goal_scale_m)
        out[:, sectors + 3] = np.minimum(0.1 * distance, 1.0)
        out[:, sectors + 4] = twist[:, 0] / self.robot.max_speed_mps
        out[:, sectors + 5] = twist[:, 1] / self.robot.max_yaw_rate_radps
        out[:, sectors + 6 :] = last_action
        return out


def in_robot_frame(pose: Array, points: Array) -> Array:
    """(N, 3) poses, (N, 2) points in the world -> (N, 2) points as the robots see them: x ahead, y to the left."""
    offset = points - pose[:, :2]
    cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    return np.stack([cos * offset[:, 0] + sin * offset[:, 1], cos * offset[:, 1] - sin * offset[:, 0]], axis=1)


def to_twist(action: F32, robot: RobotConfig) -> Array:
    """(N, 2) actions in [-1, 1] -> (N, 2) commands: speed from min_speed to max_speed (m/s), yaw rate (rad/s)."""
    clipped = np.clip(action, -1.0, 1.0).astype(np.float64)
    span = robot.max_speed_mps - robot.min_speed_mps
    speed = robot.min_speed_mps + 0.5 * (clipped[:, 0] + 1.0) * span
    return np.stack([speed, clipped[:, 1] * robot.max_yaw_rate_radps], axis=1)


def to_action(twist: Array, robot: RobotConfig) -> F32:
    """(N, 2) commands -> (N, 2) actions: the inverse of to_twist, clipped to [-1, 1]."""
    span = robot.max_speed_mps - robot.min_speed_mps
    speed = 2.0 * (twist[:, 0] - robot.min_speed_mps) / span - 1.0
    action = np.stack([speed, twist[:, 1] / robot.max_yaw_rate_radps], axis=1)
    return np.clip(action, -1.0, 1.0).astype(np.float32)


def _extent(robot: RobotConfig, angles: Array) -> Array:
    """(S,) distance from the robot's origin to its footprint's edge along each angle."""
    if robot.radius_m is not None:
        return np.full(len(angles), robot.radius_m)
    corners = robot.polygon
    edges = np.roll(corners, -1, axis=0) - corners
    normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1)  # outward, for counter-clockwise corners
    offsets = (normals * corners).sum(axis=1)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    along = directions @ normals.T
    with np.errstate(divide="ignore"):
        reach = np.where(along > 1e-12, offsets / along, np.inf)
    return reach.min(axis=1)
