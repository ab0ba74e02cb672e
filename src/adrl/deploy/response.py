"""How late and how strongly a base acts on commands, measured: what it was told, and when, against what odometry says
it did."""

import numpy as np

from adrl.deploy.evidence import Evidence
from adrl.deploy.messages import Odometry
from adrl.types import Array, RobotConfig

LATEST_PERIODS = 4
"""Control periods beyond its latency that a base may be late, and still be braked."""
STRENGTHS = (1.0, 0.5)
"""Shares of the accelerations in its RobotConfig that a base may have."""
MOST_MISFIT = 0.5
"""Of one measurement, as a share of the greatest speeds: one that nothing explains has no more to say."""
SLACK, MOST, ENOUGH = 0.03, 0.3, 0.4
"""Of Evidence."""
NOISE_SHARE, NOISE_GAIN = 0.5, 0.05
"""Of what nothing explains, the share that an alternative has to explain better by; and how fast that is averaged."""
LONGEST_S = 0.5
"""Odometry farther apart tells too little of when something was done."""


class Response:
    """Of one base: the whole control periods by which it is later than its RobotConfig says, and its strength."""

    def __init__(self, robot: RobotConfig) -> None:
        self._robot = robot
        self._evidence = Evidence(
            len(STRENGTHS) * (LATEST_PERIODS + 1), slack=SLACK, most=MOST, enough=ENOUGH
        )
        self._believed, self._noise = 0, 0.0

    @property
    def late_s(self) -> float:
        """Seconds beyond the configured latency."""
        return self._believed % (LATEST_PERIODS + 1) * self._robot.control_period_s

    @property
    def strength(self) -> int:
        """Number in STRENGTHS."""
        return self._believed // (LATEST_PERIODS + 1)

    def take(self, last: Odometry, new: Odometry, predicted: Array) -> None:
        """predicted: (len(STRENGTHS), LATEST_PERIODS + 1, 2) twists at the new odometry of a base of each strength that
        is late by 0, 1, ... periods."""
        if not 0.0 < new.stamp_s - last.stamp_s <= LONGEST_S:
            return
        apart = predicted.reshape(-1, 2) - np.array(new.twist)
        misfit = np.minimum(self._shares(apart), MOST_MISFIT)
        # Twists that are noise for a good part, as a slow robot's may be, bear out anything by chance.
        self._noise += NOISE_GAIN * (float(misfit.min()) - self._noise)
        found = self._evidence.add(float(misfit[self._believed]), misfit + NOISE_SHARE * self._noise)
        if found is not None:
            self._believed = found
            self._evidence.forget()

    def _shares(self, twists: Array) -> Array:
        """(A,) of (A, 2), as a share of the robot's greatest speeds."""
        return np.abs(twists) @ np.array(
            [1.0 / self._robot.fastest_mps, 1.0 / self._robot.max_yaw_rate_radps]
        )
