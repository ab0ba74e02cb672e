"""What the body is: size, speeds, how it stops, what its LiDAR sees. One policy of many robots is told it."""

import math
from collections.abc import Sequence

import numpy as np

from adrl.observation.component import F32, Mirror, Senses
from adrl.observation.config import EncoderConfig
from adrl.types import Array, RobotConfig

AROUND: Array = np.array([-135.0, -90.0, -45.0, 0.0, 45.0, 90.0, 135.0, 180.0]) * (math.pi / 180.0)
"""(8,) directions in the robot's frame in which the footprint's extent is told."""
EVENLY: dict[str, tuple[float, float]] = {
    "extent": (0.0, 0.8),
    "backward_mps": (0.0, 2.0),
    "stop_time_s": (0.0, 2.0),
    "lag_s": (0.0, 0.3),
    "latency_s": (0.0, 0.2),
    "turning_radius_m": (0.0, 1.5),
    "mount_x_m": (-0.6, 0.6),
    "mount_y_m": (-0.6, 0.6),
    "fov_rad": (0.5 * math.pi, 2.0 * math.pi),
}
"""What reads -1 and what 1; evenly between and beyond."""
BY_RATIO: dict[str, tuple[float, float]] = {
    "forward_mps": (0.2, 2.0),
    "yaw_rate_radps": (0.5, 3.0),
    "acceleration_mps2": (0.2, 20.0),
    "yaw_acceleration_radps2": (0.5, 30.0),
    "stop_distance_m": (0.02, 1.5),
    "control_period_s": (0.05, 0.2),
    "range_m": (3.0, 30.0),
}
"""The same of numbers above 0, of which twice as much is as far from one as from another."""


def body_numbers(robot: RobotConfig) -> dict[str, float]:
    """By name, in the order in which an observation has them. What family any draws lies within about [-1, 1].

    `mount_sin`, `mount_cos`: how the LiDAR is turned. Beyond the family the others go on, each rising.
    """
    lidar = robot.lidar
    plain = {
        **{f"extent_{k}": extent for k, extent in enumerate(extents_m(robot, AROUND).tolist())},
        "forward_mps": robot.max_speed_mps,
        "backward_mps": -robot.min_speed_mps,
        "yaw_rate_radps": robot.max_yaw_rate_radps,
        "acceleration_mps2": robot.max_acceleration_mps2,
        "yaw_acceleration_radps2": robot.max_yaw_acceleration_radps2,
        "stop_time_s": robot.stop_time_s,
        "stop_distance_m": robot.stop_distance_m,
        "lag_s": robot.lag_s,
        "latency_s": robot.latency_s,
        "control_period_s": robot.control_period_s,
        "turning_radius_m": robot.min_turning_radius_m,
        "fov_rad": lidar.fov_rad,
        "range_m": lidar.max_range_m,
        "mount_x_m": lidar.mount_x_m,
        "mount_y_m": lidar.mount_y_m,
    }
    turned = {"mount_sin": math.sin(lidar.mount_yaw_rad), "mount_cos": math.cos(lidar.mount_yaw_rad)}
    return {
        name: _scaled(name.partition("_")[0] if name.startswith("extent") else name, number)
        for name, number in plain.items()
    } | turned


def extents_m(robot: RobotConfig, angles: Array) -> Array:
    """(A,) how far the footprint reaches from the robot's origin in each direction, to the last of its points."""
    if robot.radius_m is not None:
        return np.full(len(angles), robot.radius_m)
    return (np.stack([np.cos(angles), np.sin(angles)], axis=1) @ robot.polygon.T).max(axis=1)


def _scaled(name: str, number: float) -> float:
    """-1 at the low end of the name's range, 1 at the high one, rising and finite everywhere."""
    if name in EVENLY:
        low, high = EVENLY[name]
        return 2.0 * (number - low) / (high - low) - 1.0
    low, high = BY_RATIO[name]
    return 2.0 * math.log(number / low) / math.log(high / low) - 1.0


class Body:
    """The numbers of body_numbers, the same in every observation of a robot."""

    def __init__(self, robots: Sequence[RobotConfig], config: EncoderConfig) -> None:
        numbers = [body_numbers(robot) for robot in robots]
        self.numbers: F32 = np.array([[*of_one.values()] for of_one in numbers], np.float32)
        """(R, D) of each robot."""
        self.size = self.numbers.shape[1]
        self.limit = float(np.abs(self.numbers).max())
        self._names = [*numbers[0]]

    def write(self, senses: Senses, out: F32) -> None:
        """Fill (N, D)."""
        out[:] = self.numbers[senses.kind]

    def mirror(self) -> Mirror | None:
        """The mirrored robot's: what is told of the left is told of the right, and the LiDAR is on the other side."""
        sides = len(AROUND)
        order, sign = np.arange(self.size), np.ones(self.size, np.float32)
        order[:sides] = (sides - 2 - np.arange(sides)) % sides  # the last direction is straight back
        for name in ("mount_y_m", "mount_sin"):
            sign[self._names.index(name)] = -1.0
        return Mirror(order, sign)
