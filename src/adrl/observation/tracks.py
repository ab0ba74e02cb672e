"""What moves about a robot, as tracks: clusters of hits followed over the last scans, its own motion taken out."""

import math
from collections.abc import Sequence

import numpy as np

from adrl import _core
from adrl.observation.component import F32, Mirror, Senses, unchanged
from adrl.observation.config import FOLLOWED_STEPS, EncoderConfig
from adrl.types import Array, RobotConfig

NUMBERS = 5
"""Of a track."""
FASTEST_MPS = 2.0
"""Velocities are told in units of this; no track is faster."""


class Tracks:
    """5 numbers of each of the num_tracks nearest things that move, the nearest first; zeros where there are no more.

    How near its middle is, from 1 at the robot's origin to 0 where the scan's scale ends, logarithmic, as a vector
    that points there; velocity over the ground as a vector in units of FASTEST_MPS; and for what part of the scans it
    has been followed. All in the robot's frame. The supervisor follows what moves by the same kernel.
    """

    limit = 1.0

    def __init__(self, robots: Sequence[RobotConfig], config: EncoderConfig) -> None:
        self._num_tracks = config.num_tracks
        self.size = NUMBERS * config.num_tracks
        self._native = _core.NearestTracksOfKinds([_of(robot, config.num_tracks) for robot in robots])
        self._near_m = config.near_m
        self._scale: Array = np.array(
            [math.log1p(config.reach_of(robot) / config.near_m) for robot in robots]
        )
        self._lasts_s: Array = np.array([FOLLOWED_STEPS * robot.control_period_s for robot in robots])

    def write(self, senses: Senses, out: F32) -> None:
        """Fill (N, 5 T). Raises ValueError without the history of the scans."""
        if senses.history is None:
            raise ValueError("an encoder with tracks needs the history of the scans")
        past = senses.history.arrays
        told = np.empty((len(senses.kind), self._num_tracks, NUMBERS), np.float32)
        newest, scans = int(past["newest"][0]), FOLLOWED_STEPS + 1
        self._native.compute(senses.kind, past["past_ranges"], past["past_odometry"], newest, scans, told)
        away = np.hypot(told[..., 0], told[..., 1])
        nearness = 1.0 - np.log1p(away / self._near_m) / self._scale[senses.kind, None]
        told[..., :2] *= (np.maximum(nearness, 0.0) / np.maximum(away, 1e-6))[..., None]
        told[..., 2:4] /= FASTEST_MPS
        told[..., 4] /= self._lasts_s[senses.kind, None]
        np.clip(told.reshape(out.shape), -1.0, 1.0, out=out)

    def mirror(self) -> Mirror | None:
        """y and the velocity's y turn round."""
        places = np.arange(self.size).reshape(-1, NUMBERS)
        return unchanged(self.size, *places[:, [1, 3]].ravel().tolist())


def _of(robot: RobotConfig, num_tracks: int) -> "_core.NearestTracks":
    lidar = robot.lidar
    return _core.NearestTracks(
        lidar.num_beams,
        lidar.angle_min_rad,
        lidar.angle_increment_rad,
        lidar.mount,
        lidar.max_range_m,
        robot.control_period_s,
        num_tracks,
    )
