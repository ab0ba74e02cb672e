"""What moves about a robot: clusters of hits, followed from scan to scan. The robot's own motion is taken out by its
odometry. The policy's tracks (adrl.observation.tracks) are of the same kernel."""

import numpy as np
from numpy.typing import NDArray

from adrl import _core
from adrl.deploy.lidar import readings
from adrl.deploy.messages import Pose, Scan
from adrl.types import Array

Mask = NDArray[np.bool_]


class Tracks:
    """Of the scans of one LiDAR; points and poses are in the odometry's frame."""

    def __init__(self) -> None:
        self._native = _core.Tracker()

    def take(self, scan: Scan, sensor: Pose, hit: Mask, points: Array) -> tuple[Array, Array]:
        """(H, 2) velocities of the hits of a new scan, 0 of what stands; and (H,) m, how broad the cluster of each is
        if it was ever seen to move, else infinity. hit: (K,) beams; points: (H, 2) where. A scan that is no newer than
        the last begins anew."""
        ranges, told = readings(scan)
        seen = np.where(told, np.minimum(ranges, scan.range_max_m), 0.0)
        return self._native.take(
            scan.stamp_s,
            sensor,
            scan.angle_min_rad,
            scan.angle_increment_rad,
            seen,
            np.flatnonzero(hit).astype(np.int32),
            np.ascontiguousarray(points, np.float64),
        )
