"""clutter: a walled yard of 10 x 10 m with circles and rotated boxes thrown in at random."""

import math
from dataclasses import dataclass

import numpy as np

from adrl.types import RobotConfig, Task, World
from adrl.worlds.shapes import box, enclosure
from adrl.worlds.tasks import draw_in_new_world


@dataclass(frozen=True, kw_only=True)
class Clutter:
    """Obstacles may touch and leave dead ends; start and goal are at least 5 m apart and always connected."""

    name: str = "clutter"
    size_m: float = 10.0
    """Side of the walled square."""
    obstacles: tuple[int, int] = (10, 20)
    """Fewest and most obstacles."""
    circle_radius_m: tuple[float, float] = (0.15, 0.5)
    box_side_m: tuple[float, float] = (0.3, 1.2)
    straight_m: tuple[float, float] = (5.0, 11.0)
    """Least and greatest straight distance from start to goal."""
    path_m: tuple[float, float] = (5.0, math.inf)
    """Least and greatest length of the shortest path."""

    def generate(self, rng: np.random.Generator, robot: RobotConfig) -> World:
        """Draw a world. The robot has no say in it."""
        count = int(rng.integers(self.obstacles[0], self.obstacles[1] + 1))
        places = rng.uniform(0.0, self.size_m, (count, 2))
        is_circle = rng.random(count) < 0.5
        radii = rng.uniform(*self.circle_radius_m, count)
        sides = rng.uniform(*self.box_side_m, (count, 2))
        yaws = rng.uniform(-math.pi, math.pi, count)
        boxes = np.column_stack([places, sides, yaws])
        bounds = (0.0, 0.0, self.size_m, self.size_m)
        return World(
            bounds=bounds,
            circles=np.column_stack([places, radii])[is_circle],
            polygons=tuple(box(*shape) for shape in boxes[~is_circle]),
            segments=enclosure(bounds),
        )

    def task(self, rng: np.random.Generator, robot: RobotConfig) -> Task:
        """Draw a world and a solvable start and goal. Raises TaskError for a robot too large for it."""
        task, _ = draw_in_new_world(
            self, rng, robot, path_range_m=self.path_m, straight_range_m=self.straight_m
        )
        return task
