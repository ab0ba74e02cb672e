"""How fast the robot is, as measured."""

from collections.abc import Sequence

from adrl.observation.component import F32, Mirror, Senses, unchanged
from adrl.observation.config import EncoderConfig
from adrl.types import RobotConfig, RobotRows


class Twist:
    """2 numbers: speed and yaw rate, in units of the robot's greatest."""

    size = 2

    def __init__(self, robots: Sequence[RobotConfig], config: EncoderConfig) -> None:
        self._robots = RobotRows.of(robots)
        # Robots drive below twice the speed told.
        self.limit = 2.0 * max(1.0, *(-robot.min_speed_mps / robot.max_speed_mps for robot in robots))

    def write(self, senses: Senses, out: F32) -> None:
        """Fill (N, 2)."""
        out[:, 0] = senses.twist[:, 0] / self._robots.max_speed_mps[senses.kind]
        out[:, 1] = senses.twist[:, 1] / self._robots.max_yaw_rate_radps[senses.kind]

    def mirror(self) -> Mirror | None:
        """The yaw rate turns round."""
        return unchanged(self.size, 1)
