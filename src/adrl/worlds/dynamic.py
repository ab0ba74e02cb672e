"""dynamic: complex, slightly thinner, with discs that run to and fro between two ends."""

import dataclasses
import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from adrl.errors import TaskError
from adrl.planning.grid import PlanningGrid
from adrl.types import Array, RobotConfig, Task, World, disc_centres
from adrl.worlds.complex import Complex


@dataclass(frozen=True, kw_only=True)
class Dynamic:
    """Discs never touch what stands still; at time 0 none is near the robot."""

    name: str = "dynamic"
    static: Complex = field(
        default_factory=lambda: Complex(name="dynamic", traps=3, walls=3, boxes=9, circles=14)
    )
    """The world they run in."""
    discs: tuple[int, int] = (6, 10)
    """Fewest and most discs."""
    radius_m: tuple[float, float] = (0.2, 0.3)
    speed_mps: tuple[float, float] = (0.2, 0.5)
    run_m: tuple[float, float] = (2.0, 6.0)
    """Shortest and longest distance between a disc's ends."""
    start_distance_m: float = 1.5
    """Least distance at time 0 from the robot's centre to a disc's edge."""

    def task(self, rng: np.random.Generator, robot: RobotConfig) -> Task:
        """Draw a world, its discs and a solvable start and goal. Raises TaskError."""
        # Clearances far enough for the largest disc.
        task, space = self.static.draw(rng, robot, limit_m=self.radius_m[1] + 0.1)
        count = int(rng.integers(self.discs[0], self.discs[1] + 1))
        discs = [self._draw_disc(rng, space.grid, task.start) for _ in range(count)]
        world: World = dataclasses.replace(task.world, discs=np.array(discs))
        return dataclasses.replace(task, world=world)

    def _draw_disc(
        self, rng: np.random.Generator, grid: PlanningGrid, start: tuple[float, float, float]
    ) -> tuple[float, ...]:
        """One row of World.discs."""
        radius, speed, phase = rng.uniform(*self.radius_m), rng.uniform(*self.speed_mps), rng.random()
        x_min, y_min, x_max, y_max = grid.bounds
        for _ in range(50):
            # 32 lines at once; the first that is free will do.
            a = rng.uniform((x_min, y_min), (x_max, y_max), (32, 2))
            heading, length = rng.uniform(-math.pi, math.pi, 32), rng.uniform(*self.run_m, 32)
            b = a + length[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
            still = np.broadcast_to((radius, speed, phase, math.inf), (32, 4))
            now = disc_centres(np.column_stack([a, b, still]), 0.0)
            likely = np.hypot(now[:, 0] - start[0], now[:, 1] - start[1]) >= self.start_distance_m + radius
            likely &= _has_room(grid, a, radius) & _has_room(grid, b, radius)
            for i in np.flatnonzero(likely):
                if _has_room(grid, _along(grid, a[i], b[i]), radius).all():
                    return (*a[i], *b[i], radius, speed, phase, math.inf)
        raise TaskError(
            f"scenario {self.name!r}: no free line for a disc of {radius:.2f} m; ask for fewer discs"
        )


def _along(grid: PlanningGrid, a: Array, b: Array) -> Array:
    """(P, 2) points on the line a-b, at most a cell apart, ends included."""
    count = math.ceil(math.dist(a, b) / grid.resolution_m) + 1
    return a + np.linspace(0.0, 1.0, count)[:, None] * (b - a)


def _has_room(grid: PlanningGrid, points: Array, radius_m: float) -> NDArray[np.bool_]:
    """(N,) whether a disc at (N, 2), and half a cell to either side, touches nothing and stays inside."""
    # The clearance read is that at the centre of the point's cell, at most 0.71 cells away, and clearance
    # changes by no more than the distance moved.
    return grid.contains(points) & (grid.clearance_at(points) >= radius_m + 1.25 * grid.resolution_m)
