"""What gets a robot on that comes nowhere: it turns to where the way is free, drives a little, and hands back.

A policy that passes an obstacle more closely than the LiDAR's noise allows asks for ever for what the supervisor has
to refuse; another one stands by itself where it has to turn round in a place of a kind that it was not trained in. Nav2
calls such a remedy a recovery behaviour. The supervisor has the last word on this one, too.
"""

import logging
import math
from dataclasses import dataclass

from adrl.deploy.messages import Pose, Twist
from adrl.deploy.supervisor import Supervisor

LOG = logging.getLogger("adrl.deploy")

PATIENCE_S = 3.0
"""A robot that has come nowhere in this time, and was driven in half of it, needs help. Longer than the replanner's
window (2 s), so that a new route comes first."""
PROGRESS_M = 0.1
"""Driving so far is progress."""
PROGRESS_RAD, MOST_TURNED_RAD = 0.5, math.pi
"""Turning so far is progress as well, but not beyond this in one place."""
WAY_M = 0.3
"""Driven until the policy has the robot back."""
AWAY_M = 1.0
"""So far from where it stuck first, the robot has got away from there."""
MOST_TRIES = 6
"""Ways that are tried from one place. Then it is left there, as it was without help."""
TURNS_RAD = tuple(math.radians(degrees) for degrees in range(-165, 181, 15))
"""Looked at for a free way."""
AHEAD_RAD = 0.15
"""Turned as near as this to the free way, it drives."""
SPARE_S = 2.0
"""More time than turn and way need, until the policy has the robot back in any case."""


@dataclass(frozen=True)
class _Way:
    heading_rad: float
    start: Pose
    until_s: float


class Recovery:
    """Of one robot behind its supervisor, whose odometry's frame is that of poses and headings."""

    def __init__(self, supervisor: Supervisor) -> None:
        self._supervisor = supervisor
        self.forget()

    def forget(self) -> None:
        """Another goal, another driver, or another frame of the odometry."""
        self._way: _Way | None = None
        self._stuck_at: Pose | None = None
        """Where the first way was looked for."""
        self._tries = 0
        self._begin(None, -math.inf)
        self._turned_rad = 0.0

    def twist(self, bearing_rad: float, now_s: float) -> Twist | None:
        """What to ask for instead of the policy's command; None for that. bearing_rad: to the waypoint."""
        pose, way = self._supervisor.pose_at(now_s), self._way
        if way is not None and (_between_m(pose, way.start) >= WAY_M or now_s >= way.until_s):
            way = self._way = None
            self._begin(pose, now_s)
        if way is None and now_s - self._since_s > PATIENCE_S:
            if self._driven_s > 0.5 * PATIENCE_S:
                way = self._way = self._free_way(pose, bearing_rad, now_s)
            self._begin(pose, now_s)
        if way is None:
            return None
        turn = math.remainder(way.heading_rad - pose[2], 2.0 * math.pi)
        speed, yaw_rate = self._supervisor.gently
        return (speed if abs(turn) < AHEAD_RAD else 0.0), min(max(2.0 * turn, -yaw_rate), yaw_rate)

    def watch(self, now_s: float) -> None:
        """A step has been driven."""
        pose = self._supervisor.pose_at(now_s)
        if self._stuck_at is not None and _between_m(pose, self._stuck_at) > AWAY_M:
            self._stuck_at, self._tries = None, 0
        if self._start is None or _between_m(pose, self._start) > PROGRESS_M:
            self._begin(pose, now_s)
            self._turned_rad = 0.0
        elif self._turned_rad < MOST_TURNED_RAD:
            turned = abs(math.remainder(pose[2] - self._start[2], 2.0 * math.pi))
            if turned > PROGRESS_RAD:
                self._begin(pose, now_s)
                self._turned_rad += turned
        self._driven_s += self._supervisor.robot.control_period_s

    def _begin(self, pose: Pose | None, now_s: float) -> None:
        """Count from here."""
        self._start, self._since_s, self._driven_s = pose, now_s, 0.0

    def _free_way(self, pose: Pose, bearing_rad: float, now_s: float) -> _Way | None:
        """That nearest to the waypoint's direction; from the same place the next time the next, and so on."""
        turns = sorted(TURNS_RAD, key=lambda turn: abs(math.remainder(turn - bearing_rad, 2.0 * math.pi)))
        free = [turn for turn in turns if self._supervisor.could_drive(turn, WAY_M, now_s)]
        if not free or self._tries >= MOST_TRIES:
            return None
        turn = free[self._tries % len(free)]
        self._tries += 1
        self._stuck_at = self._stuck_at or pose
        again = "" if self._tries < MOST_TRIES else ", for the last time from here"
        LOG.info("no progress: turning by %.0f degrees to a free way%s", math.degrees(turn), again)
        return _Way(pose[2] + turn, pose, now_s + self._takes_s(turn) + SPARE_S)

    def _takes_s(self, turn_rad: float) -> float:
        """Turn and way, each from rest to rest."""
        robot = self._supervisor.robot
        speed, yaw_rate = self._supervisor.gently
        turning_s = abs(turn_rad) / yaw_rate + 2.0 * yaw_rate / robot.max_yaw_acceleration_radps2
        driving_s = WAY_M / speed + 2.0 * speed / robot.max_acceleration_mps2
        return turning_s + driving_s + 2.0 * (robot.latency_s + 3.0 * robot.lag_s)


def _between_m(a: Pose, b: Pose) -> float:
    return math.dist(a[:2], b[:2])
