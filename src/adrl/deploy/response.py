"""How late a base acts on commands, measured: what it was told, and when, against what odometry says it did."""

import numpy as np

from adrl.deploy.evidence import Evidence
from adrl.deploy.messages import Odometry
from adrl.types import Array, RobotConfig

LATEST_PERIODS = 4
"""Control periods beyond its latency that a base may be late, and still be braked."""
MOST_MISFIT = 0.5
"""Of one measurement, as a share of the greatest speeds: one that nothing explains has no more to say."""
SLACK, MOST, ENOUGH = 0.03, 0.3, 0.4
"""Of Evidence."""
LONGEST_S = 0.5
"""Odometry farther apart tells too little of when something was done."""


class Response:
    """Of one base: the whole control periods by which it is later than its RobotConfig says."""

    def __init__(self, robot: RobotConfig) -> None:
        self._robot = robot
        self._evidence = Evidence(LATEST_PERIODS + 1, slack=SLACK, most=MOST, enough=ENOUGH)
        self.periods = 0

    def forget(self) -> None:
        """Begin anew, as configured."""
        self._evidence.forget()
        self.periods = 0

    @property
    def late_s(self) -> float:
        """Seconds beyond the configured latency."""
        return self.periods * self._robot.control_period_s

    def take(self, last: Odometry, new: Odometry, predicted: Array) -> None:
        """predicted: (LATEST_PERIODS + 1, 2) twists at the new odometry of a base late by 0, 1, ... periods."""
        if not 0.0 < new.stamp_s - last.stamp_s <= LONGEST_S:
            return
        misfit = np.minimum(self._shares(predicted - np.array(new.twist)), MOST_MISFIT)
        found = self._evidence.add(float(misfit[self.periods]), misfit)
        if found is not None:
            self.periods = found
            self._evidence.forget()

    def _shares(self, twists: Array) -> Array:
        """(A,) of (A, 2), as a share of the robot's greatest speeds."""
        return np.abs(twists) @ np.array(
            [1.0 / self._robot.fastest_mps, 1.0 / self._robot.max_yaw_rate_radps]
        )
