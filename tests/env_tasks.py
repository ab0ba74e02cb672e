"""Worlds simple enough to know what must happen in them, as scenarios for the environment tests."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from adrl.types import RobotConfig, Task, World
from adrl.worlds import single_task


@dataclass(frozen=True)
class OneTask:
    """A scenario that always gives the same task."""

    given: Task
    name: str = "one_task"

    def task(self, rng: np.random.Generator, robot: RobotConfig) -> Task:
        return self.given


def room(
    size_m: float = 12.0, segments: Sequence[Sequence[float]] = (), circles: Sequence[Sequence[float]] = ()
) -> World:
    """A walled square room around the origin; walls (x1, y1, x2, y2) and pillars (x, y, radius) in it."""
    h = 0.5 * size_m
    walls = [[-h, -h, h, -h], [h, -h, h, h], [h, h, -h, h], [-h, h, -h, -h], *segments]
    return World(bounds=(-h, -h, h, h), segments=np.array(walls), circles=np.array(circles))


def straight_task(robot: RobotConfig, distance_m: float = 3.0, yaw: float = 0.0, **changes: object) -> Task:
    """Start at (-2, 0) with the heading yaw; the goal is distance_m ahead along x, with nothing between."""
    task = single_task(room(), (-2.0, 0.0, yaw), (-2.0 + distance_m, 0.0), robot)
    return dataclasses.replace(task, **changes)  # pyright: ignore


def quiet(robot: RobotConfig) -> RobotConfig:
    """The robot with a perfect LiDAR."""
    return dataclasses.replace(
        robot, lidar=dataclasses.replace(robot.lidar, noise_std_m=0.0, dropout_probability=0.0)
    )


def wrapped(angle: float) -> float:
    """The angle in (-pi, pi]."""
    return math.atan2(math.sin(angle), math.cos(angle))
