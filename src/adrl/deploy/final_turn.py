"""The heading that a goal asks for: once there, the robot turns to it on the spot, the shorter way round first."""

import math

from adrl.deploy.messages import Twist
from adrl.deploy.supervisor import GENTLE
from adrl.errors import NoRoomToTurn
from adrl.types import RobotConfig

PATIENCE_S = 3.0
"""A robot that has not turned on in this time tries the other way round, then no more."""
PROGRESS_RAD = 0.05
"""Nearer by so much, it has turned on."""


class FinalTurn:
    """Of one robot at one goal."""

    def __init__(self, robot: RobotConfig, yaw_rad: float, tolerance_rad: float) -> None:
        self.yaw_rad = yaw_rad
        self._tolerance_rad = tolerance_rad
        self._fastest = GENTLE * robot.max_yaw_rate_radps
        self._tried_both = False
        self._side = 0.0
        """1 to turn left where that is the longer way, -1 right; 0 for the shorter way."""
        self._least_rad, self._since_s = math.inf, -math.inf

    def twist(self, yaw_rad: float, now_s: float) -> Twist | None:
        """What to ask for at a heading; None where it is the one wanted. Raises NoRoomToTurn."""
        off = math.remainder(self.yaw_rad - yaw_rad, 2.0 * math.pi)
        if abs(off) <= self._tolerance_rad:
            return None
        if self._side * off > 0.0:
            self._side = 0.0  # half way round it is the shorter one, and whoever turns too far turns back
        off += self._side * 2.0 * math.pi
        if abs(off) < self._least_rad - PROGRESS_RAD:
            self._least_rad, self._since_s = abs(off), now_s
        elif now_s < self._since_s:  # the clock has gone back
            self._since_s = now_s
        elif now_s - self._since_s > PATIENCE_S:
            if self._tried_both:
                raise NoRoomToTurn(
                    "at the goal, but there is no room to turn to its heading, either way round: "
                    "give another heading or place, or a larger yaw tolerance"
                )
            self._side, self._tried_both = -math.copysign(1.0, off), True
            self._least_rad, self._since_s = math.inf, now_s
        return 0.0, min(max(2.0 * off, -self._fastest), self._fastest)
