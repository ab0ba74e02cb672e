"""Where a robot is at any time of late, or soon: from its odometry, and from what its base was told."""

import bisect
import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from adrl import _core
from adrl.deploy.messages import Odometry, Pose, Twist
from adrl.deploy.response import LATEST_PERIODS, STRENGTHS, Response
from adrl.geometry import part_way
from adrl.types import Array, RobotConfig

STANDSTILL: Twist = (0.0, 0.0)
REMEMBERED_S = 1.0
"""Commands of so long ago still count when odometry is asked whether it has moved."""
OWED_M, OWED_RAD = 0.1, 0.2
"""Odometry that has not changed while the base was told to move by so much is frozen, or the base is stuck."""
OWN_M, OWN_RAD = 0.02, 0.03
"""The same for the motion that the odometry's own twist promises."""


class Reckoning:
    """Of one base: the commands that it was sent, and when it acts on them, which is measured."""

    def __init__(self, robot: RobotConfig, known: Sequence[Odometry]) -> None:
        """known: the odometry, the newest last, as it comes."""
        self._robot, self._known = robot, known
        self._bases = [_base(robot, strength) for strength in STRENGTHS]
        self._response = Response(robot)
        self._longest_s = robot.latency_s + LATEST_PERIODS * robot.control_period_s
        self._commands: deque[tuple[float, Twist]] = deque()
        """When each was sent, and what."""
        self._unchanged_since: Odometry | None = None
        self._heard: Odometry | None = None

    @property
    def latency_s(self) -> float:
        """From a command to the base's acting on it: as configured, or as measured if that is more."""
        return self._robot.latency_s + self._response.late_s

    @property
    def base(self) -> _core.Braking:
        """How it responds and comes to rest: as configured, or as weakly as measured."""
        return self._bases[self._response.strength]

    @property
    def is_weak(self) -> bool:
        """Whether it accelerates and brakes less than configured."""
        return self._response.strength > 0

    @property
    def base_late_s(self) -> float:
        """By how much it acts later than configured."""
        return self._response.late_s

    def go_back(self, now_s: float) -> None:
        """The clock did. The base goes on with what it was told last."""
        last = self._commands[-1][1] if self._commands else STANDSTILL
        self._commands = deque([(now_s - self._longest_s, last)])
        self._unchanged_since = self._heard = None

    def tell(self, twist: Twist, now_s: float) -> None:
        """The base is sent this."""
        if math.isfinite(now_s):
            self._commands.append((now_s, twist))
        oldest_s = now_s - REMEMBERED_S - self._longest_s
        while len(self._commands) > 1 and self._commands[1][0] < oldest_s:
            self._commands.popleft()

    def hear(self, *, comparable: bool) -> None:
        """Compare what new odometry says with what the base was told, if there is any. comparable: whether one clock
        stamps both; else when the base did what it was told is not known."""
        if not comparable:
            self._heard = None
            return
        new, last = (self._known[-1] if self._known else None), self._heard
        if new is last:
            return
        self._heard = new
        if new is None or last is None or new.stamp_s <= last.stamp_s:
            return
        period_s = self._robot.control_period_s
        late_s = [self._robot.latency_s + late * period_s for late in range(LATEST_PERIODS + 1)]
        orders = [self.orders(last.stamp_s, new.stamp_s, latency_s) for latency_s in late_s]
        self._response.take(
            last,
            new,
            np.array([[base.roll(last.pose, last.twist, one)[1] for one in orders] for base in self._bases]),
        )

    def orders(self, start_s: float, end_s: float, latency_s: float | None = None) -> Array:
        """(S, 3) what the base acts on from one time to another: speed, yaw rate, seconds."""
        latency_s = self.latency_s if latency_s is None else latency_s
        rows: list[tuple[float, float, float]] = []
        until_s = end_s
        for sent_s, twist in reversed(self._commands):
            begin_s = max(sent_s + latency_s, start_s)
            if until_s - begin_s > 1e-9:
                rows.append((*twist, until_s - begin_s))
                until_s = begin_s
            if until_s <= start_s:
                break
        if until_s - start_s > 1e-9:  # before the first command
            rows.append((*STANDSTILL, until_s - start_s))
        return np.array(rows[::-1]).reshape(-1, 3)

    def state_at(self, time_s: float) -> tuple[Pose, Twist]:
        """Pose and twist to be expected at a time after the newest odometry."""
        newest = self._known[-1]
        return self.base.roll(newest.pose, newest.twist, self.orders(newest.stamp_s, time_s))

    def pose_at(self, time_s: float) -> Pose:
        """Where odometry says, or lets expect, the robot at a time of late; when there is odometry."""
        known = self._known
        if time_s >= known[-1].stamp_s:
            return self.state_at(time_s)[0]
        later = bisect.bisect_left(known, time_s, key=lambda message: message.stamp_s)
        if later == 0:  # older than all that is known
            first = known[0]
            pose, twist = np.array([first.pose], np.float64), np.array([first.twist], np.float64)
            x, y, yaw = _core.integrate(pose, twist, time_s - first.stamp_s)[0].tolist()
            return x, y, yaw
        before, after = known[later - 1], known[later]
        share = (time_s - before.stamp_s) / (after.stamp_s - before.stamp_s)
        return part_way(before.pose, after.pose, share)

    def is_frozen(self) -> bool:
        """Whether odometry stands still while it says itself that the robot moves, or the base was told to for long."""
        if not self._known:
            return False
        newest, since = self._known[-1], self._unchanged_since
        if since is None or (since.pose, since.twist) != (newest.pose, newest.twist):
            self._unchanged_since = newest
            return False
        passed_s = newest.stamp_s - since.stamp_s
        if abs(newest.twist[0]) * passed_s > OWN_M or abs(newest.twist[1]) * passed_s > OWN_RAD:
            return True
        orders = self.orders(max(since.stamp_s, newest.stamp_s - REMEMBERED_S), newest.stamp_s)
        owed_m, owed_rad = np.abs(orders[:, :2]).T @ orders[:, 2]
        return bool(owed_m > OWED_M or owed_rad > OWED_RAD)


def _base(robot: RobotConfig, strength: float) -> _core.Braking:
    """One with this share of the robot's accelerations."""
    accelerations = (strength * robot.max_acceleration_mps2, strength * robot.max_yaw_acceleration_radps2)
    response = (*accelerations, robot.lag_s)
    shape = robot.radius_m or 0.0, robot.polygon
    return _core.Braking(*shape, response, robot.control_period_s, robot.min_turning_radius_m)
