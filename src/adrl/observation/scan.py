"""The scan as sectors: how near the nearest thing is in each, from the footprint's edge, on a logarithmic scale."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from adrl import _core
from adrl.observation.component import F32, Mirror, Senses
from adrl.observation.config import EncoderConfig
from adrl.types import Array, RobotConfig


class BeamsOfSectors:
    """Which beams of one LiDAR point into each of S sectors about the robot."""

    def __init__(self, robot: RobotConfig, centres: Array) -> None:
        """centres: (S,) middle of each sector, in the robot's frame."""
        self._num_beams = robot.lidar.num_beams
        angles = robot.lidar.angles_rad + robot.lidar.mount_yaw_rad
        # A beam on the border of two sectors is in both: a mirrored scan gives mirrored sectors.
        away = np.abs(np.remainder(angles - centres[:, None] + math.pi, 2.0 * math.pi) - math.pi)  # (S, K)
        within = away <= math.pi / len(centres) + 1e-9
        self._beams = np.nonzero(within)[1].astype(np.int32)
        self._first = np.concatenate([[0], np.cumsum(within.sum(axis=1))]).astype(np.int32)
        self.native = _core.SectorTable(self._beams, self._first, self._num_beams, robot.lidar.max_range_m)

    @property
    def table(self) -> NDArray[np.int32]:
        """(S, L) numbers of the beams in each sector, some more than once; num_beams where there is none."""
        parts = np.split(self._beams, self._first[1:-1])
        table = np.full((len(parts), max(map(len, parts))), self._num_beams, np.int32)
        for row, beams in zip(table, parts, strict=True):
            if len(beams) > 0:
                row[:] = np.resize(beams, len(row))
        return table


class Scan:
    """num_sectors numbers: 0 at contact, just below 1 at the greatest range, logarithmic between.

    The greatest range is the LiDAR's, or reach_m, which is then that of all robots. A sector no beam falls in reads it.
    """

    def __init__(self, robots: Sequence[RobotConfig], config: EncoderConfig) -> None:
        self._robots = robots
        self.size = config.num_sectors
        self.limit = 1.0
        centres = -math.pi + (np.arange(self.size, dtype=np.float64) + 0.5) * (2.0 * math.pi / self.size)
        self.angles_rad: Array = centres
        """(S,) middle of each sector, in the robot's frame."""
        self.beams = [BeamsOfSectors(robot, centres) for robot in robots]
        """Of each robot."""
        self._sectors = _core.Sectors([beams.native for beams in self.beams])
        self.extent_m: F32 = np.stack([footprint_extent(robot, centres) for robot in robots]).astype(
            np.float32
        )
        """(R, S) distance from each robot's LiDAR to its footprint's edge in the middle of each sector."""
        scales = [1.0 / math.log1p(config.reach_of(robot) / config.near_m) for robot in robots]
        self._log_scale = np.array(scales, np.float32)[:, None]
        self._config = config
        self._own_reach = np.array([robot.lidar.max_range_m for robot in robots], np.float32)[:, None]
        self._inverse_near = np.float32(1.0 / config.near_m)

    def write(self, senses: Senses, out: F32) -> None:
        """Fill (N, S)."""
        nearest = np.empty((len(senses.kind), self.size), np.float32)
        self._sectors.nearest(senses.kind, np.ascontiguousarray(senses.ranges, np.float32), nearest)
        if self._config.reach_m is not None:
            nearest[nearest >= self._own_reach[senses.kind]] = np.inf
            np.minimum(nearest, np.float32(self._config.reach_m), out=nearest)
        nearest -= self.extent_m[senses.kind]
        np.maximum(nearest, 0.0, out=nearest)
        nearest *= self._inverse_near
        np.log1p(nearest, out=nearest)
        np.multiply(nearest, self._log_scale[senses.kind], out=out)

    def mirror(self) -> Mirror | None:
        """The sectors in reverse, where bodies and LiDARs are symmetric, or where the policy is told of them: as the
        mirrored robot's."""
        if not self._config.body and not all(map(self._is_symmetric, self._robots, self.extent_m)):
            return None
        return Mirror(np.arange(self.size)[::-1], np.ones(self.size, np.float32))

    @staticmethod
    def _is_symmetric(robot: RobotConfig, extent_m: F32) -> bool:
        lidar = robot.lidar
        angles = np.sort(np.remainder(lidar.angles_rad + 1e-9, 2.0 * math.pi))
        mirrored = np.sort(np.remainder(-lidar.angles_rad + 1e-9, 2.0 * math.pi))
        centred = lidar.mount_y_m == 0.0 and lidar.mount_yaw_rad == 0.0
        return centred and np.allclose(angles, mirrored) and np.allclose(extent_m, extent_m[::-1])


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
