"""Whether a robot's scan and odometry can be driven by: new enough, whole, and alive."""

import dataclasses
import itertools
import math
from collections import deque

import numpy as np

from adrl.deploy.lidar import readings, widest_hole_rad
from adrl.deploy.messages import Odometry, Pose, Reason, Scan, Twist
from adrl.deploy.scan_reader import FULL_CIRCLE_RAD
from adrl.geometry import compose, inverse, part_way
from adrl.types import BEYOND_SPEED, Array, RobotConfig

EARLY_PERIODS = 0.5
"""Stamps may be this much ahead of the clock: sensors have clocks of their own."""
MOVED_M, MOVED_RAD = 0.01, 0.02
"""A robot that has moved by so much sees something change."""
KEPT = 32
"""Odometry messages that are remembered: scans are older than odometry."""
COMPARED_S = 1.0
"""Time constant over which the odometry's twist is compared with its poses."""
LOST, INTERVALS = 1.5, 5
"""Odometry that comes so many times later than the shortest of the last intervals has lost a message."""
OFF_M, OFF_RAD, OFF_SHARE = 0.05, 0.06, 0.3
"""The way that the twist says may differ by so much, and this share of it, from the way between the poses."""


class SensorWatch:
    """The newest good scan and odometry, and what is wrong with them."""

    def __init__(
        self,
        robot: RobotConfig,
        *,
        max_age_s: float,
        least_told: float,
        largest_hole_rad: float,
    ) -> None:
        self.robot = robot
        self._max_age_s = max_age_s
        self._least_told = least_told
        self._largest_hole_rad = largest_hole_rad
        self._now_s = -math.inf
        self.odometry: deque[Odometry] = deque(maxlen=KEPT)
        """With a twist that its poses do not contradict: see twist_contradicts."""
        self.forget()

    def forget(self) -> None:
        """As if nothing had ever been received."""
        self.scan: Scan | None = None
        self._unusable = False
        """The last scan to come could not be used."""
        self._last_beam_s = -math.inf
        """Of the scan, and no later than when it came: some drivers stamp the end."""
        self.odometry.clear()
        self.twist_contradicts = False
        """The odometry's own twist is not what its poses do; theirs is taken instead."""
        self._off = np.zeros(2)
        self._done = np.zeros(2)
        """Of late, metres and radians: the way by the twist less that by the poses, and the way by the poses."""
        self._said: Twist = (0.0, 0.0)
        self._content = b""
        self._first_seen_at: Pose | None = None
        self._frozen = False

    def take(self, scan: Scan | None, odometry: Odometry | None, now_s: float) -> tuple[Reason, ...]:
        """Take in what came since the last call, in any order and of any quality; why not to drive by it."""
        faults: list[Reason] = []
        if not now_s >= self._now_s:  # not a number neither
            self.forget()
            faults.append("clock_jumped")
        self._now_s = now_s
        early_s = EARLY_PERIODS * self.robot.control_period_s
        if any(message is not None and message.stamp_s > now_s + early_s for message in (scan, odometry)):
            faults.append("clock_jumped")
        if odometry is not None and not odometry.stamp_s > now_s + early_s:
            faults += self._take_odometry(odometry)
        if scan is not None and not scan.stamp_s > now_s + early_s:
            told = self._take_scan(scan)
            self._unusable = bool(told)
            faults += told
        return tuple(dict.fromkeys(faults + self._ages(now_s)))

    def _ages(self, now_s: float) -> list[Reason]:
        last = self.odometry[-1] if self.odometry else None
        oldest_s = now_s - self._max_age_s - 1e-6
        faults: list[Reason] = []
        if self.scan is None:
            faults.append("scan_invalid" if self._unusable else "no_scan")
        elif self._last_beam_s < oldest_s:
            faults.append("scan_frozen" if self._frozen else "scan_stale")
        if last is None:
            faults.append("no_odometry")
        elif last.stamp_s < oldest_s:
            faults.append("odometry_stale")
        return faults

    def _take_odometry(self, odometry: Odometry) -> list[Reason]:
        if not is_plausible(self.robot, odometry):
            return ["odometry_invalid"]
        last = self.odometry[-1] if self.odometry else None
        if last is not None and odometry.stamp_s <= last.stamp_s:
            return []
        jumped = last is not None and has_jumped(self.robot, last, odometry)
        if jumped:  # older poses are of another place
            self.odometry.clear()
            self._first_seen_at = None
            self._off, self._done = np.zeros(2), np.zeros(2)
        self.odometry.append(self._by_its_poses(odometry))
        return ["odometry_jumped"] if jumped else []

    def _by_its_poses(self, odometry: Odometry) -> Odometry:
        """Odometry whose twist is that of its poses, if the two have contradicted each other of late."""
        said, self._said = self._said, odometry.twist
        last = self.odometry[-1] if self.odometry else odometry
        if odometry.pose == last.pose:  # at rest, or frozen, which is another fault
            return odometry
        passed_s = odometry.stamp_s - last.stamp_s
        fades = math.exp(-passed_s / COMPARED_S)
        self._off, self._done = fades * self._off, fades * self._done
        if passed_s < LOST * self._usual_s():  # else nobody has said how fast it was between the two
            done = np.array(_way(last.pose, odometry.pose))
            self._off += 0.5 * passed_s * np.add(said, odometry.twist) - done
            self._done += np.abs(done)
        bounds = np.array([OFF_M, OFF_RAD]) + OFF_SHARE * self._done
        self.twist_contradicts = bool(
            (np.abs(self._off) > (0.5 if self.twist_contradicts else 1.0) * bounds).any()
        )
        return (
            dataclasses.replace(odometry, twist=self._driven(odometry))
            if self.twist_contradicts
            else odometry
        )

    def _usual_s(self) -> float:
        """Time between two odometry messages when none is lost, as the last ones tell."""
        stamps = [message.stamp_s for message in itertools.islice(reversed(self.odometry), 1 + INTERVALS)]
        return min((later - earlier for later, earlier in itertools.pairwise(stamps)), default=math.inf)

    def _driven(self, odometry: Odometry) -> Twist:
        """Its twist by the poses of the last two control periods: the last one's mean, carried on by half of it."""
        period_s = 0.9 * self.robot.control_period_s
        twists: list[Array] = []
        later = odometry
        for earlier in reversed(self.odometry):
            if later.stamp_s - earlier.stamp_s >= period_s:
                twists.append(np.array(_way(earlier.pose, later.pose)) / (later.stamp_s - earlier.stamp_s))
                later = earlier
            if len(twists) == 2:
                break
        if not twists:
            return odometry.twist
        v, w = 1.5 * twists[0] - 0.5 * twists[-1] if len(twists) == 2 else twists[0]
        fastest, turn = self.robot.fastest_mps, self.robot.max_yaw_rate_radps
        return float(np.clip(v, -fastest, fastest)), float(np.clip(w, -turn, turn))

    def _take_scan(self, scan: Scan) -> list[Reason]:
        about = (scan.angle_min_rad, scan.angle_increment_rad, scan.stamp_s)
        whole = scan.ranges.ndim == 1 and scan.ranges.size > 0 and np.isfinite(about).all()
        if not (whole and 0.0 < abs(scan.angle_increment_rad) * (scan.ranges.size - 0.5) <= FULL_CIRCLE_RAD):
            return ["scan_invalid"]
        if self.scan is not None and scan.stamp_s <= self.scan.stamp_s:
            return []  # overtaken by a newer one
        self._frozen = self._repeats(scan)
        if not self._frozen:  # else it is an old one: the stamp is all that is new
            self.scan = scan
            self._last_beam_s = min(scan.stamp_s + scan.lasts_s, self._now_s)
        return []

    def _repeats(self, scan: Scan) -> bool:
        """Whether its ranges are those of the last one, though the robot has moved."""
        content = scan.ranges.tobytes()
        here = self.odometry[-1].pose if self.odometry else None
        if content != self._content or self._first_seen_at is None or here is None:
            self._content, self._first_seen_at = content, here
            return False
        moved_m, turned_rad = moved(self._first_seen_at, here)
        if moved_m <= MOVED_M and turned_rad <= MOVED_RAD:
            return False
        # Where nothing is in reach, scans are alike.
        return bool(np.isfinite(readings(scan)[0]).any())

    def doubts(self) -> tuple[Reason, ...]:
        """What is wrong with the newest scan itself."""
        if self.scan is None:
            return ()
        scan = self.scan
        _, told = readings(scan)
        if not told.any():
            return ("scan_invalid",)
        told_rad = np.count_nonzero(told) * abs(scan.angle_increment_rad)
        needed_rad = self._least_told * self.robot.lidar.fov_rad
        if told_rad < needed_rad or widest_hole_rad(scan, told) > self._largest_hole_rad:
            return ("scan_sparse",)
        return ()


