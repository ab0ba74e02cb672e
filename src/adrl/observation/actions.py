"""Between a policy's actions and velocities."""

import numpy as np
from numpy.typing import NDArray

from adrl.types import Array, RobotConfig, RobotRows

F32 = NDArray[np.float32]


def to_twist(action: F32, robot: RobotConfig | RobotRows) -> Array:
    """(N, 2) actions in [-1, 1] -> (N, 2) commands: speed, from min_speed to max_speed, and yaw rate."""
    clipped = np.clip(action, -1.0, 1.0).astype(np.float64)
    span = robot.max_speed_mps - robot.min_speed_mps
    speed = robot.min_speed_mps + 0.5 * (clipped[:, 0] + 1.0) * span
    return np.stack([speed, clipped[:, 1] * robot.max_yaw_rate_radps], axis=1)


def to_action(twist: Array, robot: RobotConfig | RobotRows) -> F32:
    """(N, 2) commands -> (N, 2) actions: the inverse of to_twist, clipped to [-1, 1]."""
    span = robot.max_speed_mps - robot.min_speed_mps
    speed = 2.0 * (twist[:, 0] - robot.min_speed_mps) / span - 1.0
    action = np.stack([speed, twist[:, 1] / robot.max_yaw_rate_radps], axis=1)
    return np.clip(action, -1.0, 1.0).astype(np.float32)
