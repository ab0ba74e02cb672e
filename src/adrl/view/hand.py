"""A person at the wheel, as a policy: supervisor, goal and recording are then those of any other."""

import numpy as np
from numpy.typing import NDArray

from adrl.observation import to_action
from adrl.types import RobotConfig

BY_HAND = "by hand"
"""What it is called among the policies."""
LET_GO_S = 0.5
"""Without a word for so long, the person has let go."""


class ByHand:
    """Drives as it was told last."""

    name = BY_HAND
    guidance = "goal"
    training_worlds = ()

    def __init__(self, robot: RobotConfig) -> None:
        self._robot = robot
        self._told_s = -np.inf
        self.twist = (0.0, 0.0)

    def tell(self, speed: float, turn: float, now_s: float) -> None:
        """speed, turn: shares in [-1, 1] of the robot's greatest speed forwards or backwards, and yaw rate."""
        robot = self._robot
        reach = robot.max_speed_mps if speed >= 0.0 else -robot.min_speed_mps
        self.twist = (speed * max(reach, 0.0), turn * robot.max_yaw_rate_radps)
        self._told_s = now_s

    def let_go(self, now_s: float) -> None:
        """To be called now and then: who says nothing for LET_GO_S does not drive."""
        if now_s - self._told_s > LET_GO_S:
            self.twist = (0.0, 0.0)

    def act(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """(N, D) observations -> (N, 2) actions; see adrl.types.Policy."""
        return np.repeat(to_action(np.array([self.twist]), self._robot), len(observation), axis=0)
