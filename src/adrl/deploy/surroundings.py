"""What stands about a robot, as its LiDAR has lately seen it: also where it does not look now, or tells nothing."""

import math

import numpy as np
from numpy.typing import NDArray

from adrl.deploy.lidar import beam_angles, beam_towards, readings, sees_all_round, widest_hole_rad
from adrl.deploy.messages import Pose, Scan
from adrl.deploy.tracks import Tracks
from adrl.geometry import compose, in_robot_frame, in_world_frame
from adrl.types import Array, RobotConfig

Mask = NDArray[np.bool_]

LASTS_S = 30.0
"""What no scan tells of any more is forgotten after this time: it may have gone, and odometry drifts."""
MOVING_LASTS_S = 1.0
"""The same of what moved."""
MOVING_M = 0.1
"""More clearance is kept of what moves, unless more of a body is: where it will be is not known as well."""
BODY_M = 0.35
"""Half the breadth to reckon with of who walks: a LiDAR near the floor sees legs, which are within it."""
NEAR_M = 1.0
"""Least distance from the robot within which that is remembered."""
CELL_M = 0.02
"""Of what is remembered, points nearer to each other are one."""


class Surroundings:
    """Hits in the odometry's frame, each with the clearance to keep of it.

    clearance: margin_m, and half the way at that range to the next beams that tell something: no surface hides between
    two hits; of who walks, or has, also the body about the legs. Hits within the footprint are the robot's own body,
    and are none.
    """

    def __init__(self, robot: RobotConfig, mount: Pose, *, margin_m: float, largest_hole_rad: float) -> None:
        self._robot, self._mount = robot, mount
        self._margin_m, self._largest_hole_rad = margin_m, largest_hole_rad
        self._near_m = robot.circumscribed_radius_m + max(NEAR_M, _stopping_m(robot))
        self.forget()

    def forget(self) -> None:
        """The odometry's frame is another now."""
        self._newest: Array = np.empty((0, 4))
        self._former: Array = np.empty((0, 4))
        """(M, 4) x, y, clearance, and until when it is remembered: of the last scan, and, near the robot, of the one
        before."""
        self._lasting: Array = np.empty((0, 4))
        """(M, 4) of what the last scan tells nothing of."""
        self._tracks = Tracks()
        self._velocity: Array = np.empty((0, 2))
        """(M, 2) of the last scan's hits; 0 of what stands."""
        self._beyond_m: Array = np.empty(0)
        """(M,) by how much the bodies of these reach beyond the hits."""
        self._taken_s = -math.inf
        self._looking: tuple[Scan, Mask] | None = None
        """The last scan, and which of its beams tell of something else than the robot itself."""
        self._trusted = self._newest, self._former, self._lasting, self._velocity, self._beyond_m
        """As it was before a suspicion."""

    def take(self, scan: Scan, first: Pose, last: Pose, *, late_s: float = 0.0, clears: bool = True) -> None:
        """A new scan; where the robot was when its first and its last beam were taken. late_s: by which it is older
        than it says. clears: False for a scan under suspicion, for which nothing that was known is given up."""
        ranges, told = readings(scan)
        too_near = (scan.ranges > 0.0) & (scan.ranges < scan.range_min_m)
        ranges = np.where(too_near, scan.ranges, ranges)
        nearer = np.isneginf(
            scan.ranges
        )  # than range_min_m: where an earlier scan has seen it, or it may touch
        if self._looking is None and nearer.any():
            ranges = np.where(nearer, self._leaving_m(scan), ranges)
        points = self._on_robot(scan, ranges)
        own = self._robot.covers(points)
        outside = told & ~own
        hit = (told | too_near) & np.isfinite(ranges) & ~own
        clearance = self._margin_m + self._gap_rad(scan, told | too_near)[hit] * ranges[hit]
        self._former = self._newest[self._is_near(self._newest, last)]
        self._lasting = self._untold(scan, outside & ~nearer & clears, last)
        turn = math.remainder(last[2] - first[2], 2.0 * math.pi)
        way = np.array([last[0] - first[0], last[1] - first[1], turn])
        poses = np.array(first) + np.linspace(0.0, 1.0, len(ranges))[hit, None] * way
        places = in_world_frame(poses, points[hit])
        self._velocity, breadth_m = self._tracks.take(scan, compose(last, self._mount), hit, places)
        self._beyond_m = np.maximum(BODY_M - 0.5 * breadth_m, 0.0)
        self._taken_s = scan.stamp_s - late_s
        lasts_s = np.where(self._velocity.any(axis=1), MOVING_LASTS_S, LASTS_S)
        self._newest = np.column_stack([places, clearance + self._beyond_m, scan.stamp_s + lasts_s])
        self._looking = (scan, outside)
        if clears:
            self._trusted = self._newest, self._former, self._lasting, self._velocity, self._beyond_m

    def revert(self) -> None:
        """The scans under suspicion were wrong."""
        self._newest, self._former, self._lasting, self._velocity, self._beyond_m = self._trusted

    def sees_ahead(self) -> bool:
        """Whether the last scan looks straight ahead."""
        if self._looking is None:
            return False
        return bool(beam_towards(self._looking[0], np.array([-self._mount[2]]))[0] >= 0)

    def sees_behind(self) -> bool:
        """Whether the last scan looks all round, past the robot's own body."""
        if self._looking is None:
            return False
        scan, outside = self._looking
        whole = sees_all_round(scan) and bool(outside.any())
        return whole and widest_hole_rad(scan, outside) <= self._largest_hole_rad

    def seen_from(self, pose: Pose) -> Array:
        """(M, 3) x, y in the frame of a robot at a pose, and the clearance to keep.

        What the last scan but one hit is not to be hit, without a margin: a beam that fails for one scan does not open
        the way.
        """
        former = self._former - (0.0, 0.0, self._margin_m, 0.0)
        known = np.concatenate([former, self._newest, self._lasting])
        return np.column_stack([in_robot_frame(np.array(pose), known), known[:, 2]])

    def moving_from(self, pose: Pose, time_s: float) -> Array:
        """(K, 6) what moves, in the frame of a robot that is at a pose at some time: x, y and clearance as it was
        seen, its velocity, and the seconds from then to that time."""
        moves = self._velocity.any(axis=1)
        if not moves.any():
            return np.empty((0, 6))
        known, velocity = self._newest[moves], self._velocity[moves]
        turned = in_robot_frame(np.array([0.0, 0.0, pose[2]]), velocity)
        age_s = np.full(len(known), max(time_s - self._taken_s, 0.0))
        clearance = known[:, 2] + np.maximum(MOVING_M - self._beyond_m[moves], 0.0)
        return np.column_stack([in_robot_frame(np.array(pose), known), clearance, turned, age_s])

    def still_from(self, pose: Pose) -> Array:
        """(M, 3) as seen_from, without what moves."""
        known = np.concatenate([self._newest[~self._velocity.any(axis=1)], self._lasting])
        return np.column_stack([in_robot_frame(np.array(pose), known), known[:, 2]])

    def _on_robot(self, scan: Scan, ranges: Array) -> Array:
        """(K, 2) in the robot's frame; infinite where nothing is hit."""
        angles = beam_angles(scan) + self._mount[2]
        far = np.where(np.isfinite(ranges), ranges, 1e9)
        return np.stack(
            [self._mount[0] + far * np.cos(angles), self._mount[1] + far * np.sin(angles)], axis=1
        )

    def _leaving_m(self, scan: Scan) -> Array:
        """(K,) range at which each beam leaves the footprint, or range_min_m where that comes first."""
        inner, outer = np.zeros(len(scan.ranges)), np.full(len(scan.ranges), max(scan.range_min_m, 1e-3))
        for _ in range(12):
            middle = 0.5 * (inner + outer)
            within = self._robot.covers(self._on_robot(scan, middle))
            inner, outer = np.where(within, middle, inner), np.where(within, outer, middle)
        return outer

    def _gap_rad(self, scan: Scan, told: Mask) -> Array:
        """(K,) half the angle to the farther of the next beams on both sides that tell something, where told."""
        out = np.zeros(len(told))
        numbers = np.flatnonzero(told)
        if len(numbers) == 0:
            return out
        ends = (numbers[-1] - len(told), numbers[0] + len(told))
        if not sees_all_round(scan):
            ends = (numbers[0] - 1, numbers[-1] + 1)
        gaps = np.diff(np.concatenate([ends[:1], numbers, ends[1:]])) * abs(scan.angle_increment_rad)
        widest = np.maximum(gaps[:-1], gaps[1:])
        out[numbers] = 0.5 * np.minimum(widest, max(self._largest_hole_rad, abs(scan.angle_increment_rad)))
        return out

    def _is_near(self, points: Array, pose: Pose) -> Mask:
        """(M,) which points a robot there has to remember."""
        return np.hypot(points[:, 0] - pose[0], points[:, 1] - pose[1]) < self._near_m

    def _untold(self, scan: Scan, tells: Mask, pose: Pose) -> Array:
        """(M, 4) of what was known, near and not too old: what a scan tells nothing of, the newest of each place."""
        known = np.concatenate([self._former, self._lasting[self._is_near(self._lasting, pose)]])
        known = known[known[:, 3] > scan.stamp_s]
        x, y = in_robot_frame(np.array(pose), known).T
        bearings = np.arctan2(y - self._mount[1], x - self._mount[0]) - self._mount[2]
        untold = known[~_in_view(scan, tells, bearings)]
        x, y = np.rint(untold[:, :2].T / CELL_M).astype(np.int64)
        _, first = np.unique((x << 32) + y, return_index=True)
        return untold[first]


def _in_view(scan: Scan, tells: Mask, bearings: Array) -> Mask:
    """(M,) which directions in the sensor's frame a beam that tells something covers."""
    beam = beam_towards(scan, bearings)
    return (beam >= 0) & tells[np.maximum(beam, 0)]


def _stopping_m(robot: RobotConfig) -> float:
    """More than the way that a robot at full speed needs to come to rest."""
    speed = robot.fastest_mps
    reaction_s = robot.latency_s + robot.lag_s + 2.0 * robot.control_period_s
    return speed * reaction_s + 0.5 * speed**2 / robot.max_acceleration_mps2
