"""The last word on what a robot is told: stop when the sensors cannot be trusted, never out-drive the brakes.

It knows nothing of policies; any source of commands may be put behind it. Once a control period:

    faults = supervisor.watch(scan, odometry, now_s)
    twist, reasons = supervisor.stop(now_s) if faults else supervisor.limit(wanted, now_s)
"""

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from adrl.deploy.alignment import Alignment
from adrl.deploy.beams import BeamWatch
from adrl.deploy.messages import Odometry, Pose, Reason, Scan, Twist
from adrl.deploy.reckoning import STANDSTILL, Reckoning
from adrl.deploy.scan_reader import ScanReader
from adrl.deploy.surroundings import Surroundings
from adrl.deploy.watch import SensorWatch
from adrl.geometry import in_world_frame
from adrl.ranges import Range, check_ranges
from adrl.types import Array, RobotConfig

LOG = logging.getLogger("adrl.deploy")

SLOWER = (1.0, 0.75, 0.5, 0.25, 0.0)
"""Parts of the speed asked for that are tried in turn, at the same yaw rate; of a car on the same curve."""
NOISE_STDS = 2.0
"""Standard deviations of the LiDAR's noise that are the least distance to keep: nearer, noise hides what is there."""
GENTLE = 0.5
"""Part of the robot's greatest speeds that is gentle."""
CREEP = 0.2
"""Part of the greatest speed at which a robot goes whose LiDAR may be mounted otherwise than is known."""
FREE_M = 0.03
"""A free way keeps so much more clearance than the braking check asks for; of what is nearer already, it leads away."""
CAUTIONS = frozenset[Reason](
    ("scan_late", "odometry_late", "base_late", "base_weak", "scan_empty", "odometry_contradicts")
)
"""The robot drives on with these: what they name is reckoned with."""
CLOCKS_DIFFER = frozenset[Reason](("clock_jumped", "odometry_stale"))
"""Commands and odometry may not be stamped by the same clock."""


@dataclass(frozen=True, kw_only=True)
class SupervisorConfig:
    """Limits of trust. The robot's own, its speeds, accelerations, lag and latency, are in its RobotConfig."""

    max_age_periods: Annotated[float, Range(1.0, 1000.0)] = 2.0
    """Control periods after which a scan or odometry is too old to drive by; 1 to 1000."""
    hold_periods: Annotated[float, Range(1.0, 1000.0)] = 2.0
    """Control periods for which the base may go on with a command when no other comes: the time of its watchdog; 1 to
    1000."""
    margin_m: Annotated[float, Range(0.0, 1.0)] = 0.02
    """Distance in m kept from what the LiDAR has hit, or twice its noise if that is more; beside half the gap there
    between two beams that tell something; 0 to 1."""
    least_told: Annotated[float, Range(0.0, 1.0)] = 0.4
    """Share of the field of view that the policy was trained with of which beams must tell something; 0 to 1."""
    largest_hole_rad: Annotated[float, Range(0.0, 6.28)] = 0.35
    """Widest run of beams, rad, that may tell nothing; 0 to 6.28."""

    def __post_init__(self) -> None:
        check_ranges(self, "supervisor.")


DEFAULT = SupervisorConfig()