def is_plausible(robot: RobotConfig, odometry: Odometry) -> bool:
    """Whether it can be a robot's at all: finite, and no faster than it can be."""
    v, w = odometry.twist
    slow = abs(v) <= BEYOND_SPEED * robot.fastest_mps and abs(w) <= BEYOND_SPEED * robot.max_yaw_rate_radps
    return slow and bool(np.isfinite([*odometry.pose, odometry.stamp_s]).all())


def has_jumped(robot: RobotConfig, last: Odometry, new: Odometry) -> bool:
    """Whether the robot cannot have driven from one to the other: its odometry has begun anew."""
    return bool(robot.cannot_have_driven(*moved(last.pose, new.pose), new.stamp_s - last.stamp_s))


def _way(before: Pose, after: Pose) -> Twist:
    """Metres ahead and radians that a robot has driven from one pose to the next, by its heading half way."""
    half_way = part_way(before, after, 0.5)
    ahead, _, half_turn = compose(inverse((*before[:2], half_way[2])), after)
    return ahead, 2.0 * half_turn


def moved(before: Pose, after: Pose) -> tuple[float, float]:
    """Metres and radians between two poses."""
    turn = math.remainder(after[2] - before[2], 2.0 * math.pi)
    return math.hypot(after[0] - before[0], after[1] - before[1]), abs(turn)
