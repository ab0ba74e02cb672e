"""What single beams say, held against what was known a scan ago: a scene does not turn empty at once.

A beam that says "nothing within reach", or "nearer than I can measure", where that cannot have come about since the
last scan, is taken to tell nothing. What was known there then still counts.
"""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from adrl.deploy.lidar import beam_angles, beam_towards, readings, sees_all_round
from adrl.deploy.messages import Pose, Scan
from adrl.geometry import compose
from adrl.types import Array

Mask = NDArray[np.bool_]

PEOPLE_MPS = 2.0
"""Nothing that moves about a robot is faster."""
SLACK_M = 0.1
"""Of what may move, for all that poses and angles are not exact."""
WIDTH_M, MOVES_S = 0.6, 0.3
"""Who moves is no wider; what it has left is not expected any more after that time."""
DATED = 2.0
"""Scans may be older or newer than said by so many times the time between two."""
BESIDE = 2
"""Points that were seen from elsewhere do not fall into every beam, but into one of so many beside it."""
AGREES, COMPARED_BEAMS = 0.8, 20
"""A scan that shows this share of what was known, of so many beams or more, where it was known is dated right."""
VANISHED_RAD = 0.25
"""A narrower thing may fall between beams."""
WITHIN_REACH = 0.9
"""Of the greatest range: what was farther away may be out of reach by now."""
LASTS_S = 30.0
"""What has vanished is believed to be gone after this time in which the LiDAR has seen other things."""
COMPARED = 180
"""Hits that are compared with what has vanished, about."""
INSISTS = 3
"""Scans in a row in which a beam says that something is too near, after which it is believed."""


