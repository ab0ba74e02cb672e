"""hall: a long walled hall of 24 x 7 m with walls, U-traps, boxes and circles, driven from end to end.

The paper's kind of place: its methods have no map and all but straight ways, so there are few dead ends. Here the goal
lies ahead, obstacles stand in between, and most of them can be passed on either side. Any two keep a gap that the robot
fits through, so every task is solvable.
"""

import math
from dataclasses import dataclass

import numpy as np

from adrl.types import RobotConfig, Task, World
from adrl.worlds.layout import THIN_M, Item, Layout, box_item, circle_item, gap_range, trap_item, walled_world
from adrl.worlds.tasks import draw_in_new_world


@dataclass(frozen=True, kw_only=True)
class Hall:
    """Start and goal are at the two ends of a long hall; most of what stands between can be passed on either side.

    Frozen: how its numbers were chosen stands in docs/decisions.md.
    """

    name: str = "hall"
    length_m: float = 24.0
    width_m: float = 7.0
    gap_m: tuple[float, float] = (0.7, 0.9)
    """Least distance of obstacles; widened for a robot that needs more."""
    traps: int = 8
    """U-traps: three thin boxes, open to any side. Most of them stand in the end; of walls, boxes and circles, for
    which there is less room then, about a half."""
    trap_depth_m: tuple[float, float] = (0.5, 0.8)
    trap_width_m: tuple[float, float] = (0.9, 1.3)
    walls: int = 10
    """Free-standing thin walls."""
    wall_m: tuple[float, float] = (2.0, 4.0)
    """Their length."""
    boxes: int = 12
    circles: int = 12
    path_m: tuple[float, float] = (19.0, 24.0)
    """Least and greatest length of the shortest path."""

    def generate(self, rng: np.random.Generator, robot: RobotConfig) -> World:
        """Draw a world whose gaps this robot fits through."""
        bounds = (0.0, 0.0, self.length_m, self.width_m)
        layout = Layout(rng, bounds, gap_range(self.gap_m, robot))
        layout.scatter(self.traps, self._draw_trap)
        layout.scatter(self.walls, self._draw_wall)
        layout.scatter(self.boxes, _draw_box)
        layout.scatter(self.circles, _draw_circle)
        return walled_world(bounds, layout.items)

    def task(self, rng: np.random.Generator, robot: RobotConfig) -> Task:
        """Draw a world and a solvable start and goal. Raises TaskError for a robot too large for it."""
        low, high = self.path_m
        task, _ = draw_in_new_world(
            self, rng, robot, path_range_m=self.path_m, straight_range_m=(0.9 * low, high)
        )
        return task

    def _draw_trap(self, rng: np.random.Generator) -> Item:
        yaw_rad = rng.uniform(-math.pi, math.pi)
        return trap_item(rng.uniform(*self.trap_depth_m), rng.uniform(*self.trap_width_m), yaw_rad)

    def _draw_wall(self, rng: np.random.Generator) -> Item:
        return box_item(0.0, 0.0, rng.uniform(*self.wall_m), THIN_M, rng.uniform(-math.pi, math.pi))


def _draw_box(rng: np.random.Generator) -> Item:
    return box_item(0.0, 0.0, rng.uniform(0.3, 1.0), rng.uniform(0.3, 1.0), rng.uniform(-math.pi, math.pi))


def _draw_circle(rng: np.random.Generator) -> Item:
    return circle_item(rng.uniform(0.15, 0.45))
