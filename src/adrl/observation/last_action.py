"""What the robot was told last: a base that lags has not done it yet."""

from collections.abc import Sequence

from adrl.observation.component import F32, Mirror, Senses, unchanged
from adrl.observation.config import EncoderConfig
from adrl.types import ACTION_SIZE, RobotConfig


class LastAction:
    """2 numbers: the action of the control period before, in [-1, 1]."""

    size = ACTION_SIZE
    limit = 1.0

    def __init__(self, robots: Sequence[RobotConfig], config: EncoderConfig) -> None:
        """Nothing of the robots is needed."""

    def write(self, senses: Senses, out: F32) -> None:
        """Fill (N, 2)."""
        out[:] = senses.last_action

    def mirror(self) -> Mirror | None:
        """The yaw rate turns round."""
        return unchanged(self.size, 1)
