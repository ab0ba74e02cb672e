"""How fast the robot is, as measured."""

from adrl.observation.component import F32, Mirror, Senses, unchanged
from adrl.observation.config import EncoderConfig
from adrl.types import RobotConfig


class Twist:
    """2 numbers: speed and yaw rate, in units of the robot's greatest."""

    size = 2

    def __init__(self, robot: RobotConfig, config: EncoderConfig) -> None:
        self._robot = robot
        # Robots drive below twice the speed told.
        self.limit = 2.0 * max(1.0, -robot.min_speed_mps / robot.max_speed_mps)

    def write(self, senses: Senses, out: F32) -> None:
        """Fill (N, 2)."""
        out[:, 0] = senses.twist[:, 0] / self._robot.max_speed_mps
        out[:, 1] = senses.twist[:, 1] / self._robot.max_yaw_rate_radps

    def mirror(self) -> Mirror | None:
        """The yaw rate turns round."""
        return unchanged(self.size, 1)
