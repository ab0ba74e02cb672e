"""What gets a robot on that comes nowhere: it turns to where the way is free, drives a little, and hands back. A car
drives an arc that is free, backward first where its way leads forward.

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
CAR_WAY_M = 0.6
"""The same of a car, which turns only as it drives."""
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
    start: Pose
    until_s: float
    length_m: float
    heading_rad: float = 0.0
    """To turn to before it drives straight on."""
    arc: Twist | None = None
    """What a car drives instead."""


class Recovery:
    """Of one robot behind its supervisor, whose odometry's frame is that of poses and headings."""

    def __init__(self, supervisor: Supervisor) -> None:
        self._supervisor = supervisor
        self.ways = 0
        """That were taken, all together."""
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
        if way is not None and (_between_m(pose, way.start) >= way.length_m or now_s >= way.until_s):
            way = self._way = None
            self._begin(pose, now_s)
        if way is None and now_s - self._since_s > PATIENCE_S:
            if self._driven_s > 0.5 * PATIENCE_S:
                find = self._free_arc if self._supervisor.robot.is_car else self._free_way
                way = self._way = find(pose, bearing_rad, now_s)
            self._begin(pose, now_s)
        if way is None:
            return None
        if way.arc is not None:
            return way.arc
        turn = math.remainder(way.heading_rad - pose[2], 2.0 * math.pi)
        speed, yaw_rate = self._supervisor.gently
        return (speed if abs(turn) < AHEAD_RAD else 0.0), min(max(2.0 * turn, -yaw_rate), yaw_rate)

    def watch(self, now_s: float) -> None:
        """A step has been driven."""
        pose = self._supervisor.pose_at(now_s)
        if self._supervisor.waits:  # who stands for people is not stuck
            self._begin(pose, now_s)
            return
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
        next_one = self._next_of(len(free), pose)
        if next_one is None:
            return None
        turn = free[next_one]
        LOG.info(
            "no progress: turning by %.0f degrees to a free way%s",
            math.degrees(turn),
            self._for_the_last_time,
        )
        robot, (_, yaw_rate) = self._supervisor.robot, self._supervisor.gently
        turning_s = abs(turn) / yaw_rate + 2.0 * yaw_rate / robot.max_yaw_acceleration_radps2
        until_s = now_s + turning_s + self._takes_s(WAY_M, self._supervisor.gently[0]) + SPARE_S
        return _Way(pose, until_s, WAY_M, heading_rad=pose[2] + turn)

    def _free_arc(self, pose: Pose, bearing_rad: float, now_s: float) -> _Way | None:
        """Of a car: away from where its waypoint lies, on the curve that turns it there best; then towards it. From the
        same place the next time the next, and so on."""
        robot, (gentle, turning) = self._supervisor.robot, self._supervisor.gently
        towards = 1.0 if math.cos(bearing_rad) > 0.0 else -1.0
        speeds = [-towards * gentle, towards * gentle]
        arcs: list[Twist] = []
        for speed in (max(speed, robot.min_speed_mps) for speed in speeds):
            if speed == 0.0:
                continue
            turned = CAR_WAY_M / abs(speed)
            curves = [robot.steerable((speed, yaw_rate)) for yaw_rate in (turning, -turning, 0.0)]
            arcs += sorted(curves, key=lambda arc: _off(bearing_rad, arc[1] * turned, towards))
        free = [arc for arc in arcs if self._supervisor.could_steer(arc, CAR_WAY_M / abs(arc[0]), now_s)]
        next_one = self._next_of(len(free), pose)
        if next_one is None:
            return None
        arc = free[next_one]
        LOG.info(
            "no progress: %s on a free curve%s",
            "backing" if arc[0] < 0.0 else "driving",
            self._for_the_last_time,
        )
        return _Way(pose, now_s + self._takes_s(CAR_WAY_M, abs(arc[0])) + SPARE_S, CAR_WAY_M, arc=arc)

    def _next_of(self, count: int, pose: Pose) -> int | None:
        """Which of so many free ways is tried next from here; None for no more."""
        if count == 0 or self._tries >= MOST_TRIES:
            return None
        self._tries += 1
        self.ways += 1
        self._stuck_at = self._stuck_at or pose
        return (self._tries - 1) % count

    @property
    def _for_the_last_time(self) -> str:
        return "" if self._tries < MOST_TRIES else ", for the last time from here"

    def _takes_s(self, way_m: float, speed_mps: float) -> float:
        """From rest to rest, and until the base does what it is told."""
        robot = self._supervisor.robot
        driving_s = way_m / speed_mps + 2.0 * speed_mps / robot.max_acceleration_mps2
        return driving_s + 2.0 * (robot.latency_s + 3.0 * robot.lag_s)


def _off(bearing_rad: float, turned_rad: float, towards: float) -> float:
    """By how much a car that has turned so far misses a bearing, with its tail where that is behind it."""
    ahead = bearing_rad if towards > 0.0 else bearing_rad + math.pi
    return abs(math.remainder(ahead - turned_rad, 2.0 * math.pi))


def _between_m(a: Pose, b: Pose) -> float:
    return math.dist(a[:2], b[:2])
