"""The path ahead: some points of it. They tell how the way goes on, and where a car turns back."""

from collections.abc import Sequence

import numpy as np

from adrl import _core
from adrl.observation.component import F32, Mirror, Senses, unchanged
from adrl.observation.config import EncoderConfig
from adrl.types import Array, RobotConfig

PATH_POINTS_M: Array = np.array(_core.PATH_POINTS_M)
"""(P,) how far along the path each point is ahead of the robot; beyond the path's end they lie there."""


class PathAhead:
    """2 numbers of each point: the vector to it, shortened from d to d / (d + scale), which is below 1.

    A robot that is led to the goal alone knows of no path: all points are the goal. One that has a straight free way to
    its goal, with guidance `replan`, is shown that way.
    """

    size = 2 * len(PATH_POINTS_M)
    limit = 1.0

    def __init__(self, robots: Sequence[RobotConfig], config: EncoderConfig) -> None:
        self._scale_m = config.goal_scale_m

    def write(self, senses: Senses, out: F32) -> None:
        """Fill (N, 2 P). Raises ValueError without a path."""
        if senses.path is None:
            raise ValueError("an encoder with points of the path needs them; give path")
        away = np.hypot(senses.path[..., 0], senses.path[..., 1])
        out[:] = (senses.path / (away + self._scale_m)[..., None]).reshape(out.shape)

    def mirror(self) -> Mirror | None:
        """y turns round."""
        return unchanged(self.size, *range(1, self.size, 2))
