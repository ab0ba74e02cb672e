"""Episode-to-episode variation of the robots: what the real one will differ in from the model."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from adrl import _core
from adrl.errors import ConfigError
from adrl.types import Array, RobotConfig


@dataclass(frozen=True, kw_only=True)
class Randomization:
    """Half-widths of uniform ranges, drawn once an episode. All zero: the nominal robot."""

    gain: float = 0.0
    """Relative error of executed over commanded speed and yaw rate: wheel wear, drag, slip."""
    acceleration: float = 0.0
    """Relative change of both acceleration limits."""
    lag: float = 0.0
    """Relative change of the lag."""
    latency_s: float = 0.0
    """Latency added to the robot's own, uniform in [0, latency_s]."""
    range_noise: float = 0.0
    """Relative change of the range noise."""
    dropout_probability: float = 0.0
    """Dropouts added to the LiDAR's own, uniform in [0, dropout_probability]."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and 0.0 <= value < 1.0):
                raise ConfigError(f"randomization.{field.name} is {value}; give a number in [0, 1)")


NOMINAL = Randomization()
MILD = Randomization(gain=0.05, acceleration=0.2, lag=0.5, latency_s=0.05, range_noise=1.0 - 1e-9)
"""The default of training: no policy should lean on one exact base."""


PARAMS = (
    "speed_gain",
    "yaw_gain",
    "acceleration_mps2",
    "yaw_acceleration_radps2",
    "lag_s",
    "latency_s",
    "range_noise_m",
    "dropout_probability",
    "speed_drift",
    "yaw_drift",
)
"""The columns of the simulator's `params`: gains are executed over commanded, drifts the odometry's relative errors."""
assert len(PARAMS) == _core.NUM_PARAMS


def nominal_params(robot: RobotConfig) -> Array:
    """(P,) what the simulator takes for the robot as configured; columns are PARAMS."""
    lidar = robot.lidar
    params = [
        1.0,
        1.0,
        robot.max_acceleration_mps2,
        robot.max_yaw_acceleration_radps2,
        robot.lag_s,
        robot.latency_s,
    ]
    params += [lidar.noise_std_m, lidar.dropout_probability, 0.0, 0.0]
    return np.array(params)


def draw_params(
    robots: Sequence[RobotConfig], randomization: Randomization, rng: np.random.Generator
) -> Array:
    """(N, P) parameters of new episodes, a row a robot. Odometry drift is drawn too, for nominal robots as well."""
    params = np.stack([nominal_params(robot) for robot in robots])
    r, count = randomization, len(robots)
    params[:, :2] *= 1.0 + r.gain * rng.uniform(-1.0, 1.0, (count, 2))
    params[:, 2:4] *= 1.0 + r.acceleration * rng.uniform(-1.0, 1.0, (count, 2))
    params[:, 4] *= 1.0 + r.lag * rng.uniform(-1.0, 1.0, count)
    params[:, 5] += r.latency_s * rng.uniform(0.0, 1.0, count)
    params[:, 6] *= 1.0 + r.range_noise * rng.uniform(-1.0, 1.0, count)
    params[:, 7] += r.dropout_probability * rng.uniform(0.0, 1.0, count)
    drift = np.array([robot.odometry_drift for robot in robots])
    params[:, 8:] = drift[:, None] * rng.standard_normal((count, 2))
    return params
