"""The observation encoder: scan, goal and twist in, one vector out. Training and robots share it."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adrl.errors import ConfigError
from adrl.observation.motion import ScanHistory, motion_cue
from adrl.types import Array, RobotConfig

F32 = NDArray[np.float32]

GOAL_FEATURES = 4
TWIST_FEATURES = 2
ACTION_FEATURES = 2
MAX_HISTORY_STEPS = 50


@dataclass(frozen=True, kw_only=True)
class EncoderConfig:
    """How a scan becomes features. Stored with every policy."""

    num_sectors: int = 36
    """Sectors of a full circle; each holds the nearest range of its beams."""
    near_m: float = 0.3
    """Range in m at which the logarithmic scale turns: gaps of this size and below get most of the resolution."""
    goal_scale_m: float = 1.0
    """Same for the distance to the goal, m."""
    history_steps: int = 0
    """Control periods between the two scans whose comparison adds num_sectors motion cues (see motion); 0 for none."""

    def __post_init__(self) -> None:
        if not 4 <= self.num_sectors <= 2048:
            raise ConfigError(f"encoder.num_sectors is {self.num_sectors}; give 4 to 2048")
        for name in ("near_m", "goal_scale_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"encoder.{name} is {value}; give a positive number")
        if not 0 <= self.history_steps <= MAX_HISTORY_STEPS:
            raise ConfigError(
                f"encoder.history_steps is {self.history_steps}; give 0 to {MAX_HISTORY_STEPS} control periods"
            )


@dataclass(frozen=True, eq=False)
class Mirror:
    """Turns what a symmetric robot sees and does into what it would see and do in the mirrored world."""

    order: NDArray[np.intp]
    """(D,) index of the number that takes each place of an observation."""
    sign: F32
    """(D,) its factor, 1 or -1."""

    def observation(self, rows: F32) -> None:
        """Mirror observations (..., D) in place."""
        rows[...] = rows[..., self.order] * self.sign

    def action(self, rows: F32) -> None:
        """Mirror actions (..., 2) in place: the yaw rate turns round."""
        rows[..., 1] *= -1.0


class ObservationEncoder:
    """(N, K) ranges, goals, twists and last actions -> (N, D) float32, D = num_sectors + 8.

    With motion cues D = 2 num_sectors + 8, and encode() takes the ScanHistory of the robots.
    """

    def __init__(self, robot: RobotConfig, config: EncoderConfig | None = None) -> None:
        self.config = config or EncoderConfig()
        self.robot = robot
        sectors = self.config.num_sectors
        angles = robot.lidar.angles_rad + robot.lidar.mount_yaw_rad
        width = 2.0 * math.pi / sectors
        centres = -math.pi + (np.arange(sectors, dtype=np.float64) + 0.5) * width
        # A beam on the border of two sectors is in both: a mirrored scan gives mirrored sectors.
        away = np.abs(np.remainder(angles - centres[:, None] + math.pi, 2.0 * math.pi) - math.pi)  # (S, K)
        sector, self._order = np.nonzero(away <= 0.5 * width + 1e-9)
        self._covered, self._first = np.unique(sector, return_index=True)
        self._extent = footprint_extent(robot, centres).astype(np.float32)
        self._log_scale = np.float32(1.0 / math.log1p(robot.lidar.max_range_m / self.config.near_m))
        self._inverse_near = np.float32(1.0 / self.config.near_m)
        steps = self.config.history_steps
        self._motion = motion_cue(robot, sectors, steps) if steps > 0 else None

    @property
    def size(self) -> int:
        """D, the length of an observation."""
        cues = self.config.num_sectors if self._motion is not None else 0
        return self.config.num_sectors + GOAL_FEATURES + TWIST_FEATURES + ACTION_FEATURES + cues

    @property
    def extent_m(self) -> F32:
        """(S,) distance from the LiDAR to the footprint's edge in the middle of each sector."""
        return self._extent

    @property
    def beams_of_sectors(self) -> NDArray[np.int32]:
        """(S, L) numbers of the beams in each sector, some more than once; num_beams where there is none."""
        parts = np.split(self._order, self._first[1:])
        table = np.full((self.config.num_sectors, max(map(len, parts))), self.robot.lidar.num_beams, np.int32)
        for sector, beams in zip(self._covered, parts, strict=True):
            table[sector] = np.resize(beams, table.shape[1])
        return table

    @property
    def mirror(self) -> Mirror | None:
        """Left for right; None for a robot whose body or LiDAR is not symmetric."""
        sectors, lidar = self.config.num_sectors, self.robot.lidar
        angles = np.sort(np.remainder(lidar.angles_rad + 1e-9, 2.0 * math.pi))
        mirrored = np.sort(np.remainder(-lidar.angles_rad + 1e-9, 2.0 * math.pi))
        centred = lidar.mount_y_m == 0.0 and lidar.mount_yaw_rad == 0.0
        if not (centred and np.allclose(angles, mirrored) and np.allclose(self._extent, self._extent[::-1])):
            return None
        order, sign = np.arange(self.size), np.ones(self.size, np.float32)
        order[:sectors] = order[:sectors][::-1]
        order[sectors + 8 :] = order[sectors + 8 :][::-1]  # motion cues
        sign[[sectors + 1, sectors + 5, sectors + 7]] = -1.0  # the goal's y, both yaw rates
        return Mirror(order, sign)

    @property
    def limit(self) -> float:
        """No number of a simulated observation is further from 0: robots drive below twice the speed told."""
        return 2.0 * max(1.0, -self.robot.min_speed_mps / self.robot.max_speed_mps)

    def encode(
        self, ranges: F32, goal: Array, twist: Array, last_action: F32, history: ScanHistory | None = None
    ) -> F32:
        """Encode N robots.

        ranges (N, K) metres; goal (N, 2) metres, in the robot's frame; twist (N, 2) m/s, rad/s; last_action
        (N, 2). Each sector: 0 at contact, just below 1 at the LiDAR's greatest range, logarithmic between. A
        sector no beam falls in reads the greatest range. history: of the same scans, its newest being ranges; only
        motion cues need it.
        """
        sectors = self.config.num_sectors
        out = np.empty((len(ranges), self.size), dtype=np.float32)
        scan = out[:, :sectors]
        scan[:] = self.robot.lidar.max_range_m
        scan[:, self._covered] = np.minimum.reduceat(ranges.take(self._order, axis=1), self._first, axis=1)
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
        out[:, sectors + 6 : sectors + 8] = last_action
        if self._motion is not None:
            if history is None:
                raise ValueError("an encoder with motion cues needs the history of the scans")
            out[:, sectors + 8 :] = history.cues(self._motion, sectors)
        return out


