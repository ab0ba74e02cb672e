"""From an observation back to metres: what a policy of one's own reads instead of 44 numbers."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adrl.observation.config import EncoderConfig
from adrl.observation.encoder import ObservationEncoder
from adrl.observation.goal import FAR_M
from adrl.observation.motion import cue_settings
from adrl.types import Array, RobotConfig


@dataclass(frozen=True, eq=False, kw_only=True)
class Decoded:
    """What observations of N robots tell, a row a robot."""

    ranges: Array
    """(N, S) nearest range of each sector, m from the LiDAR: not below the footprint's edge, the greatest range where
    nothing is in reach."""
    goal: Array
    """(N, 2) x ahead, y to the left, m: the point that the guidance gives."""
    twist: Array
    """(N, 2) measured speed, m/s, and yaw rate, rad/s."""
    last_action: Array
    """(N, 2) the action before, in [-1, 1]."""
    motion: Array
    """(N, S) metres by which something has come, negative, or gone; (N, 0) without motion cues."""
    path: Array
    """(N, P, 2) m: points of the path ahead; (N, 0, 2) where the policy is not told of it."""


class ObservationDecoder:
    """The inverse of ObservationEncoder, as far as there is one: a sector keeps its nearest beam alone."""

    def __init__(self, robot: RobotConfig, config: EncoderConfig | None = None) -> None:
        self.robot = robot
        self._encoder = ObservationEncoder(robot, config)
        self.angles_rad = self._encoder.scan.angles_rad
        """(S,) middle of each sector, in the robot's frame."""

    def decode(self, observation: NDArray[np.floating]) -> Decoded:
        """Of (N, D) observations. Raises ValueError for another D."""
        config, robot = self._encoder.config, self.robot
        if observation.ndim != 2 or observation.shape[1] != self._encoder.size:
            raise ValueError(f"observations of shape {observation.shape}; give (N, {self._encoder.size})")
        told = {
            name: np.asarray(observation[:, place], np.float64)
            for name, place in self._encoder.places.items()
        }
        reach = math.log1p(config.reach_of(robot) / config.near_m)
        direction, near, far = told["goal"][:, :2], told["goal"][:, 2], told["goal"][:, 3]
        # Near goals and far ones have a scale each.
        distance = np.where(
            far < 1.0,
            FAR_M * far,
            config.goal_scale_m * near / np.maximum(1.0 - near, np.finfo(np.float32).eps),
        )
        cue_m = cue_settings(robot, config.num_sectors, config.history_steps).scale_m
        path = told.get("path", np.empty((len(observation), 0))).reshape(len(observation), -1, 2)
        length = np.hypot(path[..., 0], path[..., 1])[..., None]
        return Decoded(
            ranges=config.near_m * np.expm1(told["scan"] * reach) + self._encoder.extent_m,
            goal=direction * distance[:, None],
            twist=told["twist"] * [robot.max_speed_mps, robot.max_yaw_rate_radps],
            last_action=told["last_action"],
            path=path * config.goal_scale_m / np.maximum(1.0 - length, np.finfo(np.float32).eps),
            motion=told.get("motion", np.empty((len(observation), 0))) * cue_m,
        )
