"""What gets a robot on that its supervisor holds: it turns to where the way is free, drives a little, and hands back.

A policy that passes an obstacle more closely than the LiDAR's noise allows asks for ever for what the supervisor has
to refuse. Nav2 calls such a remedy a recovery behaviour. The supervisor has the last word on this one, too.
"""

import logging
import math
from dataclasses import dataclass

from adrl.deploy.messages import Pose, Twist
from adrl.deploy.supervisor import GENTLE, Supervisor

LOG = logging.getLogger("adrl.deploy")

PATIENCE_S = 2.0
"""Without progress for so long, and held by an obstacle in most of its steps, the robot needs help."""
PROGRESS_M = 0.1
"""Driving so far is progress."""
WAY_M = 0.3
"""Driven until the policy has the robot back."""
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
    """Of one robot behind its supervisor. Poses and headings are in the odometry's frame."""

    def __init__(self, supervisor: Supervisor) -> None:
        self._supervisor = supervisor
        self.forget()

    def forget(self) -> None:
        """The robot has stood, or another drove it."""
        self._way: _Way | None = None
        self._begin(None, -math.inf)
        self._tries = 0

    def twist(self, pose: Pose, bearing_rad: float, now_s: float) -> Twist | None:
        """What to ask for instead of the policy's command; None for that. bearing_rad: to the waypoint."""
        way, robot = self._way, self._supervisor.robot
        if way is not None and (math.dist(pose[:2], way.start[:2]) >= WAY_M or now_s >= way.until_s):
            way = self._way = None
            self._begin(pose, now_s)
        if way is None and now_s - self._since_s > PATIENCE_S and 2 * self._held > self._steps:
            way = self._way = self._free_way(pose, bearing_rad, now_s)
            self._begin(pose, now_s)
        if way is None:
            return None
        turn = math.remainder(way.heading_rad - pose[2], 2.0 * math.pi)
        fastest = GENTLE * robot.max_yaw_rate_radps
        speed = GENTLE * robot.max_speed_mps if abs(turn) < AHEAD_RAD else 0.0
        return speed, min(max(2.0 * turn, -fastest), fastest)

    def watch(self, pose: Pose, held: bool, now_s: float) -> None:
        """A step has been driven; held: by an obstacle."""
        if self._start is None or math.dist(pose[:2], self._start[:2]) > PROGRESS_M:
            self._begin(pose, now_s)
            if self._way is None:
                self._tries = 0
        self._steps += 1
        self._held += held

    def _begin(self, pose: Pose | None, now_s: float) -> None:
        """Count from here."""
        self._start, self._since_s = pose, now_s
        self._steps = self._held = 0

    def _free_way(self, pose: Pose, bearing_rad: float, now_s: float) -> _Way | None:
        """That nearest to the waypoint's direction; at the next try the next, and so on."""
        turns = sorted(TURNS_RAD, key=lambda turn: abs(math.remainder(turn - bearing_rad, 2.0 * math.pi)))
        free = [turn for turn in turns if self._supervisor.could_drive(turn, WAY_M, now_s)]
        if not free:
            return None
        turn = free[self._tries % len(free)]
        self._tries += 1
        robot = self._supervisor.robot
        takes_s = abs(turn) / (GENTLE * robot.max_yaw_rate_radps) + WAY_M / (GENTLE * robot.max_speed_mps)
        LOG.info("held by an obstacle: turning by %.0f degrees to a free way", math.degrees(turn))
        return _Way(pose[2] + turn, pose, now_s + takes_s + SPARE_S)