class BeamWatch:
    """Of one LiDAR, whose mount is in the robot's frame; poses are of the robot in the odometry's frame."""

    def __init__(self, mount: Pose) -> None:
        self._mount = mount
        self.forget()

    def forget(self) -> None:
        """The odometry's frame is another now."""
        self._points: Array = np.empty((0, 3))
        """(M, 3) x, y of what is known to stand about, and for how many seconds that has been doubted."""
        self._near: NDArray[np.intp] = np.empty(0, np.intp)
        """(K,) scans in a row in which each beam has said that something is too near."""
        self._last_s, self._sensor = -math.inf, (0.0, 0.0, 0.0)
        self.empty = False
        """Whether the last scan is empty where it cannot be."""

    def believable(self, scan: Scan, pose: Pose) -> Scan:
        """The scan, with NaN for beams that are not believed."""
        sensor = compose(pose, self._mount)
        ranges, told = readings(scan)
        near = np.isneginf(scan.ranges)
        seen = told & np.isfinite(ranges) & ~near
        expected, doubted_s = self._expected(scan, sensor)
        # Things move, and seem to where they are seen a little earlier or later than said.
        passed_s = scan.stamp_s - self._last_s
        off_m = _off_m(ranges, expected)[seen]
        dated = 0.0 if _agree(off_m) else DATED
        moved_m = PEOPLE_MPS * passed_s + SLACK_M + dated * math.dist(sensor[:2], self._sensor[:2])
        turned_rad = dated * abs(math.remainder(sensor[2] - self._sensor[2], 2.0 * math.pi))
        self._last_s, self._sensor = scan.stamp_s, sensor
        lies = near & ~self._may_be_near(scan, near, expected, moved_m)
        known = [self._placed(scan, sensor, seen, ranges, np.zeros(len(ranges)))]
        vanished = told & np.isinf(ranges) & (expected < WITHIN_REACH * scan.range_max_m)
        vanished &= doubted_s < LASTS_S
        self.empty = False
        if np.count_nonzero(vanished) * abs(scan.angle_increment_rad) > VANISHED_RAD:
            doubted_s = doubted_s + (passed_s if seen.any() else 0.0)
            gone = self._placed(scan, sensor, vanished, expected, doubted_s)
            come = known[0][off_m > SLACK_M]  # at other places than before
            stays = vanished.copy()
            stays[vanished] = _far_from(gone, come, WIDTH_M + moved_m + turned_rad * expected[vanished])
            empty = self._empty(scan, stays, seen, expected, moved_m)
            self.empty = bool(empty.any())
            kept = vanished & (empty | (doubted_s < MOVES_S))
            known.append(self._placed(scan, sensor, kept, expected, doubted_s))
            lies |= empty & told & np.isinf(ranges)
        self._points = np.concatenate(known)
        return dataclasses.replace(scan, ranges=np.where(lies, np.nan, scan.ranges)) if lies.any() else scan

    def _expected(self, scan: Scan, sensor: Pose) -> tuple[Array, Array]:
        """(K,) the nearest of what is known along each beam, infinity for nothing; and its seconds of doubt."""
        expected, doubted_s = np.full(len(scan.ranges), np.inf), np.zeros(len(scan.ranges))
        dx, dy = self._points[:, 0] - sensor[0], self._points[:, 1] - sensor[1]
        beam = beam_towards(scan, np.arctan2(dy, dx) - sensor[2])
        inside = beam >= 0
        beam, away = beam[inside], np.hypot(dx, dy)[inside]
        np.minimum.at(expected, beam, away)
        nearest = away <= expected[beam]
        doubted_s[beam[nearest]] = self._points[inside][nearest, 2]
        return expected, doubted_s

    def _may_be_near(self, scan: Scan, near: Mask, expected: Array, moved_m: float) -> Mask:
        """(K,) before which beams something can be that is too near to be measured: it was near, or they insist."""
        if len(self._near) != len(near):  # the first scan: something may be there
            self._near = INSISTS * near.astype(np.intp)
        else:
            self._near = np.where(near, self._near + 1, 0)
        if not near.any():
            return near
        around = np.minimum(np.minimum(np.roll(expected, 1), np.roll(expected, -1)), expected)
        return (around < scan.range_min_m + moved_m) | (self._near >= INSISTS)

    def _empty(self, scan: Scan, vanished: Mask, seen: Mask, expected: Array, moved_m: float) -> Mask:
        """(K,) the beams between two that see something, if more has vanished there than a narrow or a moving thing."""
        increment = abs(scan.angle_increment_rad)
        run = np.cumsum(seen)
        if sees_all_round(scan) and seen.any():
            run = np.where(run == run[-1], 0, run)  # from behind the last one to the first one
        width_m = np.bincount(run, np.where(vanished, expected, 0.0)) * increment
        width_rad = np.bincount(run, vanished) * increment
        cannot = (width_m > moved_m) & (width_rad > VANISHED_RAD)
        return cannot[run] & ~seen

    def _placed(self, scan: Scan, sensor: Pose, beams: Mask, ranges: Array, doubted_s: Array) -> Array:
        """(M, 3) points of some beams in the odometry's frame; ranges and doubted_s are those of all (K,)."""
        angles, ranges = beam_angles(scan)[beams] + sensor[2], ranges[beams]
        x, y = sensor[0] + ranges * np.cos(angles), sensor[1] + ranges * np.sin(angles)
        return np.stack([x, y, doubted_s[beams]], axis=1)


def _off_m(ranges: Array, expected: Array) -> Array:
    """(K,) how far each hit is from what was known along its beam or the ones beside it; infinity where nothing was."""
    near = np.stack([np.roll(expected, shift) for shift in range(-BESIDE, BESIDE + 1)])
    hit = np.where(np.isfinite(ranges), ranges, 0.0)
    return np.abs(near - hit).min(axis=0)


def _agree(off_m: Array) -> bool:
    """Whether hits that are so far from what was known along their beams, infinity for nothing, are where it was."""
    compared = off_m[np.isfinite(off_m)]
    return len(compared) >= COMPARED_BEAMS and float(np.mean(compared <= SLACK_M)) > AGREES


def _far_from(points: Array, others: Array, within_m: Array) -> Mask:
    """(M,) which points (M, 3) have none of the others (L, 3) within a distance (M,)."""
    others = others[:: max(1, len(others) // COMPARED)]
    away_m = np.hypot(points[:, None, 0] - others[:, 0], points[:, None, 1] - others[:, 1])
    return np.all(away_m > within_m[:, None], axis=1)