class Supervisor:
    """Watches one robot's sensors and commands. While the robot comes to rest, what was seen to move goes on or stops,
    and all else stands.

    The braking check: a command is let through when the robot may act on it until the next one, or until its watchdog
    stops it, and still come to rest without touching anything that the scan shows. Stopping is then always left for
    the next period, so no command leads to a collision that stopping would have avoided.
    """

    def __init__(
        self,
        robot: RobotConfig,
        config: SupervisorConfig | None = None,
        *,
        mount: Pose | None = None,
        zero_is_free: bool = False,
        nan_is_free: bool = False,
    ) -> None:
        """mount: of the LiDAR in the robot's frame, the RobotConfig's when None; zero_is_free, nan_is_free: see
        ScanReader."""
        self.robot = robot
        self.config = config or SupervisorConfig()
        lidar = robot.lidar
        mount = mount or lidar.mount
        self._period_s = robot.control_period_s
        self._read = ScanReader(zero_is_free=zero_is_free, nan_is_free=nan_is_free)
        self._sensors = SensorWatch(
            robot,
            max_age_s=self.config.max_age_periods * self._period_s,
            least_told=self.config.least_told,
            largest_hole_rad=self.config.largest_hole_rad,
        )
        self._surroundings = Surroundings(
            robot,
            mount,
            margin_m=max(self.config.margin_m, NOISE_STDS * lidar.noise_std_m),
            largest_hole_rad=self.config.largest_hole_rad,
        )
        self._reckoning = Reckoning(robot, self._sensors.odometry)
        self._alignment = Alignment(robot, mount)
        self._beams = BeamWatch(mount)
        self._told: tuple[str, ...] = ()
        self._slowed: tuple[Pose, Callable[[Array], bool], Array] | None = None
        """Where the robot was when its command was slowed or stopped for what stands about, whether the command wanted
        passes some of that, and all of it (M, 3), seen from there."""
        self._now_s = -math.inf
        self._looked_s = -math.inf
        """Stamp of the last scan whose hits the surroundings hold."""
        self.waits = False
        """Whether the last command was held for something that moves, and for nothing else."""

    def watch(self, scan: Scan | None, odometry: Odometry | None, now_s: float) -> tuple[Reason, ...]:
        """Take in what came since the last call, None for nothing; the reasons to stop, none when all is well."""
        if not math.isfinite(now_s):
            return ("clock_jumped",)
        scan = scan and self._read(scan)
        back = now_s < self._now_s
        self._now_s = now_s
        faults = self._sensors.take(scan, odometry, now_s)
        if back:
            self._reckoning.go_back(now_s)
        if back or "odometry_jumped" in faults:
            for memory in (self._surroundings, self._alignment, self._beams):
                memory.forget()
            self._looked_s = -math.inf
        self._reckoning.hear(comparable=CLOCKS_DIFFER.isdisjoint(faults))
        self._look()
        doubts = self._sensors.doubts()
        if doubts and self._beams.empty:
            doubts = ("scan_empty",)
        faults = (*faults, *doubts, *self._alignment.reasons(now_s))
        if self._reckoning.is_frozen():
            faults = (*faults, "odometry_frozen")
        return tuple(dict.fromkeys(faults))

    @property
    def cautions(self) -> tuple[Reason, ...]:
        """What is wrong, and reckoned with: no reason to stop."""
        told: dict[Reason, bool] = {
            "scan_late": self._alignment.late_s > 0.0,
            "odometry_late": self._alignment.late_s < 0.0,
            "base_late": self._reckoning.base_late_s > 0.0,
            "base_weak": self._reckoning.is_weak,
            "scan_empty": self._beams.empty,
            "odometry_contradicts": self._sensors.twist_contradicts,
        }
        return tuple(reason for reason, holds in told.items() if holds)

    @property
    def base_late_s(self) -> float:
        """Measured seconds by which the base acts later than its RobotConfig says."""
        return self._reckoning.base_late_s

    def newest(self) -> tuple[Scan, Odometry]:
        """What to drive by, after watch() found no fault."""
        scan, odometry = self._sensors.scan, self._sensors.odometry[-1]
        assert scan is not None
        return scan, odometry

    def stop(self, now_s: float, reasons: tuple[Reason, ...] = ()) -> tuple[Twist, tuple[Reason, ...]]:
        """Stand still. Returns what was sent, and the reasons as they are."""
        self._slowed = None
        return self._send(STANDSTILL, reasons, now_s)

    def stand_by(self, now_s: float, reasons: tuple[Reason, ...] = ()) -> tuple[Twist, tuple[Reason, ...]]:
        """Another drives the base, nothing is sent. What it was told is not known; what it does stands for that."""
        known, self._slowed = self._sensors.odometry, None
        _, reasons = self._send(known[-1].twist if known else STANDSTILL, reasons, now_s)
        return STANDSTILL, reasons

    def limit(self, wanted: Twist, now_s: float) -> tuple[Twist, tuple[Reason, ...]]:
        """The command nearest to the wanted one that is safe, and why it is not the same; after watch() without faults.

        Within the robot's limits; then slowed, at the same yaw rate or, a car, on the same curve, until the braking
        check passes; else a stop.
        """
        if not np.isfinite(wanted).all():
            return self.stop(now_s, ("command_invalid",))
        pose, twist = self._reckoning.state_at(now_s)
        pending = self._reckoning.orders(now_s, now_s + self._reckoning.latency_s)
        _, starting = self._reckoning.base.roll((0.0, 0.0, 0.0), twist, pending)
        reasons = list(self.cautions)
        command = self._within_limits(wanted, starting)
        if self._alignment.suspects_mount:  # what is ahead may be elsewhere: slowly, until that is clear
            slow = CREEP * self.robot.max_speed_mps
            command = self.robot.steerable((min(max(command[0], -slow), slow), command[1]))
        if math.dist(command, wanted) > 1e-6:
            reasons.append("limited")
        around = self._surroundings
        if (command[0] < 0.0 and not around.sees_behind()) or (command[0] > 0.0 and not around.sees_ahead()):
            command = self.robot.steerable((0.0, command[1]))
            reasons.append("unseen")
        hits, moving = around.seen_from(pose), around.moving_from(pose, now_s)
        speeds = dict.fromkeys(part * command[0] for part in SLOWER)
        choices = [(speed, command[1]) for speed in speeds]
        if self.robot.is_car:
            choices = [(part * command[0], part * command[1]) for part in SLOWER]
        chosen = next(
            (choice for choice in choices if self._can_stop(choice, twist, pending, hits, moving)), STANDSTILL
        )
        self.waits, self._slowed = False, None
        if chosen != command:
            reasons.append("obstacle")
            nobody, still = moving[:0], around.still_from(pose)
            self.waits = len(moving) > 0 and self._can_stop(command, twist, pending, still, nobody)
            self._slowed = (pose, lambda some: self._can_stop(command, twist, pending, some, nobody), hits)
        return self._send(chosen, tuple(reasons), now_s)

    def braked_for(self) -> Array:
        """(M, 2) in the odometry's frame: of what is known to stand about, that which the last command is slowed or
        stopped for; none where it is not."""
        if self._slowed is None:
            return np.empty((0, 2))
        pose, passes, hits = self._slowed
        return in_world_frame(np.array(pose), _in_the_way(hits, passes)[:, :2])

    @property
    def gently(self) -> Twist:
        """Speed and yaw rate at which could_drive() looks at a way."""
        return GENTLE * self.robot.max_speed_mps, GENTLE * self.robot.max_yaw_rate_radps

    def could_drive(self, turn_rad: float, way_m: float, now_s: float) -> bool:
        """Whether the robot, at rest, could turn on the spot (above 0: to the left) and then drive straight on so far;
        after watch() without faults.
        """
        speed, yaw_rate = self.gently
        x, y, yaw = self.pose_at(now_s)
        turning_s = abs(turn_rad) / yaw_rate
        turning = np.array([[0.0, math.copysign(yaw_rate, turn_rad), turning_s]])
        if not self._is_free(turning, (x, y, yaw), now_s):
            return False
        ahead = np.array([[speed, 0.0, way_m / speed]])
        return self._is_free(ahead, (x, y, yaw + turn_rad), now_s + turning_s, FREE_M)

    def could_steer(self, twist: Twist, seconds: float, now_s: float) -> bool:
        """Whether the robot, at rest, could drive an arc for so long; after watch() without faults."""
        around = self._surroundings
        if not (around.sees_behind() if twist[0] < 0.0 else around.sees_ahead()):
            return False
        return self._is_free(np.array([[*twist, seconds]]), self.pose_at(now_s), now_s, FREE_M)

    def _is_free(self, orders: Array, pose: Pose, time_s: float, more_m: float = 0.0) -> bool:
        """Whether a robot at rest at a pose at some time could do this, with so much more clearance of what stands."""
        hits = self._surroundings.seen_from(pose) + np.array([0.0, 0.0, more_m])
        moving = self._surroundings.moving_from(pose, time_s)
        return self._reckoning.base.stays_clear(STANDSTILL, orders, hits, moving)

    def _send(
        self, twist: Twist, reasons: tuple[Reason, ...], now_s: float
    ) -> tuple[Twist, tuple[Reason, ...]]:
        self._reckoning.tell(twist, now_s)
        grave = tuple(reason for reason in reasons if reason != "limited")
        if grave != self._told:
            usual = not grave or set(grave) <= {"obstacle", "unseen"}
            how = "driving on with" if CAUTIONS.issuperset(grave) else "held"
            LOG.log(
                logging.INFO if usual else logging.WARNING,
                "%s",
                f"{how}: {', '.join(grave)}" if grave else "released",
            )
            self._told = grave
        return twist, reasons

    def _within_limits(self, wanted: Twist, twist: Twist) -> Twist:
        """The command clipped to the robot's speeds and to what its acceleration makes of it in a period."""
        robot, period_s = self.robot, self._period_s
        # A base that lags behind covers this part of the way to its command.
        covered = -math.expm1(-period_s / robot.lag_s) if robot.lag_s > 0.0 else 1.0
        change = robot.max_acceleration_mps2 * period_s / covered
        turn_change = robot.max_yaw_acceleration_radps2 * period_s / covered
        v = min(max(wanted[0], twist[0] - change), twist[0] + change)
        w = min(max(wanted[1], twist[1] - turn_change), twist[1] + turn_change)
        fastest_turn = robot.max_yaw_rate_radps
        return robot.steerable(
            (
                min(max(v, robot.min_speed_mps), robot.max_speed_mps),
                min(max(w, -fastest_turn), fastest_turn),
            )
        )

    def _can_stop(self, command: Twist, twist: Twist, pending: Array, hits: Array, moving: Array) -> bool:
        """Whether the robot stays clear if the next command comes in time, and if the watchdog has to stop it."""
        for periods in dict.fromkeys((1.0, self.config.hold_periods)):
            orders = np.concatenate([pending, [[*command, periods * self._period_s]]])
            if not self._reckoning.base.stays_clear(twist, orders, hits, moving):
                return False
        return True

    def pose_at(self, time_s: float) -> Pose:
        """Where odometry says, or lets expect, the robot at a time of late; after watch() has seen odometry."""
        return self._reckoning.pose_at(time_s)

    def _look(self) -> None:
        """Remember what the newest scan shows, whoever drives and whatever else is wrong."""
        scan = self._sensors.scan
        if scan is None or not self._sensors.odometry or scan.stamp_s == self._looked_s:
            return
        self._looked_s = scan.stamp_s
        late_s = self._alignment.late_s
        if not self._reckoning.is_frozen():
            frozen = self._alignment.take(scan, self.pose_at, self._reckoning.base_late_s)
            if frozen:
                self._surroundings.revert()
        if late_s != self._alignment.late_s:  # what is known was placed wrongly
            self._beams.forget()
        if self._alignment.reasons(self._now_s):
            return
        taken_s = scan.stamp_s - self._alignment.late_s
        first = self.pose_at(taken_s)
        last = self.pose_at(taken_s + scan.lasts_s) if scan.lasts_s > 0.0 else first
        self._sensors.scan = self._beams.believable(scan, first)
        late_s = self._alignment.late_s
        clears = not self._alignment.doubtful
        self._surroundings.take(self._sensors.scan, first, last, late_s=late_s, clears=clears)


def _in_the_way(hits: Array, passes: Callable[[Array], bool]) -> Array:
    """(M, 3) those of some hits that each by itself is reason to brake: by halves, as most are not."""
    if len(hits) == 0 or passes(hits):
        return hits[:0]
    if len(hits) == 1:
        return hits
    half = len(hits) // 2
    return np.concatenate([_in_the_way(hits[:half], passes), _in_the_way(hits[half:], passes)])
