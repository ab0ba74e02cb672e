"""Any LiDAR, as the one a policy was trained with would see it."""

import math

import numpy as np
from numpy.typing import NDArray

from adrl.deploy.messages import Pose, Scan
from adrl.types import Array, LidarConfig

F32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

HOLE_RAD = 0.2
"""Between beams farther apart than this nothing is known: such directions read the greatest range."""
CONTIGUOUS = 0.15
"""Neighbouring beams whose ranges differ by a smaller part are on one surface, and it is straight between them."""


def readings(scan: Scan) -> tuple[Array, Mask]:
    """(K,) ranges in metres, infinity where nothing is within reach, and (K,) which beams tell anything."""
    ranges = np.where(np.isneginf(scan.ranges), max(scan.range_min_m, 1e-3), scan.ranges)
    told = (ranges > 0.0) & (ranges >= scan.range_min_m)  # not NaN either
    # As training compares them: in float32, which messages have too. A hit just within reach is a hit.
    free = ranges.astype(np.float32) >= np.float32(scan.range_max_m)
    return np.where(told & ~free, ranges, np.inf), told


def beam_angles(scan: Scan) -> Array:
    """(K,) angles of the beams in the sensor's frame."""
    return scan.angle_min_rad + scan.angle_increment_rad * np.arange(len(scan.ranges), dtype=np.float64)


def beam_towards(scan: Scan, bearings: Array) -> NDArray[np.intp]:
    """(M,) numbers of the beams that look nearest to directions in the sensor's frame; -1 where none does."""
    along = math.copysign(1.0, scan.angle_increment_rad) * (bearings - scan.angle_min_rad)
    beam = np.rint(np.remainder(along, 2.0 * math.pi) / abs(scan.angle_increment_rad)).astype(np.intp)
    count = len(scan.ranges)
    return beam % count if sees_all_round(scan) else np.where(beam < count, beam, -1)


def sees_all_round(scan: Scan) -> bool:
    """Whether its beams go round the full circle."""
    return (len(scan.ranges) + 0.5) * abs(scan.angle_increment_rad) > 2.0 * math.pi


def widest_hole_rad(scan: Scan, told: Mask) -> float:
    """The widest run of beams that tell nothing, as an angle; round the back for a full circle."""
    numbers = np.flatnonzero(told)
    around = (numbers[-1] - len(told), numbers[0] + len(told))
    ends = around if sees_all_round(scan) else (-1, len(told))
    runs = np.diff(np.concatenate([ends[:1], numbers, ends[1:]])) - 1
    return float(runs.max()) * abs(scan.angle_increment_rad)


class LidarAdapter:
    """Resamples scans of a real LiDAR to the beams of the LiDAR a policy was trained with."""

    def __init__(self, trained: LidarConfig, mount: Pose | None = None) -> None:
        """mount: of the real LiDAR in the robot's frame; that of the trained one when None."""
        self.trained = trained
        self.mount = mount or trained.mount
        c, s = math.cos(trained.mount_yaw_rad), math.sin(trained.mount_yaw_rad)
        dx, dy = self.mount[0] - trained.mount_x_m, self.mount[1] - trained.mount_y_m
        self._offset = (c * dx + s * dy, c * dy - s * dx)  # of the real sensor in the trained one's frame
        self._turn = self.mount[2] - trained.mount_yaw_rad
        self._angles = np.remainder(trained.angles_rad, 2.0 * math.pi)

    def __call__(self, scan: Scan) -> F32:
        """(K,) ranges of the trained beams.

        Between two beams on one surface that surface is met; at its rim the beam nearer in angle counts. Of a denser
        scan, what stands out before the surface within half a trained beam is not lost. A LiDAR of shorter reach
        sees free space beyond it; directions that it does not cover read the greatest range.
        """
        ranges, told = readings(scan)
        angles, ranges = self._in_trained_frame(beam_angles(scan)[told], ranges[told])
        out = np.full(self.trained.num_beams, np.inf)
        if len(ranges) > 0:
            out = _interpolate(angles, ranges, self._angles)
            if abs(scan.angle_increment_rad) < 0.75 * self.trained.angle_increment_rad:
                self._take_nearest(out, angles, ranges)
        return np.minimum(out, self.trained.max_range_m).astype(np.float32)

    def _in_trained_frame(self, angles: Array, ranges: Array) -> tuple[Array, Array]:
        """Directions in [0, 2 pi) in ascending order, and distances; free beams keep their direction."""
        angles = angles + self._turn
        if self._offset != (0.0, 0.0):
            hit = np.isfinite(ranges)
            x = self._offset[0] + ranges[hit] * np.cos(angles[hit])
            y = self._offset[1] + ranges[hit] * np.sin(angles[hit])
            angles[hit], ranges[hit] = np.arctan2(y, x), np.hypot(x, y)
        angles = np.remainder(angles, 2.0 * math.pi)
        order = np.argsort(angles, kind="stable")
        return angles[order], ranges[order]

    def _take_nearest(self, out: Array, angles: Array, ranges: Array) -> None:
        beam = np.remainder(angles - self._angles[0], 2.0 * math.pi) / self.trained.angle_increment_rad
        number = np.rint(beam).astype(np.intp)
        if self.trained.fov_rad >= 2.0 * math.pi - 1e-9:
            number %= self.trained.num_beams
        inside = (np.abs(beam - np.rint(beam)) < 0.499) & (number < self.trained.num_beams)
        nearest = np.full(len(out), np.inf)
        np.minimum.at(nearest, number[inside], ranges[inside])
        # On a slanted wall the beam's own range is the truth; a post before it must not be lost.
        np.copyto(out, nearest, where=nearest < out / (1.0 + CONTIGUOUS))


def _interpolate(angles: Array, ranges: Array, wanted: Array) -> Array:
    """(J,) ranges at wanted angles from (K,) beams in ascending order, all angles in [0, 2 pi)."""
    angles = np.concatenate([angles[-1:] - 2.0 * math.pi, angles, angles[:1] + 2.0 * math.pi])
    ranges = np.concatenate([ranges[-1:], ranges, ranges[:1]])
    right = np.clip(np.searchsorted(angles, wanted, side="right"), 1, len(angles) - 1)
    gap = angles[right] - angles[right - 1]
    share = (wanted - angles[right - 1]) / np.maximum(gap, 1e-9)
    before, after = ranges[right - 1], ranges[right]
    out = np.where(share < 0.5, before, after)
    near, far = np.minimum(before, after), np.maximum(before, after)
    joined = np.isfinite(far) & (far < (1.0 + CONTIGUOUS) * near)
    # A straight wall d away is met at d / cos(angle): the inverse of the range is all but linear.
    with np.errstate(divide="ignore"):
        inverse = (1.0 - share) / before + share / after
        out = np.where(joined, 1.0 / inverse, out)
    # A hole's rim still belongs to the beam there.
    alone = np.minimum(share, 1.0 - share) * gap > 0.5 * HOLE_RAD
    return np.where((gap > HOLE_RAD) & alone, np.inf, out)
