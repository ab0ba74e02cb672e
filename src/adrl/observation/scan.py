"""The scan as sectors: how near the nearest thing is in each, from the footprint's edge, on a logarithmic scale."""

import math

import numpy as np
from numpy.typing import NDArray

from adrl.observation.component import F32, Mirror, Senses
from adrl.observation.config import EncoderConfig
from adrl.types import Array, RobotConfig


class Scan:
    """num_sectors numbers: 0 at contact, just below 1 at the LiDAR's greatest range, logarithmic between.

    A sector no beam falls in reads the greatest range.
    """

    def __init__(self, robot: RobotConfig, config: EncoderConfig) -> None:
        self._robot = robot
        self.size = config.num_sectors
        self.limit = 1.0
        angles = robot.lidar.angles_rad + robot.lidar.mount_yaw_rad
        width = 2.0 * math.pi / self.size
        centres = -math.pi + (np.arange(self.size, dtype=np.float64) + 0.5) * width
        self.angles_rad: Array = centres
        """(S,) middle of each sector, in the robot's frame."""
        # A beam on the border of two sectors is in both: a mirrored scan gives mirrored sectors.
        away = np.abs(np.remainder(angles - centres[:, None] + math.pi, 2.0 * math.pi) - math.pi)  # (S, K)
        sector, self._order = np.nonzero(away <= 0.5 * width + 1e-9)
        self._covered, self._first = np.unique(sector, return_index=True)
        self.extent_m: F32 = footprint_extent(robot, centres).astype(np.float32)
        """(S,) distance from the LiDAR to the footprint's edge in the middle of each sector."""
        self._log_scale = np.float32(1.0 / math.log1p(robot.lidar.max_range_m / config.near_m))
        self._inverse_near = np.float32(1.0 / config.near_m)

    @property
    def beams_of_sectors(self) -> NDArray[np.int32]:
        """(S, L) numbers of the beams in each sector, some more than once; num_beams where there is none."""
        parts = np.split(self._order, self._first[1:])
        table = np.full((self.size, max(map(len, parts))), self._robot.lidar.num_beams, np.int32)
        for sector, beams in zip(self._covered, parts, strict=True):
            table[sector] = np.resize(beams, table.shape[1])
        return table

    def write(self, senses: Senses, out: F32) -> None:
        """Fill (N, S)."""
        out[:] = self._robot.lidar.max_range_m
        nearest = np.minimum.reduceat(senses.ranges.take(self._order, axis=1), self._first, axis=1)
        out[:, self._covered] = nearest
        out -= self.extent_m
        np.maximum(out, 0.0, out=out)
        out *= self._inverse_near
        np.log1p(out, out=out)
        out *= self._log_scale

    def mirror(self) -> Mirror | None:
        """The sectors in reverse, where body and LiDAR are symmetric."""
        lidar = self._robot.lidar
        angles = np.sort(np.remainder(lidar.angles_rad + 1e-9, 2.0 * math.pi))
        mirrored = np.sort(np.remainder(-lidar.angles_rad + 1e-9, 2.0 * math.pi))
        centred = lidar.mount_y_m == 0.0 and lidar.mount_yaw_rad == 0.0
        if not (
            centred and np.allclose(angles, mirrored) and np.allclose(self.extent_m, self.extent_m[::-1])
        ):
            return None
        return Mirror(np.arange(self.size)[::-1], np.ones(self.size, np.float32))


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