def in_robot_frame(pose: Array, points: Array) -> Array:
    """(N, 3) poses, (N, 2) points in the world -> (N, 2) as the robots see them: x ahead, y to the left."""
    offset = points - pose[:, :2]
    cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    return np.stack(
        [cos * offset[:, 0] + sin * offset[:, 1], cos * offset[:, 1] - sin * offset[:, 0]], axis=1
    )


def to_twist(action: F32, robot: RobotConfig) -> Array:
    """(N, 2) actions in [-1, 1] -> (N, 2) commands: speed, from min_speed to max_speed, and yaw rate."""
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


def footprint_extent(robot: RobotConfig, angles: Array) -> Array:
    """(S,) distance from the LiDAR to the footprint's edge along each angle; 0 for a LiDAR outside of it."""
    mount = np.array([robot.lidar.mount_x_m, robot.lidar.mount_y_m])
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    if robot.radius_m is not None:
        # |mount + reach * direction| = radius
        ahead = directions @ mount
        reach = np.sqrt(np.maximum(ahead**2 + robot.radius_m**2 - mount @ mount, 0.0)) - ahead
        return np.maximum(reach, 0.0) if math.hypot(*mount) < robot.radius_m else np.zeros(len(angles))
    corners = robot.polygon
    edges = np.roll(corners, -1, axis=0) - corners
    normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1)  # outward, for counter-clockwise corners
    offsets = (normals * (corners - mount)).sum(axis=1)
    along = directions @ normals.T
    with np.errstate(divide="ignore"):
        reach = np.where(along > 1e-12, offsets / along, np.inf)
    return reach.min(axis=1) if (offsets > 0.0).all() else np.zeros(len(angles))
