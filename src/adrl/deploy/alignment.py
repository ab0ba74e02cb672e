"""Whether scans and odometry tell of the same motion: scans that are late, frozen, or of a LiDAR mounted otherwise.

A scan is laid over an earlier one, moved as odometry says. If another motion lays it better, again and again, then that
is what happened: the motion of some time ago (the scan is late), none (it is frozen), or the same one seen by a LiDAR
that is turned or mirrored. A robot at rest, and surroundings that look alike from everywhere, tell nothing, and accuse
nobody.
"""

import dataclasses
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from adrl import _core
from adrl.deploy.evidence import Evidence
from adrl.deploy.lidar import readings
from adrl.deploy.messages import Pose, Reason, Scan
from adrl.geometry import composed, relative, wrapped
from adrl.types import Array, RobotConfig

LATES = (0, 1, 2, 3, 4, -1, -2)
"""Control periods that scans are looked for to be late by; below 0 it is the odometry that is."""
BACK_S = (0.3, 0.8)
"""A scan is compared with one of about so long ago; these in turn."""
SCALE_M = 0.1
"""Where a point lies so far off its surface, or farther, it fits no more."""
NOISE_STDS = 4.0
"""The same in standard deviations of the LiDAR's noise, if that is more."""
POINTS, FEWEST = 90, 12
"""Points of a scan that are compared, about; fewer than this tell nothing."""
DRIFTS = np.array([[1.0, 1.0, 1.0], [0.9, 0.9, 1.0], [1.1, 1.1, 1.0], [1.0, 1.0, 0.9], [1.0, 1.0, 1.1]])
"""Odometry's ways and turns may be wrong by so much: the belief is as good as the best of these."""
APART_M, APART_RAD = 0.01, 0.01
"""Motions nearer to each other than this are not told apart."""
SLACK, MOST, ENOUGH = 0.04, 0.3, 1.0
"""Of Evidence. MOST is what two scans can have to say: it takes several."""
DOUBT, CALM = 0.1, 5
"""From this evidence on, until so many comparisons in a row have given less, a scan adds to what is known of the
surroundings, but takes nothing away."""
SURE = 3.0
"""Evidence for the mount as configured after which others are not considered any more."""
HELD_S, LONGEST_HELD_S = 1.0, 30.0
"""The robot stands so long for a frozen scan before it tries it again, twice as long each time in a row."""
TURNS_RAD = (0.0, 0.5 * math.pi, math.pi, -0.5 * math.pi)


@dataclass(frozen=True, eq=False)
class _Past:
    """A scan, and (D, 3) where odometry says the robot was so many periods earlier as LATES has."""

    scan: Scan
    ranges: Array
    poses: Array
    late: int
    """Number in LATES of what was believed."""


