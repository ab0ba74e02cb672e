"""complex: a walled square of 17 x 17 m, dense with walls, narrow gaps, U-traps, boxes and circles.

Any two obstacles keep a gap that the robot fits through, so no place is shut off and every task is solvable;
what makes it hard is that the gaps are narrow, the walls force detours and the traps open to any side.
"""

import math
from dataclasses import dataclass

import numpy as np

from adrl.planning.grid import FreeSpace
from adrl.types import RobotConfig, Task, World
from adrl.worlds.layout import THIN_M, Item, Layout, box_item, circle_item, gap_range, trap_item, walled_world
from adrl.worlds.tasks import draw_in_new_world

PARTITION_THICKNESS_M = 0.15


@dataclass(frozen=True, kw_only=True)
class Complex:
    """Start and goal are about 21 m of shortest path apart, the length of the paper's Table I."""

    name: str = "complex"
    size_m: float = 17.0
    """Side of the walled square."""
    partitions: int = 2
    """Walls from side to side, each with one to three gaps."""
    gap_m: tuple[float, float] = (0.7, 1.0)
    """Width of the gaps in walls and least distance of obstacles; widened for a robot that needs more."""
    traps: int = 4
    """U-traps: three thin boxes, open to one side."""
    walls: int = 4
    """Free-standing thin walls."""
    boxes: int = 14
    circles: int = 22
    path_m: tuple[float, float] = (19.0, 23.0)
    """Least and greatest length of the shortest path."""

    def generate(self, rng: np.random.Generator, robot: RobotConfig) -> World:
        """Draw a world whose gaps this robot fits through."""
        bounds, gap_m = (0.0, 0.0, self.size_m, self.size_m), gap_range(self.gap_m, robot)
        walls = []
        for i in range(self.partitions):
            at = (i + rng.uniform(0.85, 1.15)) / (self.partitions + 1)
            walls += _draw_partition(rng, at * self.size_m, self.size_m, gap_m)
        if rng.random() < 0.5:
            walls = [wall.transposed() for wall in walls]
        layout = Layout(rng, bounds, gap_m)
        for wall in walls:
            layout.add(wall)
        layout.scatter(self.traps, _draw_trap)
        layout.scatter(self.walls, _draw_wall)
        layout.scatter(self.boxes, _draw_box)
        layout.scatter(self.circles, _draw_circle)
        return walled_world(bounds, layout.items)

    def task(self, rng: np.random.Generator, robot: RobotConfig) -> Task:
        """Draw a world and a solvable start and goal. Raises TaskError for a robot too large for it."""
        return self.draw(rng, robot)[0]

    def draw(
        self, rng: np.random.Generator, robot: RobotConfig, limit_m: float = 0.0
    ) -> tuple[Task, FreeSpace]:
        """As task(), with the free space it was drawn from; its clearances reach to limit_m at least."""
        low, high = self.path_m
        return draw_in_new_world(
            self, rng, robot, path_range_m=self.path_m, straight_range_m=(0.78 * low, high), limit_m=limit_m
        )


def _draw_partition(
    rng: np.random.Generator, x_m: float, length_m: float, gap_m: tuple[float, float]
) -> list[Item]:
    """A thin wall at x from y = 0 to its length, with one to three gaps."""
    middles = np.sort(rng.uniform(0.06, 0.94, rng.integers(1, 4))) * length_m
    low = 0.0
    pieces = []
    for middle in middles:
        half = 0.5 * rng.uniform(*gap_m)
        if middle - half - low < PARTITION_THICKNESS_M:
            continue  # two gaps that meet: keep the first
        pieces.append((low, middle - half))
        low = middle + half
    pieces.append((low, length_m))
    return [
        box_item(x_m, 0.5 * (bottom + top), PARTITION_THICKNESS_M, top - bottom) for bottom, top in pieces
    ]


def _draw_trap(rng: np.random.Generator) -> Item:
    """Open towards a random side."""
    return trap_item(rng.uniform(0.8, 1.4), rng.uniform(1.0, 1.8), rng.uniform(-math.pi, math.pi))


def _draw_wall(rng: np.random.Generator) -> Item:
    return box_item(0.0, 0.0, rng.uniform(1.2, 2.6), THIN_M, rng.uniform(-math.pi, math.pi))


def _draw_box(rng: np.random.Generator) -> Item:
    return box_item(0.0, 0.0, rng.uniform(0.3, 1.0), rng.uniform(0.3, 1.0), rng.uniform(-math.pi, math.pi))


def _draw_circle(rng: np.random.Generator) -> Item:
    return circle_item(rng.uniform(0.15, 0.45))
