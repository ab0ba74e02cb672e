"""Whether scans and odometry tell of the same motion: scans that are late, frozen, or of a LiDAR mounted otherwise.

A scan is laid over an earlier one, moved as odometry says. If another motion lays it better, again and again, then that
is what happened: the motion of some time ago (the scan is late), none (it is frozen), or the same one seen by a LiDAR
that is turned or mirrored. A robot at rest, and surroundings that look alike from everywhere, tell nothing, and accuse
nobody.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from adrl import _core
from adrl.deploy.evidence import Evidence
from adrl.deploy.lidar import readings
from adrl.deploy.messages import Pose, Reason, Scan
from adrl.geometry import compose, inverse
from adrl.types import Array, RobotConfig

LATES = (0, 1, 2, 3, 4, -1, -2)
"""Control periods that scans are looked for to be late by; below 0 it is the odometry that is."""
BACK_S = (0.3, 0.8)
"""A scan is compared with those of about so long ago."""
SCALE_M = 0.1
"""Where a point lies so far off its surface, or farther, it fits no more."""
NOISE_STDS = 4.0
"""The same in standard deviations of the LiDAR's noise, if that is more."""
POINTS, FEWEST = 90, 12
"""Points of a scan that are compared, about; fewer than this tell nothing."""
APART_M, APART_RAD = 0.01, 0.01
"""Motions nearer to each other than this are not told apart."""
SLACK, MOST, ENOUGH = 0.04, 0.3, 1.0
"""Of Evidence. MOST is what two scans can have to say: it takes several."""
DOUBT = 0.1
"""Of ENOUGH: from here on a scan adds to what is known of the surroundings, but takes nothing away."""
SURE = 3.0
"""Evidence for the mount as configured after which others are not considered any more."""
HELD_S, LONGEST_HELD_S = 1.0, 30.0
"""The robot stands so long for a frozen scan before it tries it again, twice as long each time in a row."""
TURNS_RAD = (0.0, 0.5 * math.pi, math.pi, -0.5 * math.pi)


@dataclass(frozen=True, eq=False)
class _Past:
    """A scan, and where odometry says the robot was then, and so many periods earlier as LATES has."""

    scan: Scan
    ranges: Array
    poses: tuple[Pose, ...]
    late: int
    """Number in LATES of what was believed."""