class Alignment:
    """Of one robot's scans with its odometry. Poses are of the robot in the odometry's frame."""

    def __init__(self, robot: RobotConfig, mount: Pose) -> None:
        self._mount = mount
        self._period_s = robot.control_period_s
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
        self._turn = 0
        self._evidence.forget()
        self._late = 0
        self._held_until_s = -math.inf
        self._held_s = HELD_S
        self._alive = 0.0
        """Evidence against a frozen scan, since the last one was."""
        self._calm = CALM
        """Comparisons in a row that gave no rise to doubt."""

    @property
    def late_s(self) -> float:
        """Seconds by which scans are older than their stamps say; below 0: odometry is."""
        return LATES[self._late] * self._period_s

    @property
    def doubtful(self) -> bool:
        """Whether there is a suspicion against the newest scans, or was lately."""
        return self._calm < CALM

    @property
    def suspects_mount(self) -> bool:
        """Whether the LiDAR may be mounted otherwise, as it seems so far."""
        unsure = self._mount_sure < SURE
        return unsure and bool(self._evidence.sums[-len(self._mounts) :].max() > DOUBT)

    def reasons(self, now_s: float) -> tuple[Reason, ...]:
        """To stand."""
        if self._mounted_otherwise:
            return ("mount",)
        return ("scan_frozen",) if now_s < self._held_until_s else ()

    def take(self, scan: Scan, pose_at: Callable[[float], Pose], base_late_s: float) -> bool:
        """A new scan, and where odometry says the robot was at a time; whether it is found now to be frozen.

        base_late_s: odometry is no later than the base seems to be.
        """
        ranges, told = readings(scan)
        ranges = np.where(told, ranges, np.nan)
        lates_s = [late * self._period_s for late in LATES]
        poses = np.array([pose_at(scan.stamp_s - (s if s > -base_late_s - 1e-6 else 0.0)) for s in lates_s])
        while self._past and self._past[0].scan.stamp_s < scan.stamp_s - BACK_S[-1] - self._period_s:
            self._past.popleft()
        past, new = self._past_to_compare(scan.stamp_s), _Past(scan, ranges, poses, self._late)
        found = None if past is None else self._compare(new, past)
        if found is not None:
            self._conclude(found, scan.stamp_s)
        self._past.append(dataclasses.replace(new, late=self._late))
        return found == self._frozen

    def _past_to_compare(self, stamp_s: float) -> _Past | None:
        """The scan of about one of BACK_S ago, these in turn."""
        self._turn = (self._turn + 1) % len(BACK_S)
        for back_s in (BACK_S[self._turn], BACK_S[0]):
            until_s = stamp_s - back_s + 0.5 * self._period_s
            old = [past for past in self._past if past.scan.stamp_s <= until_s]
            if old:
                return old[-1]
        return None

    def _compare(self, new: _Past, past: _Past) -> int | None:
        """Weigh two scans; the number of the explanation that has to be believed from now on, None for none."""
        motions = np.concatenate(
            [relative(past.poses[past.late], new.poses), relative(past.poses, new.poses), np.zeros((1, 3))]
        )
        belief = motions[self._late] * DRIFTS
        seen = [self._seen(belief), self._seen(motions)]
        if self._mount_sure < SURE:
            seen += [self._seen(belief[:1], *mount) for mount in self._mounts]
        rows = np.concatenate(seen)
        off_m, off_rad = np.hypot(*(rows[:, :2] - rows[0, :2]).T), wrapped(rows[:, 2] - rows[0, 2])
        apart = (off_m > APART_M) | (np.abs(off_rad) > APART_RAD)
        if not apart[len(DRIFTS) :].any():
            return None
        apart[: len(DRIFTS)] = True
        stride = max(1, len(new.ranges) // POINTS)
        fit = _core.misfits(
            new.ranges, _fan(new.scan), past.ranges, _fan(past.scan), rows[apart], self._scale_m, stride
        )
        if fit[:, 1].min() < FEWEST:
            return None
        believed = float(fit[: len(DRIFTS), 0].min())
        misfit = np.full(len(self._evidence.sums), believed)
        misfit[: len(rows) - len(DRIFTS)][apart[len(DRIFTS) :]] = fit[len(DRIFTS) :, 0]
        if self._mount_sure < SURE:
            least = float(misfit[-len(self._mounts) :].min())
            self._mount_sure = max(0.0, self._mount_sure + least - believed - SLACK)
        self._alive = max(0.0, self._alive + misfit[self._frozen] - believed - SLACK)
        if self._alive > ENOUGH:
            self._held_s = HELD_S
        found = self._evidence.add(believed, misfit)
        self._calm = self._calm + 1 if self._evidence.sums.max() <= DOUBT else 0
        return found

    def _conclude(self, found: int, stamp_s: float) -> None:
        if found < self._frozen:
            self._late = found % len(LATES)
            if found >= len(LATES):  # those before were late as well
                self._past = deque(dataclasses.replace(past, late=self._late) for past in self._past)
        elif found == self._frozen:
            self._held_until_s = stamp_s + self._held_s
            self._held_s = min(2.0 * self._held_s, LONGEST_HELD_S)
            self._alive = 0.0
        else:
            self._mounted_otherwise = True
        self._evidence.forget()

    def _seen(self, motions: Array, turn_rad: float = 0.0, mirrored: bool = False) -> Array:
        """(M, 3) motions of the robot as its LiDAR's, if that is turned from where it should be, or mirrored."""
        x, y, yaw = self._mount
        sensor = np.array([(x, y, yaw + turn_rad)])
        moved = relative(sensor, composed(motions, sensor))
        return moved * np.array([1.0, -1.0, -1.0]) if mirrored else moved


def _fan(scan: Scan) -> tuple[float, float, float]:
    return scan.angle_min_rad, scan.angle_increment_rad, scan.range_max_m
