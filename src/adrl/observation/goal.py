"""The point to head for: its direction, and its distance on two scales."""

from collections.abc import Sequence

import numpy as np

from adrl.observation.component import F32, Mirror, Senses, unchanged
from adrl.observation.config import EncoderConfig
from adrl.types import RobotConfig

FAR_M = 10.0
"""Where the scale of far goals ends; the other one never does."""


class Goal:
    """4 numbers: the unit vector to the goal, and its distance twice. One tells near goals apart, one far ones."""

    size = 4
    limit = 1.0

    def __init__(self, robots: Sequence[RobotConfig], config: EncoderConfig) -> None:
        self._scale_m = config.goal_scale_m

    def write(self, senses: Senses, out: F32) -> None:
        """Fill (N, 4)."""
        goal = senses.goal
        distance = np.hypot(goal[:, 0], goal[:, 1])
        safe = np.maximum(distance, 1e-9)
        out[:, 0] = goal[:, 0] / safe
        out[:, 1] = goal[:, 1] / safe
        # Both scales end at 1.
        out[:, 2] = distance / (distance + self._scale_m)
        out[:, 3] = np.minimum(distance * (1.0 / FAR_M), 1.0)

    def mirror(self) -> Mirror | None:
        """y turns round."""
        return unchanged(self.size, 1)