class Alignment:
    """Of one robot's scans with its odometry. Poses are of the robot in the odometry's frame."""

    def __init__(self, robot: RobotConfig, mount: Pose, *, zero_is_free: bool) -> None:
        self._mount = mount
        self._period_s = robot.control_period_s
        self._zero_is_free = zero_is_free
        self._scale_m = max(SCALE_M, NOISE_STDS * robot.lidar.noise_std_m)
        # late since then, by each of LATES; late before as well, by each; frozen; other mounts
        self._frozen = 2 * len(LATES)
        self._mounts = [(turn, mirrored) for mirrored in (False, True) for turn in TURNS_RAD][1:]
        self._evidence = Evidence(self._frozen + 1 + len(self._mounts), slack=SLACK, most=MOST, enough=ENOUGH)
        self._mount_sure = 0.0
        self._mounted_otherwise = False
        self.forget()

    def forget(self) -> None:
        """The odometry's frame is another now."""
        self._past: deque[_Past] = deque()
        self._evidence.forget()
        self._late = 0
        self._held_until_s = -math.inf
        self._held_s = HELD_S
        self._alive = 0.0
        """Evidence against a frozen scan, since the last one was."""

    @property
    def late_s(self) -> float:
        """Seconds by which scans are older than their stamps say; below 0: odometry is."""
        return LATES[self._late] * self._period_s

    @property
    def doubtful(self) -> bool:
        """Whether there is a suspicion, or more than one, against the newest scan."""
        return bool(self._evidence.sums.max() > DOUBT) or self._held_s > HELD_S

    def reasons(self, now_s: float) -> tuple[Reason, ...]:
        """To stand."""
        if self._mounted_otherwise:
            return ("mount",)
        return ("scan_frozen",) if now_s < self._held_until_s else ()

    def take(self, scan: Scan, pose_at: Callable[[float], Pose], base_late_s: float) -> Scan | None:
        """A new scan, and where odometry says the robot was at a time. base_late_s: odometry is no later than the base
        seems to be. If the scan is found to be frozen: the scan of before that, as far as it is still known."""
        ranges, told = readings(scan, zero_is_free=self._zero_is_free)
        ranges = np.where(told, ranges, np.nan)
        lates_s = [late * self._period_s for late in LATES]
        poses = tuple(pose_at(scan.stamp_s - (s if s > -base_late_s - 1e-6 else 0.0)) for s in lates_s)
        new = _Past(scan, ranges, poses, self._late)
        while self._past and self._past[0].scan.stamp_s < scan.stamp_s - BACK_S[-1] - self._period_s:
            self._past.popleft()
        found = None
        for past in self._compared(scan.stamp_s):
            found = self._compare(new, past)
            if found is not None:
                break
        if found is None:
            self._past.append(new)
            return None
        oldest = self._past[0].scan
        self._conclude(found, scan.stamp_s)
        return oldest if found == self._frozen else None

    def _compared(self, stamp_s: float) -> list[_Past]:
        """The scans of about BACK_S ago."""
        chosen: list[_Past] = []
        for back_s in BACK_S:
            old = [
                past for past in self._past if past.scan.stamp_s <= stamp_s - back_s + 0.5 * self._period_s
            ]
            if old and not (chosen and chosen[-1] is old[-1]):
                chosen.append(old[-1])
        return chosen

    def _compare(self, new: _Past, past: _Past) -> int | None:
        """Weigh two scans; the number of the explanation that has to be believed from now on, None for none."""
        belief = between(past.poses[past.late], new.poses[self._late])
        motions = [between(past.poses[past.late], pose) for pose in new.poses]
        motions += [between(*pair) for pair in zip(past.poses, new.poses, strict=True)]
        motions.append((0.0, 0.0, 0.0))
        seen = [self._seen(motion) for motion in [belief, *motions]]
        if self._mount_sure < SURE:
            seen += [self._seen(belief, *mount) for mount in self._mounts]
        rows = np.array(seen)
        apart = (np.hypot(*(rows[:, :2] - rows[0, :2]).T) > APART_M) | (
            np.abs(np.remainder(rows[:, 2] - rows[0, 2] + math.pi, 2.0 * math.pi) - math.pi) > APART_RAD
        )
        if not apart.any():
            return None
        apart[0] = True
        fit = _core.misfits(
            new.ranges,
            _fan(new.scan),
            past.ranges,
            _fan(past.scan),
            rows[apart],
            self._scale_m,
            self._stride(new),
        )
        if fit[:, 1].min() < FEWEST:
            return None
        misfit = np.full(1 + len(self._evidence.sums), fit[0, 0])
        misfit[: len(rows)][apart] = fit[:, 0]
        mounts = misfit[-len(self._mounts) :]
        if len(rows) == len(misfit):
            self._mount_sure = max(0.0, self._mount_sure + float(mounts.min()) - misfit[0] - SLACK)
        self._alive = max(0.0, self._alive + misfit[1 + self._frozen] - misfit[0] - SLACK)
        if self._alive > ENOUGH:
            self._held_s = HELD_S
        return self._evidence.add(float(misfit[0]), misfit[1:])

    def _conclude(self, found: int, stamp_s: float) -> None:
        if found < self._frozen:
            self._late = found % len(LATES)
        elif found == self._frozen:
            self._held_until_s = stamp_s + self._held_s
            self._held_s = min(2.0 * self._held_s, LONGEST_HELD_S)
            self._alive = 0.0
        else:
            self._mounted_otherwise = True
        self._past.clear()
        self._evidence.forget()

    def _seen(self, motion: Pose, turn_rad: float = 0.0, mirrored: bool = False) -> Pose:
        """A motion of the robot as one of its LiDAR, if that is turned from where it should be, or mirrored."""
        x, y, yaw = self._mount
        sensor = (x, y, yaw + turn_rad)
        x, y, yaw = between(sensor, compose(motion, sensor))
        return (x, -y, -yaw) if mirrored else (x, y, yaw)

    def _stride(self, past: _Past) -> int:
        return max(1, len(past.ranges) // POINTS)


def _fan(scan: Scan) -> tuple[float, float, float]:
    return scan.angle_min_rad, scan.angle_increment_rad, scan.range_max_m


def between(a: Pose, b: Pose) -> Pose:
    """Pose b in the frame of pose a."""
    return compose(inverse(a), b)
